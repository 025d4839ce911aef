#include "client/refine/refinement.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <utility>

#include "client/refine/coordinates.h"
#include "client/refine/descent.h"
#include "client/refine/refine_result.h"
#include "common/error.h"
#include "common/random.h"
#include "common/render_limits.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace {

// Iterations of each start, before the best goes on alone.
constexpr uint32_t kScoutIterations = 4;
// Losses that differ by fewer standard errors than this are one as good as the other.
constexpr double kSameLoss = 2;
constexpr uint32_t kMinSpp = 4;

void check(const v1::RefineSettings& settings) {
  const auto require = [](bool right, const std::string& message) {
    if (!right) throw invalid_input(message);
  };
  require(settings.spp() >= kMinSpp && settings.max_spp() <= kMaxSamples &&
              settings.spp() <= settings.max_spp(),
          fmt::format("spp {} and max_spp {} must be in [{}, {}], the second at least the first",
                      settings.spp(), settings.max_spp(), kMinSpp, kMaxSamples));
  require(settings.time_limit() >= 0, "time_limit must be at least 0");
  require(settings.tolerance() >= 0 && settings.tolerance() <= 1, "tolerance must be in [0, 1]");
  require(settings.learning_rate() > 0 && std::isfinite(settings.learning_rate()),
          "learning_rate must be positive");
  require(settings.block() >= 1 && settings.block() <= 64, "block must be in [1, 64]");
  require(settings.model_error() >= 0 && settings.model_error() <= 0.5,
          "model_error must be in [0, 0.5]");
  require(settings.model_error() == 0 ||
              (settings.model_error_length() >= 0.1 && settings.model_error_length() <= 1000),
          "model_error_length must be in [0.1, 1000] where there is a model_error");
  for (const auto& [name, deviation] : settings.known_within()) {
    require(deviation > 0 && std::isfinite(deviation),
            fmt::format("known_within of {} is {}; it must be positive", name, deviation));
    const bool is_found = name == kKnownG || (name == kExposure && settings.unknown_exposure()) ||
                          std::ranges::count(settings.unknowns(), name) > 0;
    require(is_found, fmt::format("known_within names {}, which is not found: it must be g; "
                                  "exposure, with --exposure unknown; or a number that is found, "
                                  "with --unknown NAME",
                                  name));
  }
  require(std::abs(settings.expected_g()) <= 0.98, "expected_g must be in [-0.98, 0.98]");
  require(settings.known_within().empty() || settings.method() != v1::RefineSettings::ADAM,
          "known_within is not for ADAM");
}

size_t colours_of(std::span<const Observation> observations) {
  return std::ranges::max(observations, {}, &Observation::colour).colour + 1;
}

void check(std::span<const Observation> observations) {
  if (observations.empty()) throw invalid_input("there is no image to refine from");
  for (const Observation& observation : observations) validate(observation);
  for (size_t colour = 0; colour < colours_of(observations); ++colour) {
    if (std::ranges::count(observations, colour, &Observation::colour) == 0) {
      throw invalid_input(fmt::format("no image shows colour {}", colour));
    }
  }
  std::set<std::pair<size_t, size_t>> photographs;
  for (const Observation& observation : observations) {
    if (photographs.emplace(observation.photograph, observation.colour).second) continue;
    throw invalid_input(
        fmt::format("{} is of the photograph and the colour of another image", observation.name));
  }
  const size_t disturbances = observations.front().disturbances.size();
  for (const Observation& observation : observations) {
    if (observation.disturbances.size() == disturbances) continue;
    throw invalid_input(fmt::format("{} has {} disturbances, and {} has {}; it must be as many",
                                    observations.front().name, disturbances, observation.name,
                                    observation.disturbances.size()));
  }
}

void check_start(const Material& start) {
  validate(start);
  if (start.sigma_t < kMinRefinedSigmaT || start.sigma_t > kMaxRefinedSigmaT) {
    throw invalid_input(
        fmt::format("a start of sigma_t {} cannot be refined; it must be in [{}, {}]",
                    start.sigma_t, kMinRefinedSigmaT, kMaxRefinedSigmaT));
  }
}

