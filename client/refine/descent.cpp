#include "client/refine/descent.h"

#include <algorithm>
#include <cmath>

#include "common/error.h"
#include "common/random.h"

namespace itn {
namespace {

constexpr double kMostTrust = 0.7;
// Evidence from this far away, in coordinates, counts half, and from farther away soon hardly, as
// the equations are linear.
constexpr double kHalfMemory = 0.05;
// Likewise of instruments, which need not be exact.
constexpr double kHalfInstruments = 0.4;
// Of the variance of the answer, the part that noise of the renders may be at the end: it widens
// the intervals by a twentieth.
constexpr double kRenderShare = 0.1;
// A step of nothing but noise is shorter than this, over its noise, in 95 of 100 cases (by
// chi-squared of 3 or 4 degrees of freedom).
constexpr double kNoiseStep = 1.6;
// A step this small beside the uncertainty of the answer does not matter.
constexpr double kSmallStep = 0.2;
// A loss that rose by more standard errors than this did rise.
constexpr double kRise = 4;
// An answer with larger standard deviations, of ln sigma_t, albedo or g, may come from equations
// that are singular but for noise: it is given so many times the samples before it is taken.
constexpr double kPoor = 0.25, kPatience = 3;
// Samples grow at most by this factor from one iteration to the next.
constexpr double kMostGrowth = 16;

double squared_length(std::span<const double> v) {
  double sum = 0;
  for (const double x : v) sum += x * x;
  return sum;
}

bool is_finite(const SmallMatrix& matrix) {
  return std::ranges::all_of(matrix.values(), [](double v) { return std::isfinite(v); });
}

// The largest part, over ln sigma_t, albedo and g, of the variance that is noise of the renders.
double render_share(const SmallMatrix& all, const SmallMatrix& renders) {
  double share = 0;
  for (size_t i = 0; i < 3; ++i) share = std::max(share, renders(i, i) / all(i, i));
  return share;
}

double largest_deviation(const SmallMatrix& readable) {
  double largest = 0;
  for (size_t i = 0; i < 3; ++i) largest = std::max(largest, std::sqrt(readable(i, i)));
  return largest;
}

}  // namespace

// One render of each image, and what they say together.
struct Descent::Sight {
  std::vector<Evidence::Look> looks;
  std::vector<double> x;
  Equations equations;
  double loss = 0, loss_standard_error = 0, loss_of_noise = 0;
  double cpu_seconds = 0;
};

Descent::Descent(const v1::RefineSettings& settings, std::span<const Observation> observations,
                 const Material& start)
    : settings_(settings),
      observations_(observations),
      x_(coordinates_of(start)),
      trust_(kMostTrust),
      spp_(settings.spp()) {
  for (const Observation& observation : observations) {
    evidence_.emplace_back(observation, settings.weights());
  }
}

Descent::Sight Descent::look(const Synthesize& synthesize, uint64_t seed) {
  std::vector<SynthesisQuery> queries;
  for (size_t i = 0; i < observations_.size(); ++i) {
    queries.push_back({.observation = &observations_[i],
                       .material = material_at(x_),
                       .spp = spp_,
                       .seed = derive_seed(seed, {iterations_, i})});
  }
  const std::vector<Synthesis> syntheses = synthesize(queries);
  Sight sight;
  sight.x = x_;
  if (settings_.unknown_exposure() && x_.size() == 3) {
    sight.x.push_back(std::log(evidence_[0].exposure(syntheses[0])));
  }
  sight.equations = Equations(sight.x.size());
  double squares = 0, variance = 0, energy = 0, noise = 0;
  for (size_t i = 0; i < syntheses.size(); ++i) {
    const Evidence::Look& look = sight.looks.emplace_back(
        evidence_[i].look(syntheses[i], spp_, viewpoint_at(sight.x), is_adam()));
    add(look.equations, 1, sight.equations);
    squares += look.squares;
    variance += look.squares_variance;
    energy += look.energy;
    noise += look.noise;
    sight.cpu_seconds += syntheses[i].cpu_seconds;
  }
  sight.loss = squares / energy;
  sight.loss_standard_error = std::sqrt(variance) / energy;
  sight.loss_of_noise = noise / energy;
  return sight;
}

void Descent::take(const Sight& sight) {
  // What was seen from the last place, as it is seen from here.
  double memory = 0, long_memory = 0;
  std::vector<double> moved(sight.x.size());
  if (samples_ > 0) {
    moved = sight.x;
    for (size_t c = 0; c < moved.size(); ++c) moved[c] -= anchor_[c];
    memory = 1 / (1 + std::pow(squared_length(moved) / (kHalfMemory * kHalfMemory), 2));
    long_memory = 1 / (1 + squared_length(moved) / (kHalfInstruments * kHalfInstruments));
    const std::vector<double> bent = equations_.curvature * moved;
    for (size_t c = 0; c < moved.size(); ++c) equations_.gradient[c] -= bent[c];
  } else {
    equations_ = Equations(sight.x.size());
  }
  equations_ = scaled(equations_, memory);
  add(sight.equations, spp_, equations_);
  samples_ = memory * samples_ + spp_;
  for (size_t i = 0; i < evidence_.size(); ++i)
    evidence_[i].take(sight.looks[i], moved, memory, long_memory);
  anchor_ = sight.x;
  loss_ = sight.loss;
  loss_standard_error_ = sight.loss_standard_error;
  loss_of_noise_ = sight.loss_of_noise;
}

SmallMatrix Descent::covariance() const {
  const SmallMatrix back = inverse(equations_.curvature);
  const std::vector<double> step = back * equations_.gradient;
  SmallMatrix scores(step.size());
  for (const Evidence& evidence : evidence_) scores += evidence.score_covariance(step);
  return sandwich(back, scores);
}

bool Descent::is_under_way() const {
  const std::vector<double> step = inverse(equations_.curvature) * equations_.gradient;
  const double squared = quadratic_form(inverse(covariance()), step);
  return squared > static_cast<double>(step.size());
}

SmallMatrix Descent::render_covariance() const {
  return sandwich(inverse(equations_.curvature), equations_.render_noise);
}

Descent::Step Descent::newton_step() const {
  Step step;
  const SmallMatrix noise = render_covariance();
  step.full = inverse(equations_.curvature) * equations_.gradient;
  const size_t n = step.full.size();
  step.over_noise = std::sqrt(quadratic_form(inverse(noise), step.full) / static_cast<double>(n));
  SmallMatrix spread = noise;
  for (size_t c = 0; c < n; ++c) spread(c, c) += trust_ * trust_;
  step.taken = inverse(spread) * step.full;
  for (double& t : step.taken) t *= trust_ * trust_;
  const double length = std::sqrt(squared_length(step.taken));
  if (!std::isfinite(length)) {
    step.taken.assign(n, 0);
    step.over_noise = 0;
  } else if (length > trust_) {
    for (double& t : step.taken) t *= trust_ / length;
  }
  return step;
}

// Kingma and Ba, "Adam: a method for stochastic optimization", ICLR 2015.
Descent::Step Descent::adam_step(std::span<const double> gradient) {
  constexpr double kFirst = 0.9, kSecond = 0.999, kTiny = 1e-30;
  const size_t n = gradient.size();
  first_moment_.resize(n);
  second_moment_.resize(n);
  Step step{.full = std::vector<double>(n), .taken = {}};
  for (size_t c = 0; c < n; ++c) {
    first_moment_[c] = kFirst * first_moment_[c] + (1 - kFirst) * gradient[c];
    second_moment_[c] = kSecond * second_moment_[c] + (1 - kSecond) * gradient[c] * gradient[c];
    const double mean = first_moment_[c] / (1 - std::pow(kFirst, iterations_));
    const double square = second_moment_[c] / (1 - std::pow(kSecond, iterations_));
    step.full[c] = settings_.learning_rate() * mean / (std::sqrt(square) + kTiny);
  }
  step.taken = step.full;
  return step;
}

// Whether to go on, and with how many samples.
void Descent::plan(const Step& step) {
  if (iterations_ >= settings_.max_iterations()) end_ = v1::RefineResult::MAX_ITERATIONS;
  if (is_adam()) return;
  const SmallMatrix jacobian = readable_jacobian(anchor_);
  const SmallMatrix renders = sandwich(jacobian, render_covariance());
  const SmallMatrix all = sandwich(jacobian, covariance());
  if (!is_finite(all) || !is_finite(renders)) {
    spp_ = std::min(2 * spp_, settings_.max_spp());
    return;
  }
  const double uncertain = std::sqrt(quadratic_form(inverse(covariance()), step.full) /
                                     static_cast<double>(step.full.size()));
  if (step.over_noise > kNoiseStep && uncertain > kSmallStep) return;
  const double share = render_share(all, renders);
  const double deviation = largest_deviation(all);
  const bool poor = !(deviation <= kPoor);
  if (samples_ >= (poor ? kPatience : 1) * settings_.max_spp()) {
    end_ = v1::RefineResult::MAX_SPP;
  }
  if (!poor && deviation <= settings_.tolerance()) end_ = v1::RefineResult::TOLERANCE;
  if (!poor && share <= kRenderShare) end_ = v1::RefineResult::NOISE_OF_IMAGE;
  // Samples that are missing, if the variance falls with their number.
  const double wanted = samples_ * share / ((1 - std::min(share, 0.99)) * kRenderShare);
  const double growth = std::clamp((wanted - samples_) / spp_, 2.0, kMostGrowth);
  spp_ = static_cast<uint32_t>(std::min<double>(growth * spp_, settings_.max_spp()));
}

v1::RefineIteration Descent::step(const Synthesize& synthesize, uint64_t seed) {
  const Sight sight = look(synthesize, seed);
  ++iterations_;
  v1::RefineIteration told;
  told.set_iteration(iterations_);
  const Material material = material_at(sight.x);
  told.mutable_material()->set_sigma_t(material.sigma_t);
  told.mutable_material()->set_albedo(material.albedo);
  told.mutable_material()->set_g(material.g);
  told.set_exposure(exposure_at(sight.x));
  told.set_spp(spp_);
  told.set_loss(sight.loss);
  told.set_loss_standard_error(sight.loss_standard_error);
  told.set_cpu_seconds(sight.cpu_seconds);

  const bool rose =
      samples_ > 0 &&
      sight.loss - loss_ > kRise * std::hypot(sight.loss_standard_error, loss_standard_error_);
  told.set_rejected(rose && !is_adam());
  if (told.rejected()) {
    trust_ /= 4;
  } else {
    take(sight);
    trust_ = std::min(2 * trust_, kMostTrust);
  }
  const Step step = is_adam() ? adam_step(sight.equations.gradient) : newton_step();
  x_ = anchor_;
  for (size_t c = 0; c < x_.size(); ++c) x_[c] += step.taken[c];
  keep_inside(x_);
  told.set_step_over_noise(step.over_noise);
  const SmallMatrix jacobian = readable_jacobian(anchor_);
  const SmallMatrix all = sandwich(jacobian, covariance());
  const SmallMatrix renders = sandwich(jacobian, render_covariance());
  for (size_t i = 0; i < 3; ++i) {
    told.add_standard_deviations(std::sqrt(all(i, i)));
    told.add_render_standard_deviations(std::sqrt(renders(i, i)));
  }
  plan(step);
  return told;
}

// ---- State -----------------------------------------------------------------------------------

v1::RefineStartState Descent::state() const {
  v1::RefineStartState state;
  const auto set = [](auto* to, const auto& from) { to->Add(from.begin(), from.end()); };
  set(state.mutable_coordinates(), x_);
  state.set_spp(spp_);
  state.set_iterations(iterations_);
  state.set_end(end_);
  state.set_trust(trust_);
  state.set_samples(samples_);
  set(state.mutable_anchor(), anchor_);
  state.set_loss(loss_);
  state.set_loss_standard_error(loss_standard_error_);
  state.set_loss_of_noise(loss_of_noise_);
  for (const Evidence& evidence : evidence_) *state.add_images() = evidence.state();
  set(state.mutable_curvature(), equations_.curvature.values());
  set(state.mutable_gradient(), equations_.gradient);
  set(state.mutable_render_noise(), equations_.render_noise.values());
  set(state.mutable_first_moment(), first_moment_);
  set(state.mutable_second_moment(), second_moment_);
  return state;
}

Descent::Descent(const v1::RefineSettings& settings, std::span<const Observation> observations,
                 const v1::RefineStartState& state)
    : Descent(settings, observations, Material{}) {
  const auto n = static_cast<size_t>(state.coordinates_size());
  const size_t seen = state.samples() > 0 ? n : 0;
  const bool fits = (n == 3 || (n == 4 && settings.unknown_exposure())) &&
                    state.images_size() == static_cast<int>(observations.size()) &&
                    state.anchor_size() == static_cast<int>(seen) &&
                    state.gradient_size() == static_cast<int>(seen) &&
                    state.curvature_size() == static_cast<int>(seen * seen) &&
                    state.render_noise_size() == static_cast<int>(seen * seen);
  if (!fits) throw invalid_input("the state of the refinement is damaged");
  x_.assign(state.coordinates().begin(), state.coordinates().end());
  anchor_.assign(state.anchor().begin(), state.anchor().end());
  spp_ = state.spp();
  iterations_ = state.iterations();
  end_ = state.end();
  trust_ = state.trust();
  samples_ = state.samples();
  loss_ = state.loss();
  loss_standard_error_ = state.loss_standard_error();
  loss_of_noise_ = state.loss_of_noise();
  for (size_t i = 0; i < evidence_.size(); ++i) {
    evidence_[i].restore(state.images(static_cast<int>(i)), n);
  }
  equations_.curvature =
      SmallMatrix::of(std::vector<double>(state.curvature().begin(), state.curvature().end()));
  equations_.gradient.assign(state.gradient().begin(), state.gradient().end());
  equations_.render_noise = SmallMatrix::of(
      std::vector<double>(state.render_noise().begin(), state.render_noise().end()));
  first_moment_.assign(state.first_moment().begin(), state.first_moment().end());
  second_moment_.assign(state.second_moment().begin(), state.second_moment().end());
}

}  // namespace itn
