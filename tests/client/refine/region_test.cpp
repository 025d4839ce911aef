// Intervals of equations that are known exactly, but for their noise.
#include "client/refine/region.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "tests/client/refine/synthetic_model.h"

namespace itn {
namespace {

using testing::Gaussian1D;

constexpr int kDraws = 400;
constexpr size_t kRidge = 2;  // of one colour
const Vector kTruth = Vector{{0.1, -0.05, 0.3}};

// Sums over pixels of s = H d + noise and of H, whose noise goes along with that of s, as both are
// of one render. `strength`: the curvature along the ridge over its noise.
ScoreTest drawn(double strength, uint64_t seed) {
  constexpr int kPixels = 300;
  Gaussian1D gaussian(seed);
  const double noise = 1 / std::sqrt(kPixels);  // of a sum: 1
  Matrix exact = Matrix::Zero(3, 3);
  exact.diagonal() = Vector{{60, 40, strength}};
  exact(0, kRidge) = exact(kRidge, 0) = 5;
  Vector gradient = Vector::Zero(3);
  Matrix curvature = Matrix::Zero(3, 3), moments = Matrix::Zero(12, 12);
  for (int p = 0; p < kPixels; ++p) {
    Vector terms(12);
    for (int c = 0; c < 3; ++c) {
      const double shared = gaussian();
      terms[c] = (exact.row(c) * kTruth)(0) / kPixels + noise * shared;
      for (int d = 0; d < 3; ++d) {
        terms[3 + 3 * c + d] = exact(c, d) / kPixels + noise * (0.6 * shared + 0.8 * gaussian());
      }
    }
    gradient += terms.head(3);
    curvature += terms.tail(9).reshaped<Eigen::RowMajor>(3, 3);
    moments += terms * terms.transpose();
  }
  return ScoreTest({.gradient = gradient,
                    .curvature = curvature,
                    .moments = {{.coordinates = {0, 1, 2}, .sums = moments}},
                    .apart = {}});
}

struct Coverage {
  std::array<double, 3> inside{};  // part of the draws
  double unbounded = 0;            // along the ridge
};

Coverage coverage(double strength) {
  Coverage result;
  for (uint64_t i = 0; i < kDraws; ++i) {
    const ScoreTest test = drawn(strength, 1 + i);
    const Vector nowhere = Vector::Zero(3);
    const Region region = region_about(test.best_step(0.7), nowhere, test);
    for (size_t c = 0; c < 3; ++c) {
      const auto [low, high] = range(
          region, [c](const Vector& x) { return x[c]; }, kQuantile95);
      result.inside[c] += (low <= kTruth[c] && kTruth[c] <= high) / double{kDraws};
      if (c == kRidge) result.unbounded += (high - low > 4) / double{kDraws};
    }
  }
  return result;
}

const double kSigma = std::sqrt(0.95 * 0.05 / kDraws);

TEST(Region, HasTheTruthAsOftenAsItSays) {
  const Coverage told = coverage(50);
  for (const double inside : told.inside) EXPECT_NEAR(inside, 0.95, 4 * kSigma);
  EXPECT_EQ(told.unbounded, 0);
}

// It is as along the similarity ridge: now the curvature is large by chance, and now it is none.
TEST(Region, HasTheTruthWhereTheCurvatureIsHardlyMoreThanNoise) {
  for (const double strength : {0.0, 1.0, 3.0}) {
    const Coverage told = coverage(strength);
    for (const double inside : told.inside) EXPECT_GE(inside, 0.95 - 4 * kSigma) << strength;
    // If there is nothing to be told, that is what is told.
    if (strength < 2) {
      EXPECT_GT(told.unbounded, 0.5) << strength;
    }
  }
}

// Newton's step where the curvature is known, and none of its leaps where it is noise.
TEST(ScoreTest, StepsShrinkWithWhatIsKnown) {
  double known = 0, farthest = 0, farthest_newton = 0;
  for (uint64_t i = 0; i < 50; ++i) {
    known += drawn(50, i).best_step(0.7)[kRidge] / 50;
    const ScoreTest unknown = drawn(0, i);
    farthest = std::max(farthest, std::abs(unknown.best_step(0.7)[kRidge]));
    farthest_newton = std::max(farthest_newton, std::abs(unknown.full_step()[kRidge]));
  }
  EXPECT_NEAR(known, kTruth[kRidge], 0.02);
  EXPECT_LE(farthest, 0.75);
  EXPECT_GT(farthest_newton, 10);
}

}  // namespace
}  // namespace itn