Layout layout_of(const v1::RefineSettings& settings, std::span<const Observation> observations) {
  Layout layout{.colours = colours_of(observations),
                .g_of_each_colour = settings.g_of_each_colour(),
                .has_exposure = settings.unknown_exposure(),
                .disturbances = observations.front().disturbances.size()};
  if (layout.g_of_each_colour && layout.colours == 1)
    throw invalid_input("a g of each colour is for images of several colours, and these have one");
  if (settings.unknowns().empty()) return layout;
  std::vector<v1::Scene> scenes;
  for (const Observation& observation : observations) scenes.push_back(scene_of(observation));
  const std::vector<std::string> names(settings.unknowns().begin(), settings.unknowns().end());
  layout.unknowns = scene_unknowns(
      names, scenes, {settings.known_within().begin(), settings.known_within().end()});
  return layout;
}

// Intervals come from how squares of pixels scatter, of which there must be many more than numbers.
void add_few_squares(const Descent& descent, v1::RefineResult& result) {
  constexpr double kSquaresPerNumber = 4;
  if (descent.squares() >= kSquaresPerNumber * descent.numbers()) return;
  result.add_remarks(
      fmt::format("{:.0f} independent squares of pixels count, for {:.0f} numbers that are found: "
                  "they are too few for the intervals to hold",
                  descent.squares(), descent.numbers()));
}

void add_unexplained(const Descent& descent, v1::RefineResult& result) {
  const double part = descent.unexplained_part();
  result.set_unexplained(part);
  if (part == 0) return;
  result.add_remarks(
      fmt::format("{:.2g} % of the pixels hardly count, as no material explains them: is there "
                  "dust, text or a seam? They are left out of picture.png",
                  100 * part));
}

// Beyond its own noise an image should not differ from its render, nor should differences hang
// together.
void add_misfit(const Descent& descent, uint32_t block, v1::RefineResult& result) {
  constexpr double kMisfit = 1.5;
  // What hangs together, as a part of the radiance. Intervals that come from squares of pixels know
  // of as much as small errors of a scene make.
  constexpr double kLeast = 0.003, kLeastOfSquares = 0.025;
  constexpr const char* kQuestion =
      "Are shape, size, light, camera, exposure and boundary those of the scene? No interval holds";
  const double noise = descent.noise_loss();
  const Structure& structure = descent.structure();
  const bool hangs_together = structure.is_misfit(block > 1 ? kLeastOfSquares : kLeast);
  const bool is_large =
      noise > 0 && descent.loss() - 4 * descent.loss_standard_error() > kMisfit * noise;
  if (is_large) {
    result.add_remarks(fmt::format(
        "the renders do not come as near to the image as its noise would let them: they differ by "
        "{:.2g} % where {:.2g} % is noise. {}",
        100 * std::sqrt(descent.loss()), 100 * std::sqrt(noise), kQuestion));
  }
  if (hangs_together) {
    result.add_remarks(fmt::format(
        "the differences of image and renders hang together: over neighbouring pixels {:.2g} % of "
        "the radiance is common to them, where noise has none. {}",
        100 * structure.relative(), kQuestion));
  }
  result.set_misfit(is_large || hangs_together);
  if (structure.is_known()) result.set_shared_difference(structure.relative());
  if (noise > 0 || result.misfit()) return;
  const std::string unsaid =
      "how noisy the image is nothing says, as an EXR's layer stderr.Y would";
  if (structure.is_known()) {
    result.add_remarks(fmt::format(
        "no misfit is seen: differences of image and renders hang together over pixels by "
        "no more than noise, or {:.2g} % of the radiance ({})",
        100 * (block > 1 ? kLeastOfSquares : kLeast), unsaid));
  } else {
    result.add_remarks(
        unsaid +
        ", and too few of its pixels count to see whether differences to the renders hang "
        "together: it was not tested whether shape, light, camera, exposure and encoding are those "
        "of the scene");
  }
}

}  // namespace

v1::RefineSettings with_defaults(v1::RefineSettings settings) {
  const bool adam = settings.method() == v1::RefineSettings::ADAM;
  if (settings.spp() == 0) settings.set_spp(64);
  if (settings.max_spp() == 0) settings.set_max_spp(std::max(4096U, settings.spp()));
  if (settings.max_iterations() == 0) settings.set_max_iterations(adam ? 150 : 40);
  if (!settings.has_tolerance()) settings.set_tolerance(0.002);
  if (settings.learning_rate() == 0) settings.set_learning_rate(0.05);
  if (settings.block() == 0) settings.set_block(1);
  return settings;
}

