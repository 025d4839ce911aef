// That noise of the renders biases neither gradient, nor curvature, nor loss.
#include "client/refine/normal_equations.h"

#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "client/refine/coordinates.h"
#include "tests/client/refine/synthetic_model.h"
#include "tests/support/expect_error.h"
#include "tests/support/statistics.h"

namespace itn {
namespace {

using namespace testing;

constexpr Material kTruth{60, 0.8, 0.3}, kHere{66, 0.78, 0.25};
constexpr uint32_t kSpp = 8;
constexpr int kLooks = 400;

// d T_p / d x_c without noise.
double exact_derivative(const SyntheticModel& model, size_t p, const Linearization& at, size_t c) {
  double sum = 0;
  for (size_t i = 0; i < 3; ++i) sum += model.derivative(p, kHere, i) * at.jacobian(i, c);
  return sum;
}

// Without weights, and with the derivatives themselves as instruments, all expectations are known.
TEST(ImageEquations, GradientCurvatureAndLossAreUnbiased) {
  const SyntheticModel model;
  const Observation observation = model.observe(kTruth, 0.05, 1);
  const Linearization at = linearize(coordinates_of(kHere));
  std::array<std::vector<double>, 3> gradient, diagonal;
  std::vector<double> squares;
  double biased = 0;  // by how much a product of the same samples would be off, of the squares
  for (int i = 0; i < kLooks; ++i) {
    ImageEquations image_equations(observation, v1::RefineSettings::NONE);
    const auto residuals = image_equations.evaluate(
        model.render(kHere, kSpp, 100 + static_cast<uint64_t>(i)), kSpp, at, true);
    for (size_t c = 0; c < 3; ++c) {
      gradient[c].push_back(residuals.equations.gradient[c]);
      diagonal[c].push_back(residuals.equations.curvature(c, c));
    }
    squares.push_back(residuals.squares);
  }
  double exact_squares = 0;
  std::array<double, 3> exact_gradient{}, exact_diagonal{};
  for (size_t p = 0; p < SyntheticModel::kPixels; ++p) {
    const double t = model.radiance(p, kHere), left = observation.radiance[p] - t;
    exact_squares += left * left;
    biased += t * t * 0.25 / kSpp;
    for (size_t c = 0; c < 3; ++c) {
      const double d = exact_derivative(model, p, at, c);
      exact_gradient[c] += d * left;
      exact_diagonal[c] += d * d;
    }
  }
  for (size_t c = 0; c < 3; ++c) {
    const std::string of = std::to_string(c);
    expect_equal(over_batches(gradient[c]), {exact_gradient[c]}, 7, "gradient " + of);
    expect_equal(over_batches(diagonal[c]), {exact_diagonal[c]}, 7, "curvature " + of);
  }
  const Estimated mean = over_batches(squares);
  expect_equal(mean, {exact_squares}, 7, "loss");
  EXPECT_GT(biased, 10 * mean.standard_error) << "a bias would not have shown";
}

// By its best instruments, smoothed and with a memory, the score is 0 at the truth, whatever the
// noise of image and renders; and what it says of its own spread is so.
TEST(ImageEquations, ScoreIsZeroAtTheTruthAndKnowsItsNoise) {
  const SyntheticModel model;
  const Linearization at = linearize(coordinates_of(kTruth));
  std::array<std::vector<double>, 3> scores, stated;
  for (uint64_t i = 0; i < kLooks; ++i) {
    const Observation observation = model.observe(kTruth, 0.1, 1000 + i);
    ImageEquations image_equations(observation, v1::RefineSettings::NOISE);
    const ImageEquations::Residuals first =
        image_equations.evaluate(model.render(kTruth, 16, 9000 + i), 16, at, false);
    const Vector nowhere = Vector::Zero(3);
    image_equations.accumulate(first, nowhere, 1, 1);
    const ImageEquations::Residuals second =
        image_equations.evaluate(model.render(kTruth, 64, 5000 + i), 64, at, false);
    image_equations.accumulate(second, nowhere, 0, 0);  // its scores alone
    for (size_t c = 0; c < 3; ++c) {
      scores[c].push_back(second.equations.gradient[c]);
      stated[c].push_back(
          image_equations.square_terms().col(static_cast<Eigen::Index>(c)).squaredNorm() /
          (64 * 64));
    }
  }
  for (size_t c = 0; c < 3; ++c) {
    const std::string of = std::to_string(c);
    expect_equal(over_batches(scores[c]), {0}, 6, "score " + of);
    std::vector<double> squared;
    for (const double s : scores[c]) squared.push_back(s * s);
    expect_equal(over_batches(squared), over_batches(stated[c]), 6, "variance " + of);
  }
}

TEST(ImageEquations, SaysWhatDoesNotFit) {
  const SyntheticModel model;
  Observation observation = model.observe(kTruth, 0.1, 1);
  const Linearization at = linearize(coordinates_of(kTruth));
  Render nothing = model.render(kTruth, 4, 1);
  nothing.mask.assign(nothing.mask.size(), 0);
  expect_error(ErrorKind::kInvalidInput, {"synthetic", "belong together"}, [&] {
    ImageEquations(observation, v1::RefineSettings::NOISE).evaluate(nothing, 4, at, false);
  });
}

}  // namespace
}  // namespace itn
