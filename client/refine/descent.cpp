#include "client/refine/descent.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "client/refine/refine_result.h"
#include "common/error.h"
#include "common/random.h"

namespace itn {
namespace {

constexpr double kMaxTrust = 0.7;
// ImageEquations from this far away, in coordinates, counts half, and from farther away soon
// hardly, as the equations are linear.
constexpr double kHalfMemory = 0.05;
// The same of instruments, which need not be exact.
constexpr double kHalfInstruments = 0.4;
// Steps along the similarity ridge, which change an image little, count less.
constexpr double kAlongRidge = 0.25;
// Noise of the renders may be this part of the answer's variance at the end: it widens the
// intervals by a twentieth.
constexpr double kRenderShare = 0.1;
// A step of nothing but noise is shorter than this, over its noise, in 95 of 100 cases (by
// chi-squared of 3 or 4 degrees of freedom).
constexpr double kNoiseStep = 1.6;
// A step this small beside the uncertainty of the answer does not matter.
constexpr double kSmallStep = 0.2;
// A loss that rose by more standard errors than this did rise.
constexpr double kRise = 4;
// So often is the answer looked at with the most samples once it does not move any more.
constexpr uint32_t kMaxLooks = 3;
// So many times the first iteration's samples are about one place when it is near the answer.
constexpr double kSettled = 8;
// Samples grow at most by this factor from one iteration to the next.
constexpr double kMaxGrowth = 16;

// The largest part, over ln sigma_t, albedo and, if that is found, g, of the variance that is noise
// of the renders.
double render_noise_fraction(const Matrix& readable, const Matrix& all, const Matrix& renders,
                             bool finds_g) {
  const auto variances = [&](const Matrix& covariance) {
    return (readable * covariance * readable.transpose())
        .diagonal()
        .head(finds_g ? 3 : 2)
        .array()
        .eval();
  };
  return (variances(renders) / variances(all)).maxCoeff();
}

v1::Material to_message(const Material& material) {
  v1::Material message;
  message.set_sigma_t(material.sigma_t);
  message.set_albedo(material.albedo);
  message.set_g(material.g);
  return message;
}

}  // namespace

bool is_g_given(const v1::RefineSettings& settings) {
  constexpr double kGiven = 0.01;
  const auto known = settings.known_within().find(kKnownG);
  return known != settings.known_within().end() && known->second < kGiven;
}

// One render of each image, and what they say together.
struct Descent::Evaluation {
  std::vector<ImageEquations::Residuals> per_image;
  Vector x;
  NormalEquations equations;
  double loss = 0, loss_standard_error = 0, noise_loss = 0;
  Structure structure;
  double cpu_seconds = 0;
};

Descent::Descent(const v1::RefineSettings& settings, Layout layout,
                 std::span<const Observation> observations, const Material& start)
    : settings_(settings),
      layout_(std::move(layout)),
      seen_(layout_.one_colour()),
      observations_(observations),
      x_(Vector::Zero(layout_.size())),
      trust_radius_(kMaxTrust),
      spp_(settings.spp()) {
  for (size_t colour = 0; colour < layout_.colours; ++colour) {
    x_(layout_.of_colour(colour)) = coordinates_of(start, seen_);
  }
  for (const Observation& observation : observations) {
    image_equations_.emplace_back(observation, settings.weights(), settings.block());
  }
}

Descent::Evaluation Descent::evaluate(const Renderer& renderer, uint64_t seed) {
  std::vector<RenderQuery> queries;
  for (size_t i = 0; i < observations_.size(); ++i) {
    queries.push_back(query_of(observations_[i], material(observations_[i].colour),
                               layout_.unknowns, unknowns(), spp_,
                               derive_seed(seed, {iterations_, i})));
  }
  const std::vector<Render> renders = renderer(queries);
  Evaluation evaluation;
  evaluation.x = x_;
  const bool is_first = samples_ == 0 && iterations_ == 0;
  if (is_first && layout_.has_exposure && !settings_.known_within().contains(kExposure)) {
    double& exposure = evaluation.x[layout_.exposure()];
    exposure = 0;
    for (size_t i = 0; i < renders.size(); ++i) {
      exposure +=
          std::log(image_equations_[i].exposure(renders[i])) / static_cast<double>(renders.size());
    }
  }
  evaluation.equations = NormalEquations(evaluation.x.size());
  double squares = 0, variance = 0, energy = 0, noise = 0;
  for (size_t i = 0; i < renders.size(); ++i) {
    const size_t colour = observations_[i].colour;
    const ImageEquations::Residuals& residuals =
        evaluation.per_image.emplace_back(image_equations_[i].evaluate(
            renders[i], spp_, linearize(seen_in(evaluation.x, colour), seen_), is_adam()));
    evaluation.equations.add(residuals.equations, layout_.of_colour(colour));
    squares += residuals.squares;
    variance += residuals.squares_variance;
    energy += residuals.energy;
    noise += residuals.noise;
    evaluation.structure += residuals.structure;
    evaluation.cpu_seconds += renders[i].cpu_seconds;
  }
  evaluation.loss = squares / energy;
  evaluation.loss_standard_error = std::sqrt(variance) / energy;
  evaluation.noise_loss = noise / energy;
  return evaluation;
}

void Descent::accumulate(const Evaluation& evaluation) {
  // What was seen from the last place, as it is seen from here.
  double decay = 0, long_decay = 0;
  Vector moved = Vector::Zero(evaluation.x.size());
  if (samples_ > 0) {
    moved = evaluation.x - linearization_point_;
    Vector counted = moved;
    for (const Eigen::Index g : layout_.all_g()) counted[g] *= kAlongRidge;
    const double squared = counted.squaredNorm();
    decay = 1 / (1 + std::pow(squared / (kHalfMemory * kHalfMemory), 2));
    long_decay = 1 / (1 + squared / (kHalfInstruments * kHalfInstruments));
    normal_equations_.gradient -= normal_equations_.curvature * moved;
  } else {
    normal_equations_ = NormalEquations(evaluation.x.size());
  }
  normal_equations_ = scaled(normal_equations_, decay);
  normal_equations_ += scaled(evaluation.equations, spp_);
  samples_ = decay * samples_ + spp_;
  for (size_t i = 0; i < image_equations_.size(); ++i) {
    image_equations_[i].accumulate(evaluation.per_image[i], seen_in(moved, observations_[i].colour),
                                   decay, long_decay);
  }
  collect_sums();
  linearization_point_ = evaluation.x;
  loss_ = evaluation.loss;
  loss_standard_error_ = evaluation.loss_standard_error;
  noise_loss_ = evaluation.noise_loss;
  structure_ = evaluation.structure;
}

void Descent::collect_sums() {
  unexplained_ = NormalEquations(layout_.size());
  // Before, a material that is far off would make what tells most of it look unexplained.
  const bool is_near = !is_adam() && samples_ >= kSettled * settings_.spp();
  for (size_t i = 0; i < image_equations_.size() && is_near; ++i) {
    image_equations_[i].find_unexplained();
    unexplained_.add(image_equations_[i].unexplained_terms(),
                     layout_.of_colour(observations_[i].colour));
  }
  collect_moments();
  collect_model_error();
}

// A photograph that differs from renders of the truth, as by its shape, does so in all its colours:
// a square has one term of all of them.
void Descent::collect_moments() {
  std::map<size_t, std::vector<size_t>> photographs;
  for (size_t i = 0; i < observations_.size(); ++i) {
    photographs[observations_[i].photograph].push_back(i);
  }
  moments_.clear();
  squares_ = 0;
  for (const auto& [photograph, images] : photographs) {
    squares_ += static_cast<double>(add_moments(images));
  }
  // Scores at the answer scatter less than at the truth, by as many squares as there are numbers
  // that images of a colour are of (MacKinnon and White, "Some heteroskedasticity-consistent
  // covariance matrix estimators with improved finite sample properties", Journal of Econometrics
  // 1985, HC1).
  const double left = std::max(squares_ - numbers(), 1.0);
  for (ScoreMoments& moments : moments_) moments.sums *= std::max(squares_ / left, 1.0);
}

// Adds the moments of one photograph, and returns the number of its squares.
Eigen::Index Descent::add_moments(std::span<const size_t> images) {
  ScoreMoments& moments = moments_.emplace_back();
  // The place of each coordinate that the photograph tells of, or none.
  std::vector<std::optional<Eigen::Index>> places(static_cast<size_t>(layout_.size()));
  for (Eigen::Index c = 0; c < layout_.size(); ++c) {
    if (std::ranges::none_of(images, [&](size_t i) { return tells(i, c); })) continue;
    places[static_cast<size_t>(c)] = std::ssize(moments.coordinates);
    moments.coordinates.push_back(c);
  }
  std::map<std::pair<uint32_t, uint32_t>, Eigen::Index> rows;
  for (const size_t i : images) {
    for (const auto& square : image_equations_[i].squares()) rows.emplace(square, std::ssize(rows));
  }
  const auto n = std::ssize(moments.coordinates);
  Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(std::ssize(rows), n + n * n);
  for (const size_t image : images) {
    std::vector<Eigen::Index> rows_of_image;
    for (const auto& square : image_equations_[image].squares()) {
      rows_of_image.push_back(rows.at(square));
    }
    const Eigen::MatrixXd terms = image_equations_[image].square_terms();
    const std::vector<Eigen::Index> coordinates = layout_.of_colour(observations_[image].colour);
    const auto count = std::ssize(coordinates);
    // What hangs together over more than a square counts as so many squares that are alike.
    const double alike = std::sqrt(image_equations_[image].dependence());
    const auto add = [&](Eigen::Index from, Eigen::Index to) {
      for (Eigen::Index square = 0; square < terms.rows(); ++square) {
        sums(rows_of_image[static_cast<size_t>(square)], to) += alike * terms(square, from);
      }
    };
    for (Eigen::Index c = 0; c < count; ++c) {
      const auto row = places[static_cast<size_t>(coordinates[static_cast<size_t>(c)])];
      if (!row) continue;
      add(c, *row);
      for (Eigen::Index d = 0; d < count; ++d) {
        const auto column = places[static_cast<size_t>(coordinates[static_cast<size_t>(d)])];
        if (column) add(count + c * count + d, n + *row * n + *column);
      }
    }
  }
  moments.sums = Matrix::Zero(sums.cols(), sums.cols());
  moments.sums.selfadjointView<Eigen::Lower>().rankUpdate(sums.transpose());
  moments.sums.triangularView<Eigen::StrictlyUpper>() = moments.sums.transpose();
  return std::ssize(rows);
}

bool Descent::tells(size_t image, Eigen::Index coordinate) const {
  const std::vector<Eigen::Index> seen = layout_.of_colour(observations_[image].colour);
  if (std::ranges::find(seen, coordinate) == seen.end()) return false;
  const Eigen::Index disturbance = coordinate - layout_.disturbance(0);
  return disturbance < 0 ||
         !observations_[image].disturbances[static_cast<size_t>(disturbance)].empty();
}

void Descent::collect_model_error() {
  model_error_ = {};
  if (settings_.model_error() == 0 || !layout_.has_exposure) return;
  const auto side = std::max(1U, static_cast<uint32_t>(settings_.model_error_length() / 2));
  std::map<size_t, GrowthBySquare> photographs;
  for (size_t i = 0; i < image_equations_.size(); ++i) {
    const std::vector<Eigen::Index> coordinates = layout_.of_colour(observations_[i].colour);
    GrowthBySquare& squares = photographs[observations_[i].photograph];
    for (const auto& [place, growth] : image_equations_[i].growth(side, seen_.exposure())) {
      SquareGrowth& square = squares[place];
      if (square.pixels == 0) square.scores = Vector::Zero(layout_.size());
      square.scores(coordinates) += growth.scores;
      square.x += growth.x;
      square.y += growth.y;
      square.pixels += growth.pixels;
    }
  }
  model_error_ = Matrix::Zero(layout_.size(), layout_.size());
  for (const auto& [photograph, squares] : photographs) {
    model_error_ += model_error(squares, settings_.model_error(), settings_.model_error_length());
  }
}

// What the images alone say.
ScoreEquations Descent::score_equations(size_t colour) const {
  return {.gradient = normal_equations_.gradient - unexplained_.gradient,
          .curvature = normal_equations_.curvature - unexplained_.curvature,
          .moments = moments_,
          .apart = model_error_,
          .ridge = is_g_given(settings_) ? layout_.sigma_t(colour) : layout_.g(colour)};
}

// From where the equations are.
std::vector<KnownStep> Descent::known_steps() const {
  std::vector<KnownStep> known;
  const auto add = [&](Eigen::Index i, double place, double deviation) {
    known.push_back({i, place - linearization_point_[i], deviation});
  };
  for (size_t i = 0; i < layout_.unknowns.size(); ++i) {
    const auto& [name, start, range, deviation] = layout_.unknowns[i];
    if (deviation) add(layout_.unknown(i), range.to(start), *deviation / range.slope(start));
  }
  const auto& known_within = settings_.known_within();
  if (known_within.contains(kExposure)) add(layout_.exposure(), 0, known_within.at(kExposure));
  if (known_within.contains(kKnownG)) {
    const Vector expected = coordinates_of({1, 0.5, settings_.expected_g()});
    constexpr Eigen::Index kOfG = 2;
    for (const Eigen::Index g : layout_.all_g()) {
      add(g, expected[kOfG], known_within.at(kKnownG) / linearize(expected).jacobian(kOfG, kOfG));
    }
  }
  for (size_t i = 0; i < layout_.disturbances; ++i) add(layout_.disturbance(i), 0, 1);
  return known;
}

ScoreTest Descent::test(size_t colour) const {
  ScoreEquations equations = score_equations(colour);
  equations.known = known_steps();
  return ScoreTest(equations);
}

// The test that knows the noise of the renders alone.
ScoreTest Descent::render_test() const {
  ScoreEquations equations = score_equations(0);
  for (ScoreMoments& moments : equations.moments) {
    const auto n = static_cast<Eigen::Index>(moments.coordinates.size());
    moments.sums.topRows(n).setZero();
    moments.sums.leftCols(n).setZero();
  }
  equations.apart = normal_equations_.render_noise;
  return ScoreTest(equations);
}

double Descent::unexplained_part() const {
  double unexplained = 0, pixels = 0;
  for (const ImageEquations& equations : image_equations_) {
    unexplained += static_cast<double>(equations.unexplained_pixels().size());
    pixels += static_cast<double>(equations.pixels());
  }
  return pixels > 0 ? unexplained / pixels : 0;
}

Region Descent::region(size_t colour) const {
  return region_about(x_, linearization_point_, test(colour), layout_);
}

bool Descent::is_under_way() const {
  // The equations are linear: from farther away than kNear they lead about there. What is uncertain
  // by more than that moves as far by noise of the renders, and its interval is as wide; beyond
  // kFar nothing is believed, nor where a deviation is no number.
  constexpr double kNear = 0.2, kFar = 1;
  const ScoreTest all = test(0);
  const Vector deviations = all.covariance().diagonal().cwiseSqrt();
  const Vector moved = (x_ - linearization_point_).cwiseAbs();
  for (Eigen::Index i = 0; i < layout_.g(0); ++i) {
    if (!(moved[i] <= std::clamp(deviations[i], kNear, kFar))) return true;
  }
  const double least = all.statistic(all.full_step());
  return all.statistic(x_ - linearization_point_) - least > static_cast<double>(x_.size());
}

Descent::Step Descent::newton_step() const {
  // The search goes along the ridge of the first colour, as steps are damped in all of them.
  const ScoreTest all = test(0), renders = render_test();
  const Vector best = all.best_step(trust_radius_);
  const Vector nowhere = Vector::Zero(linearization_point_.size());
  const double length = best.norm();
  if (!std::isfinite(length)) return {.taken = nowhere};
  const auto per_coordinate = [&](double gain) {
    return std::sqrt(std::max(0.0, gain) / static_cast<double>(linearization_point_.size()));
  };
  return {.taken = best * std::min(1.0, trust_radius_ / length),
          .over_noise = per_coordinate(renders.statistic(nowhere) - renders.statistic(best)),
          .over_uncertainty =
              per_coordinate(all.height(nowhere, trust_radius_) - all.height(best, trust_radius_))};
}

// Kingma and Ba, "Adam: a method for stochastic optimization", ICLR 2015.
Descent::Step Descent::adam_step(const Vector& gradient) {
  constexpr double kFirst = 0.9, kSecond = 0.999, kTiny = 1e-30;
  if (first_moment_.size() == 0) first_moment_ = second_moment_ = Vector::Zero(gradient.size());
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
    if (spp_ == settings_.max_spp() && ++renders_at_max_spp_ == kMaxLooks)
      end_ = v1::RefineResult::MAX_SPP;
    if (deviation <= settings_.tolerance()) end_ = v1::RefineResult::TOLERANCE;
    if (share <= kRenderShare) end_ = v1::RefineResult::NOISE_OF_IMAGE;
  }
  // Newton's method leaves about the square of a step: so few samples would see but noise of it.
  if (!is_there && step.over_noise * step.taken.norm() > kNoiseStep) return;
  // Samples that are missing, if the variance falls with their number.
  const double wanted = samples_ * share / ((1 - std::min(share, 0.99)) * kRenderShare);
  const double growth = std::clamp((wanted - samples_) / spp_, 2.0, kMaxGrowth);
  spp_ = static_cast<uint32_t>(std::min<double>(growth * spp_, settings_.max_spp()));
}