std::vector<Material> starts_around(const Material& start, size_t count) {
  // Korobov's lattice by powers of the root of x^4 = x + 1 (Roberts' generalised golden ratio).
  constexpr double kRoot = 1.2207440846057596;
  constexpr double kSpread = 3;
  std::vector<Material> starts{start};
  const Vector middle = coordinates_of(start);
  for (size_t i = 1; i < count; ++i) {
    Vector x = middle;
    for (size_t c = 0; c < 3; ++c) {
      const double place = 0.5 + static_cast<double>(i) / std::pow(kRoot, c + 1);
      x[c] += kSpread * (place - std::floor(place) - 0.5);
    }
    clamp_to_domain(x);
    starts.push_back(material_at(x));
  }
  return starts;
}

std::string digest_of(std::span<const Observation> observations) {
  std::string all;
  for (const Observation& o : observations) {
    for (const std::vector<float>* plane : {&o.radiance, &o.mask, &o.noise}) {
      all += sha256(to_bytes(*plane));
    }
    for (const std::vector<float>& plane : o.disturbances) all += sha256(to_bytes(plane));
    all += o.scene->digest;
  }
  return sha256(all);
}

Refinement::Refinement(v1::RefineSettings settings, std::span<const Observation> observations,
                       const std::vector<Material>& starts, double seconds_before)
    : settings_(with_defaults(std::move(settings))),
      observations_(observations),
      digest_(digest_of(observations)),
      seconds_before_(seconds_before) {
  check(settings_);
  check(observations_);
  layout_ = layout_of(settings_, observations_);
  if (starts.empty()) throw invalid_input("there is no material to start from");
  for (const Material& start : starts) {
    check_start(start);
    descents_.emplace_back(settings_, layout_, observations_, start);
  }
}

Refinement::Refinement(std::span<const Observation> observations, const v1::RefineState& state)
    : settings_(state.settings()),
      observations_(observations),
      digest_(digest_of(observations)),
      trajectory_(state.trajectory().begin(), state.trajectory().end()),
      seconds_before_(state.seconds_before()) {
  check(settings_);
  check(observations_);
  if (state.digest() != digest_) {
    throw invalid_input("the state is that of a refinement of other images or scenes");
  }
  layout_ = layout_of(settings_, observations_);
  if (state.starts().empty()) throw invalid_input("the state of the refinement is damaged");
  for (const v1::RefineStartState& start : state.starts()) {
    descents_.emplace_back(settings_, layout_, observations_, start);
  }
  keep_time_limit();
}

Refinement::~Refinement() = default;
Refinement::Refinement(Refinement&&) noexcept = default;

// The first of those whose loss is not above the least by more than noise.
size_t Refinement::best() const {
  const auto looked = [](const Descent& d) { return d.iterations() > 0; };
  size_t least = 0;
  for (size_t i = 1; i < descents_.size(); ++i) {
    if (looked(descents_[i]) && descents_[i].loss() < descents_[least].loss()) least = i;
  }
  const auto as_good = [&](const Descent& d) {
    const double noise =
        std::hypot(d.loss_standard_error(), descents_[least].loss_standard_error());
    return looked(d) && d.loss() - descents_[least].loss() <= kSameLoss * noise;
  };
  const auto first = std::ranges::find_if(descents_, as_good);
  return first == descents_.end() ? 0 : static_cast<size_t>(first - descents_.begin());
}

// The start that is to go on: none is left behind before all had their chance.
size_t Refinement::next() const {
  if (descents_.size() == 1) return 0;
  const auto waits = [](const Descent& d) {
    return d.end() == v1::RefineResult::UNFINISHED && d.iterations() < kScoutIterations;
  };
  const auto waiting = std::ranges::find_if(descents_, waits);
  if (waiting != descents_.end()) return static_cast<size_t>(waiting - descents_.begin());
  return best();
}

bool Refinement::finished() const {
  return descents_[next()].end() != v1::RefineResult::UNFINISHED;
}

