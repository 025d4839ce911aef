// The materials that the images do not contradict, about an answer.
#pragma once

#include <functional>
#include <utility>
#include <vector>

#include "client/refine/coordinates.h"
#include "client/refine/matrix.h"
#include "client/refine/score_test.h"

namespace itn {

// By coordinates (client/refine/coordinates.h): points along that of ScoreEquations::ridge, at each
// the best of those across it.
struct Region {
  struct RidgePoint {
    Vector x;
    double statistic = 0;  // above the least; chi-squared of 1 degree of freedom at the truth
    Matrix covariance;     // across the ridge
  };
  Layout layout;  // of the coordinates
  Vector answer;
  std::vector<RidgePoint> ridge_points;
  Matrix covariance;  // of all coordinates by linear error propagation: for correlations alone
};

// `linearization_point`: where the test was made.
Region region_about(const Vector& answer, const Vector& linearization_point, const ScoreTest& test,
                    const Layout& layout = {});

using Quantity = std::function<double(const Vector& x)>;

// Central differences.
Vector gradient(const Quantity& quantity, const Vector& x);

// The least and the largest value of a quantity, of the answer and of what has a statistic of at
// most `quantile`. The quantity should be one that is about linear across the ridge.
std::pair<double, double> range(const Region& region, const Quantity& quantity, double quantile);

// The quantiles of chi-squared with 1 degree of freedom.
inline constexpr double kQuantile90 = 2.705543454095404, kQuantile95 = 3.841458820694124;

}  // namespace itn