v1::RefineIteration Descent::step(const Renderer& renderer, uint64_t seed) {
  const Evaluation evaluation = evaluate(renderer, seed);
  ++iterations_;
  v1::RefineIteration iteration;
  iteration.set_iteration(iterations_);
  for (size_t colour = 0; colour < layout_.colours; ++colour) {
    *iteration.add_materials() = to_message(material_at(seen_in(evaluation.x, colour)));
  }
  const Vector first = seen_in(evaluation.x, 0);
  iteration.set_exposure(exposure_at(first, seen_));
  for (const double value : unknowns_at(first, seen_)) iteration.add_unknowns(value);
  iteration.set_spp(spp_);
  iteration.set_loss(evaluation.loss);
  iteration.set_loss_standard_error(evaluation.loss_standard_error);
  iteration.set_cpu_seconds(evaluation.cpu_seconds);

  const bool rose =
      samples_ > 0 && evaluation.loss - loss_ >
                          kRise * std::hypot(evaluation.loss_standard_error, loss_standard_error_);
  iteration.set_rejected(rose && !is_adam());
  if (iteration.rejected()) {
    trust_radius_ /= 4;
  } else {
    accumulate(evaluation);
    trust_radius_ = std::min(2 * trust_radius_, kMaxTrust);
  }
  const Step step = is_adam() ? adam_step(evaluation.equations.gradient) : newton_step();
  x_ = linearization_point_ + step.taken;
  clamp_to_domain(x_, layout_);
  iteration.set_step_to_noise(step.over_noise);
  double deviation = 0, share = 0;
  const ScoreTest found = test(0);
  const Matrix all = found.covariance(), renders = found.covariance_of(render_test());
  for (size_t colour = 0; colour < layout_.colours; ++colour) {
    for (const double one : physical_deviations(region(colour), colour)) {
      iteration.add_standard_deviations(one);
      deviation = std::max(deviation, one);
    }
    const std::vector<Eigen::Index> seen = layout_.of_colour(colour);
    const double of_colour =
        render_noise_fraction(physical_jacobian(seen_in(linearization_point_, colour), seen_),
                              all(seen, seen), renders(seen, seen), !is_g_given(settings_));
    // One that is not known, as H is singular, stays so.
    if (std::isfinite(share) && !(of_colour <= share)) share = of_colour;
  }
  iteration.set_render_noise_fraction(share);
  plan(step, deviation, share);
  return iteration;
}

