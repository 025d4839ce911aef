// Derivatives against differences of the image: the integral of dL/dx from a to b is L(b) - L(a).
// Unlike a finite difference this has no error of truncation, so a and b may lie so far apart that
// the difference stands out of the noise. A test is a row of data; each shows an error of 2 % in
// every derivative.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

struct Interval {
  double low, high;
  uint32_t spp;  // of each render, so that the noise is below the resolution
};

struct Row {
  const char* name;
  const char* shape;
  std::vector<LightDescription> lights;
  float ground;  // its reflectance; < 0: none
  Material material;
  std::array<Interval, kCoordinates> intervals;  // in each, the other two are those of `material`
};

void PrintTo(const Row& row, std::ostream* out) {
  *out << row.name;
}

class DerivativeTest : public ::testing::TestWithParam<Row> {};

constexpr const char* kNames[] = {"sigma_t", "albedo", "g"};
constexpr int kBatches = 32;
constexpr int kDerivativeComparisons = 7 * kCoordinates;

Material with(Material material, size_t coordinate, double value) {
  (coordinate == kSigmaT   ? material.sigma_t
   : coordinate == kAlbedo ? material.albedo
                           : material.g) = value;
  return material;
}

// By Gauss and Legendre's formula with five points (Abramowitz and Stegun, "Handbook of
// Mathematical Functions", 25.4.30), which is exact for polynomials of degree 9. In ln(sigma_t), in
// which images are nearly polynomials over a decade, as they are not in sigma_t.
Estimated integrated_derivative(const Scene& scene, RenderRequest request, size_t coordinate,
                                const Interval& interval) {
  struct Node {
    double x, weight;
  };
  constexpr std::array<Node, 5> kNodes = {{{-0.9061798459386640, 0.2369268850561891},
                                           {-0.5384693101056831, 0.4786286704993665},
                                           {0, 0.5688888888888889},
                                           {0.5384693101056831, 0.4786286704993665},
                                           {0.9061798459386640, 0.2369268850561891}}};
  const bool logarithmic = coordinate == kSigmaT;
  const double low = logarithmic ? std::log(interval.low) : interval.low;
  const double high = logarithmic ? std::log(interval.high) : interval.high;
  const Material material = request.material;
  std::vector<double> integrals;
  for (uint64_t b = 0; b < kBatches; ++b) {
    double integral = 0;
    for (size_t n = 0; n < kNodes.size(); ++n) {
      const double u = (low + high + kNodes[n].x * (high - low)) / 2;
      const double x = logarithmic ? std::exp(u) : u;
      request.material = with(material, coordinate, x);
      request.seed = kNodes.size() * b + n;
      const FilmSums sums = render_grad(scene, request);
      EXPECT_EQ(sums.counters.invalid_samples, 0U);
      const double derivative = film_mean(sums, static_cast<int>(coordinate));
      integral += kNodes[n].weight * (high - low) / 2 * derivative * (logarithmic ? x : 1);
    }
    integrals.push_back(integral);
  }
  return over_batches(integrals);
}

Estimated change(const Scene& scene, RenderRequest request, size_t coordinate,
                 const Interval& interval) {
  const Material material = request.material;
  request.derivatives.clear();
  request.material = with(material, coordinate, interval.high);
  const Estimated after = estimate_film(scene, request, kBatches, 1000).radiance;
  request.material = with(material, coordinate, interval.low);
  return difference(after, estimate_film(scene, request, kBatches, 2000).radiance);
}

TEST_P(DerivativeTest, IntegratesToTheDifference) {
  const Row& row = GetParam();
  const Scene scene(studio(row.shape, row.lights, row.ground));
  RenderRequest request{.material = row.material, .derivatives = medium_parameters()};
  for (size_t i = 0; i < kCoordinates; ++i) {
    request.sample_count = row.intervals[i].spp;
    const std::string what = std::string(row.name) + ", " + kNames[i];
    const Estimated derivative = integrated_derivative(scene, request, i, row.intervals[i]);
    const Estimated expected = change(scene, request, i, row.intervals[i]);
    expect_equal(derivative, expected, kDerivativeComparisons, what);
    expect_resolution(difference(derivative, expected), expected.mean, 0.02, what);
  }
}

const LightDescription kSunSky = paper_sun_sky();
const LightDescription kFromBehind = DirectionalLight{{0.3, 0.4, 1}, 3};
LightDescription everywhere(float radiance) {
  return ConstantLight{radiance};
}

INSTANTIATE_TEST_SUITE_P(
    Scenes, DerivativeTest,
    ::testing::Values(Row{"convex, thin",
                          "sphere",
                          {kFromBehind, everywhere(0.1F)},
                          -1,
                          {3, 0.7, 0.3},
                          {{{0.5, 6, 224}, {0.4, 0.9, 64}, {-0.5, 0.8, 640}}}},
                      Row{"convex, thick",
                          "cube",
                          {everywhere(1)},
                          -1,
                          {30, 0.9, 0},
                          {{{4, 40, 416}, {0.6, 0.95, 64}, {-0.6, 0.8, 320}}}},
                      Row{"not convex, thin",
                          "torus",
                          {kFromBehind, everywhere(0.2F)},
                          -1,
                          {6, 0.6, -0.4},
                          {{{1, 10, 320}, {0.4, 0.9, 112}, {-0.7, 0.6, 384}}}},
                      Row{"not convex, thick",
                          "smooth_star",
                          {kSunSky},
                          0.5F,
                          {40, 0.87, 0.4},
                          {{{6, 60, 704}, {0.5, 0.92, 80}, {-0.3, 0.8, 384}}}},
                      Row{"thin features, high g",
                          "knot",
                          {kSunSky},
                          0.5F,
                          {25, 0.85, 0.8},
                          {{{3, 50, 576}, {0.5, 0.95, 160}, {-0.6, 0.7, 2048}}}},
                      Row{"sun and sky",
                          "mug",
                          {kSunSky},
                          0.5F,
                          {30, 0.39, 0},
                          {{{6, 50, 112}, {0.2, 0.8, 64}, {-0.5, 0.7, 224}}}},
                      Row{"standing on the floor",
                          "cube",
                          {kSunSky},
                          0.5F,
                          {10, 0.8, 0.2},
                          {{{3, 30, 544}, {0.5, 0.9, 64}, {-0.2, 0.8, 160}}}}));

}  // namespace
}  // namespace itn::testing