const v1::RefineIteration& Refinement::step(const Renderer& renderer) {
  const double begin = clock_();
  const size_t start = next();
  Descent& descent = descents_[start];
  v1::RefineIteration iteration = descent.step(renderer, derive_seed(settings_.seed(), {start}));
  const double took = clock_() - begin;
  const double before = trajectory_.empty() ? seconds_before_ : trajectory_.back().seconds();
  iteration.set_start(static_cast<uint32_t>(start));
  iteration.set_seconds(before + took);
  trajectory_.push_back(iteration);
  keep_time_limit();
  return trajectory_.back();
}

// An iteration takes as long as the one before, times its samples over that one's. The next has as
// many samples as the time allows; too few of them would tell hardly more than is known.
void Refinement::keep_time_limit() {
  if (settings_.time_limit() == 0 || trajectory_.empty() || finished()) return;
  const v1::RefineIteration& last = trajectory_.back();
  const size_t count = trajectory_.size();
  const double took =
      last.seconds() - (count > 1 ? trajectory_[count - 2].seconds() : seconds_before_);
  const double left = settings_.time_limit() - last.seconds();
  const double affordable = took > 0 ? left / took * last.spp() : HUGE_VAL;
  Descent& descent = descents_[next()];
  if (affordable >= descent.spp()) return;
  if (affordable >= std::max(double{kMinSpp}, 0.5 * last.spp())) {
    descent.limit_spp(static_cast<uint32_t>(affordable));
    return;
  }
  for (Descent& each : descents_) {
    if (each.end() == v1::RefineResult::UNFINISHED) each.set_end(v1::RefineResult::TIME_LIMIT);
  }
}

size_t Refinement::colours() const {
  return layout_.colours;
}

Material Refinement::material(size_t colour) const {
  return descents_[best()].material(colour);
}

double Refinement::exposure() const {
  return descents_[best()].exposure();
}

std::vector<uint32_t> Refinement::unexplained_pixels(size_t observation) const {
  return descents_[best()].unexplained_pixels(observation);
}

RenderQuery Refinement::query(const Observation& observation, uint32_t spp, uint64_t seed) const {
  return query_of(observation, material(observation.colour), layout_.unknowns,
                  descents_[best()].unknowns(), spp, seed);
}

v1::RefineResult Refinement::result(size_t colour) const {
  if (trajectory_.empty()) throw Error(ErrorKind::kInternal, "no iteration was made");
  const size_t chosen = best();
  const Descent& descent = descents_[chosen];
  v1::RefineResult result = refine_result(descent.region(colour), colour);
  result.set_end(descent.end());
  result.set_iterations(descent.iterations());
  result.set_total_iterations(static_cast<uint32_t>(trajectory_.size()));
  result.set_best_start(static_cast<uint32_t>(chosen));
  result.set_loss(descent.loss());
  result.set_loss_standard_error(descent.loss_standard_error());
  result.set_noise_loss(descent.noise_loss());
  double cpu_seconds = 0;
  for (const v1::RefineIteration& iteration : trajectory_) cpu_seconds += iteration.cpu_seconds();
  result.set_cpu_seconds(cpu_seconds);
  result.set_seconds(trajectory_.back().seconds());
  const bool was_cut_short = descent.end() == v1::RefineResult::MAX_ITERATIONS ||
                             descent.end() == v1::RefineResult::TIME_LIMIT;
  // An answer of fewer is that of equations from far away.
  constexpr uint32_t kFewIterations = 4;
  if (was_cut_short && (descent.is_under_way() || descent.iterations() < kFewIterations)) {
    result.set_unfinished(true);
    result.add_remarks(
        "it was still on its way when it ended, and no interval holds: allow more "
        "iterations or time");
  }
  if (is_g_given(settings_)) {
    result.add_remarks("g was given, not found: sigma_t and albedo are those of that g");
  }
  add_misfit(descent, settings_.block(), result);
  if (result.misfit() && was_cut_short && !result.unfinished()) {
    result.add_remarks("it ended by its limit: with more iterations or time it may be no misfit");
  }
  add_remarks(result);
  add_few_squares(descent, result);
  add_unexplained(descent, result);
  return result;
}

v1::RefineState Refinement::state() const {
  v1::RefineState state;
  *state.mutable_settings() = settings_;
  state.set_digest(digest_);
  state.set_seconds_before(seconds_before_);
  for (const Descent& descent : descents_) *state.add_starts() = descent.state();
  state.mutable_trajectory()->Add(trajectory_.begin(), trajectory_.end());
  return state;
}

}  // namespace itn