// ---- State -----------------------------------------------------------------------------------

namespace {

using Numbers = google::protobuf::RepeatedField<double>;

Vector vector_of(const Numbers& numbers) {
  return Eigen::Map<const Vector>(numbers.data(), numbers.size());
}

// A square matrix of so many numbers.
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
  state.set_trust_radius(trust_radius_);
  state.set_samples(samples_);
  state.set_renders_at_max_spp(renders_at_max_spp_);
  set(state.mutable_linearization_point(), linearization_point_);
  state.set_loss(loss_);
  state.set_loss_standard_error(loss_standard_error_);
  state.set_noise_loss(noise_loss_);
  state.mutable_structure()->set_of_quarters(structure_.of_quarters);
  state.mutable_structure()->set_of_blocks(structure_.of_blocks);
  state.mutable_structure()->set_shared(structure_.shared);
  state.mutable_structure()->set_of_image(structure_.of_image);
  state.mutable_structure()->set_blocks(structure_.blocks);
  for (const ImageEquations& image_equations : image_equations_)
    *state.add_images() = image_equations.state();
  set(state.mutable_curvature(), normal_equations_.curvature.reshaped<Eigen::RowMajor>());
  set(state.mutable_gradient(), normal_equations_.gradient);
  set(state.mutable_render_noise(), normal_equations_.render_noise.reshaped<Eigen::RowMajor>());
  set(state.mutable_first_moment(), first_moment_);
  set(state.mutable_second_moment(), second_moment_);
  return state;
}

