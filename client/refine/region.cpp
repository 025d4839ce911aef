#include "client/refine/region.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace itn {
namespace {

// How far along the ridge the equations, which are linear, are believed. Beyond, nothing is known:
// what is not contradicted up to there is not at all.
constexpr double kEndOfRidge = 2;
// Places are so far apart: the nearest to the middle, and each more than the one before by a
// factor.
constexpr double kNearest = 1e-4, kGrowth = 1.2;

// Between a place inside and one outside the region of this quantile, of two neighbours.
double edge(const ScoreTest& test, double inside, double outside, double statistic) {
  constexpr int kHalvings = 20;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = (inside + outside) / 2;
    (test.profile(middle).statistic <= statistic ? inside : outside) = middle;
  }
  return inside;
}

}  // namespace

Region region_about(const Vector& answer, const Vector& linearization_point, const ScoreTest& test,
                    const Layout& layout) {
  const Vector full = test.full_step();
  const double centre = std::isfinite(full[test.ridge()]) ? full[test.ridge()] : 0;
  std::vector<double> along{std::clamp(centre, -kEndOfRidge, kEndOfRidge)};
  for (double offset = kNearest; offset < 2 * kEndOfRidge; offset *= kGrowth) {
    for (const double place : {along[0] - offset, along[0] + offset}) {
      if (std::abs(place) < kEndOfRidge) along.push_back(place);
    }
  }
  along.insert(along.end(), {-kEndOfRidge, kEndOfRidge});
  std::ranges::sort(along);

  std::vector<double> statistics;
  for (const double a : along) statistics.push_back(test.profile(a).statistic);
  const double least = *std::ranges::min_element(statistics);
  const size_t count = along.size();
  for (const double quantile : {kQuantile90, kQuantile95}) {
    for (size_t i = 1; i < count; ++i) {
      const bool left = statistics[i - 1] - least <= quantile;
      const bool right = statistics[i] - least <= quantile;
      if (left && !right) along.push_back(edge(test, along[i - 1], along[i], least + quantile));
      if (right && !left) along.push_back(edge(test, along[i], along[i - 1], least + quantile));
    }
  }

  Region region{
      .layout = layout, .answer = answer, .ridge_points = {}, .covariance = test.covariance()};
  for (const double a : along) {
    const ScoreTest::Profile profile = test.profile(a);
    Region::RidgePoint place{.x = linearization_point + profile.step,
                             .statistic = profile.statistic - least,
                             .covariance = profile.covariance};
    clamp_to_domain(place.x, layout);
    region.ridge_points.push_back(place);
    if (std::abs(a) < kEndOfRidge) continue;
    place.x[test.ridge()] = std::copysign(std::numeric_limits<double>::max(), a);
    clamp_to_domain(place.x, layout);
    region.ridge_points.push_back(place);
  }
  return region;
}

Vector gradient(const Quantity& quantity, const Vector& x) {
  constexpr double kStep = 1e-5;
  Vector result(x.size());
  for (Eigen::Index c = 0; c < x.size(); ++c) {
    Vector low = x, high = x;
    low[c] -= kStep;
    high[c] += kStep;
    result[c] = (quantity(high) - quantity(low)) / (2 * kStep);
  }
  return result;
}

std::pair<double, double> range(const Region& region, const Quantity& quantity, double quantile) {
  double low = quantity(region.answer), high = low;
  for (const Region::RidgePoint& place : region.ridge_points) {
    if (place.statistic > quantile) continue;
    const Vector slope = gradient(quantity, place.x);
    const double variance = slope.dot(place.covariance * slope);
    const double value = quantity(place.x);
    const double reach = std::sqrt(std::max(0.0, (quantile - place.statistic) * variance));
    low = std::min(low, value - reach);
    high = std::max(high, value + reach);
  }
  return {low, high};
}

}  // namespace itn
