#include "client/refine/descent.h"

#include <algorithm>
#include <cmath>

#include "client/refine/answer.h"
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
// Steps along the similarity ridge, which change an image little, count less.
constexpr double kAlongRidge = 0.25;
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
// So often is the answer looked at with the most samples once it does not move any more.
constexpr uint32_t kMostLooks = 3;
// Samples grow at most by this factor from one iteration to the next.
constexpr double kMostGrowth = 16;

// The largest part, over ln sigma_t, albedo and g, of the variance that is noise of the renders.
double render_share(const Matrix& readable, const Matrix& all, const Matrix& renders) {
  const auto variances = [&](const Matrix& covariance) {
    return (readable * covariance * readable.transpose()).diagonal().head(3).array().eval();
  };
  return (variances(renders) / variances(all)).maxCoeff();
}

}  // namespace

// One render of each image, and what they say together.
struct Descent::Sight {
  std::vector<Evidence::Look> looks;
  Vector x;
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
    sight.x.conservativeResize(4);
    sight.x[3] = std::log(evidence_[0].exposure(syntheses[0]));
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
  Vector moved = Vector::Zero(sight.x.size());
  if (samples_ > 0) {
    moved = sight.x - anchor_;
    Vector counted = moved;
    counted[ScoreTest::kRidge] *= kAlongRidge;
    const double squared = counted.squaredNorm();
    memory = 1 / (1 + std::pow(squared / (kHalfMemory * kHalfMemory), 2));
    long_memory = 1 / (1 + squared / (kHalfInstruments * kHalfInstruments));
    equations_.gradient -= equations_.curvature * moved;
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

ScoreTest Descent::test() const {
  const Eigen::Index n = equations_.gradient.size();
  Matrix moments = Matrix::Zero(n + n * n, n + n * n);
  for (const Evidence& evidence : evidence_) moments += evidence.moments();
  return {equations_.curvature, equations_.gradient, moments};
}

// Of the noise of the renders alone.
ScoreTest Descent::render_test() const {
  const Eigen::Index n = equations_.gradient.size();
  Matrix moments = Matrix::Zero(n + n * n, n + n * n);
  for (const Evidence& evidence : evidence_) moments += evidence.moments();
  moments.topRows(n).setZero();
  moments.leftCols(n).setZero();
  moments.topLeftCorner(n, n) = equations_.render_noise;
  return {equations_.curvature, equations_.gradient, moments};
}

Region Descent::region() const {
  return region_about(x_, anchor_, test());
}

bool Descent::is_under_way() const {
  return test().statistic(x_ - anchor_) > static_cast<double>(x_.size());
}

Descent::Step Descent::newton_step() const {
  const ScoreTest all = test(), renders = render_test();
  const Vector best = all.best_step(trust_);
  const Vector nowhere = Vector::Zero(anchor_.size());
  const double length = best.norm();
  if (!std::isfinite(length)) return {.taken = nowhere};
  const auto per_coordinate = [&](double gain) {
    return std::sqrt(std::max(0.0, gain) / static_cast<double>(anchor_.size()));
  };
  return {
      .taken = best * std::min(1.0, trust_ / length),
      .over_noise = per_coordinate(renders.statistic(nowhere) - renders.statistic(best)),
      .over_uncertainty = per_coordinate(all.height(nowhere, trust_) - all.height(best, trust_))};
}

// Kingma and Ba, "Adam: a method for stochastic optimization", ICLR 2015.
Descent::Step Descent::adam_step(const Vector& gradient) {
  constexpr double kFirst = 0.9, kSecond = 0.999, kTiny = 1e-30;
  if (first_moment_.size() == 0) {
    first_moment_ = second_moment_ = Vector::Zero(gradient.size());
  }
  first_moment_ = kFirst * first_moment_ + (1 - kFirst) * gradient;
  second_moment_ = kSecond * second_moment_ + (1 - kSecond) * gradient.cwiseAbs2();
  const Vector mean = first_moment_ / (1 - std::pow(kFirst, iterations_));
  const Vector square = second_moment_ / (1 - std::pow(kSecond, iterations_));
  return {.taken = settings_.learning_rate() *
                   (mean.array() / (square.array().sqrt() + kTiny)).matrix()};
}

// Whether to go on, and with how many samples.
void Descent::plan(const Step& step, double deviation, double share) {
  if (iterations_ >= settings_.max_iterations()) end_ = v1::RefineResult::MAX_ITERATIONS;
  if (is_adam()) return;
  if (!std::isfinite(share)) {
    spp_ = std::min(2 * spp_, settings_.max_spp());
    return;
  }
  const bool is_there = step.over_noise <= kNoiseStep || step.over_uncertainty <= kSmallStep;
  if (is_there) {
    // Whatever the deviation is: one that is small by chance must not be what ends it.
    if (spp_ == settings_.max_spp() && ++looks_ == kMostLooks) end_ = v1::RefineResult::MAX_SPP;
    if (deviation <= settings_.tolerance()) end_ = v1::RefineResult::TOLERANCE;
    if (share <= kRenderShare) end_ = v1::RefineResult::NOISE_OF_IMAGE;
  }
  // Newton's method leaves about the square of a step: so few samples would see but noise of it.
  if (!is_there && step.over_noise * step.taken.norm() > kNoiseStep) return;
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
  x_ = anchor_ + step.taken;
  keep_inside(x_);
  told.set_step_over_noise(step.over_noise);
  const Eigen::Vector3d deviations = readable_deviations(region());
  for (const double deviation : deviations) told.add_standard_deviations(deviation);
  const double share =
      render_share(readable_jacobian(anchor_), test().covariance(), render_test().covariance());
  told.set_render_share(share);
  plan(step, deviations.maxCoeff(), share);
  return told;
}

// ---- State -----------------------------------------------------------------------------------

namespace {

using Numbers = google::protobuf::RepeatedField<double>;

Vector vector_of(const Numbers& numbers) {
  return Eigen::Map<const Vector>(numbers.data(), numbers.size());
}

// As many numbers as a square has.
Matrix square_of(const Numbers& numbers) {
  const auto side = static_cast<Eigen::Index>(std::lround(std::sqrt(numbers.size())));
  return Eigen::Map<const Matrix>(numbers.data(), side, side);
}

}  // namespace

v1::RefineStartState Descent::state() const {
  v1::RefineStartState state;
  const auto set = [](auto* to, const auto& from) { to->Add(from.begin(), from.end()); };
  set(state.mutable_coordinates(), x_);
  state.set_spp(spp_);
  state.set_iterations(iterations_);
  state.set_end(end_);
  state.set_trust(trust_);
  state.set_samples(samples_);
  state.set_looks(looks_);
  set(state.mutable_anchor(), anchor_);
  state.set_loss(loss_);
  state.set_loss_standard_error(loss_standard_error_);
  state.set_loss_of_noise(loss_of_noise_);
  for (const Evidence& evidence : evidence_) *state.add_images() = evidence.state();
  set(state.mutable_curvature(), equations_.curvature.reshaped<Eigen::RowMajor>());
  set(state.mutable_gradient(), equations_.gradient);
  set(state.mutable_render_noise(), equations_.render_noise.reshaped<Eigen::RowMajor>());
  set(state.mutable_first_moment(), first_moment_);
  set(state.mutable_second_moment(), second_moment_);
  return state;
}

Descent::Descent(const v1::RefineSettings& settings, std::span<const Observation> observations,
                 const v1::RefineStartState& state)
    : Descent(settings, observations, Material{}) {
  const int n = state.coordinates_size();
  const int seen = state.samples() > 0 ? n : 0;
  const bool fits = (n == 3 || (n == 4 && settings.unknown_exposure())) &&
                    state.images_size() == static_cast<int>(observations.size()) &&
                    state.anchor_size() == seen && state.gradient_size() == seen &&
                    state.curvature_size() == seen * seen &&
                    state.render_noise_size() == seen * seen &&
                    (state.first_moment_size() == 0 || state.first_moment_size() == n) &&
                    state.second_moment_size() == state.first_moment_size();
  if (!fits) throw invalid_input("the state of the refinement is damaged");
  x_ = vector_of(state.coordinates());
  anchor_ = vector_of(state.anchor());
  spp_ = state.spp();
  iterations_ = state.iterations();
  end_ = state.end();
  trust_ = state.trust();
  samples_ = state.samples();
  looks_ = state.looks();
  loss_ = state.loss();
  loss_standard_error_ = state.loss_standard_error();
  loss_of_noise_ = state.loss_of_noise();
  for (size_t i = 0; i < evidence_.size(); ++i) {
    evidence_[i].restore(state.images(static_cast<int>(i)), static_cast<size_t>(n));
  }
  equations_.curvature = square_of(state.curvature());
  equations_.gradient = vector_of(state.gradient());
  equations_.render_noise = square_of(state.render_noise());
  first_moment_ = vector_of(state.first_moment());
  second_moment_ = vector_of(state.second_moment());
}

}  // namespace itn