Descent::Descent(const v1::RefineSettings& settings, Layout layout,
                 std::span<const Observation> observations, const v1::RefineStartState& state)
    : Descent(settings, std::move(layout), observations, Material{}) {
  const int n = static_cast<int>(x_.size()), seen = state.samples() > 0 ? n : 0;
  const bool fits = state.coordinates_size() == n &&
                    state.images_size() == static_cast<int>(observations.size()) &&
                    state.linearization_point_size() == seen && state.gradient_size() == seen &&
                    state.curvature_size() == seen * seen &&
                    state.render_noise_size() == seen * seen &&
                    (state.first_moment_size() == 0 || state.first_moment_size() == n) &&
                    state.second_moment_size() == state.first_moment_size();
  if (!fits) throw invalid_input("the state of the refinement is damaged");
  x_ = vector_of(state.coordinates());
  linearization_point_ = vector_of(state.linearization_point());
  spp_ = state.spp();
  iterations_ = state.iterations();
  end_ = state.end();
  trust_radius_ = state.trust_radius();
  samples_ = state.samples();
  renders_at_max_spp_ = state.renders_at_max_spp();
  loss_ = state.loss();
  loss_standard_error_ = state.loss_standard_error();
  noise_loss_ = state.noise_loss();
  structure_ = {.of_quarters = state.structure().of_quarters(),
                .of_blocks = state.structure().of_blocks(),
                .shared = state.structure().shared(),
                .of_image = state.structure().of_image(),
                .blocks = state.structure().blocks()};
  for (size_t i = 0; i < image_equations_.size(); ++i) {
    image_equations_[i].restore(state.images(static_cast<int>(i)),
                                layout_.of_colour(observations_[i].colour).size());
  }
  normal_equations_.curvature = square_of(state.curvature());
  normal_equations_.gradient = vector_of(state.gradient());
  normal_equations_.render_noise = square_of(state.render_noise());
  first_moment_ = vector_of(state.first_moment());
  second_moment_ = vector_of(state.second_moment());
  if (seen > 0) collect_sums();
}

}  // namespace itn
