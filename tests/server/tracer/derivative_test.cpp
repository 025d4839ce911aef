// Derivatives against differences of the image: the integral of dL/dx from a to b is L(b) - L(a).
// Unlike a finite difference this has no error of truncation, so a and b may lie so far apart that
// the difference stands out of the noise. A test is a row of data; each shows an error of 2 % in
// every derivative.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "common/error.h"
#include "server/tracer/parameters/parameter.h"
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

// Gives the number in which derivative i is another value.
using Setter = std::function<void(RenderRequest& request, double value)>;

Setter setter_of(size_t coordinate) {
  return [coordinate](RenderRequest& request, double value) {
    (coordinate == kSigmaT   ? request.material.sigma_t
     : coordinate == kAlbedo ? request.material.albedo
                             : request.material.g) = value;
  };
}

// By Gauss and Legendre's formula with five points (Abramowitz and Stegun, "Handbook of
// Mathematical Functions", 25.4.30), which is exact for polynomials of degree 9. In ln(sigma_t), in
// which images are nearly polynomials over a decade, as they are not in sigma_t.
Estimated integrated_derivative(const Scene& scene, RenderRequest request, size_t derivative,
                                const Setter& set, const Interval& interval, bool logarithmic) {
  struct Node {
    double x, weight;
  };
  constexpr std::array<Node, 5> kNodes = {{{-0.9061798459386640, 0.2369268850561891},
                                           {-0.5384693101056831, 0.4786286704993665},
                                           {0, 0.5688888888888889},
                                           {0.5384693101056831, 0.4786286704993665},
                                           {0.9061798459386640, 0.2369268850561891}}};
  const double low = logarithmic ? std::log(interval.low) : interval.low;
  const double high = logarithmic ? std::log(interval.high) : interval.high;
  std::vector<double> integrals;
  for (uint64_t b = 0; b < kBatches; ++b) {
    double integral = 0;
    for (size_t n = 0; n < kNodes.size(); ++n) {
      const double u = (low + high + kNodes[n].x * (high - low)) / 2;
      const double x = logarithmic ? std::exp(u) : u;
      set(request, x);
      request.seed = kNodes.size() * b + n;
      const FilmSums sums = render_grad(scene, request);
      EXPECT_EQ(sums.counters.invalid_samples, 0U);
      integral += kNodes[n].weight * (high - low) / 2 *
                  film_mean(sums, static_cast<int>(derivative)) * (logarithmic ? x : 1);
    }
    integrals.push_back(integral);
  }
  return over_batches(integrals);
}

Estimated change(const Scene& scene, RenderRequest request, const Setter& set,
                 const Interval& interval) {
  request.derivatives.clear();
  set(request, interval.high);
  const Estimated after = estimate_film(scene, request, kBatches, 1000).radiance;
  set(request, interval.low);
  return difference(after, estimate_film(scene, request, kBatches, 2000).radiance);
}

void expect_integral(const Scene& scene, RenderRequest request, size_t derivative,
                     const Setter& set, const Interval& interval, const std::string& what,
                     bool logarithmic = false) {
  request.sample_count = interval.spp;
  const Estimated integral =
      integrated_derivative(scene, request, derivative, set, interval, logarithmic);
  const Estimated expected = change(scene, request, set, interval);
  expect_equal(integral, expected, kDerivativeComparisons, what);
  expect_resolution(difference(integral, expected), expected.mean, 0.02, what);
}

TEST_P(DerivativeTest, IntegratesToTheDifference) {
  const Row& row = GetParam();
  const Scene scene(studio(row.shape, row.lights, row.ground));
  const RenderRequest request{.material = row.material, .derivatives = medium_parameters()};
  for (size_t i = 0; i < kCoordinates; ++i) {
    expect_integral(scene, request, i, setter_of(i), row.intervals[i],
                    std::string(row.name) + ", " + kNames[i], i == kSigmaT);
  }
}

const LightDescription kSunSky = paper_sun_sky();
const LightDescription kFromBehind = DirectionalLight{{0.3, 0.4, 1}, 3};
LightDescription everywhere(float radiance) {
  return ConstantLight{radiance};
}

// A phase function of more than one number, in a thin medium that is lit from the front.
constexpr TwoTerm kTwoTerms{.g_1 = 0.1F, .g_2 = -0.4F, .weight = 0.7F};

RenderRequest request_in_two_terms() {
  RenderRequest request{.material = {3, 0.8, 0}, .phase = kTwoTerms};
  for (const char* name : {"two_term.g_1", "two_term.g_2", "two_term.weight"}) {
    request.derivatives.push_back(parameter_named(name));
  }
  return request;
}

TEST(TwoTermTest, DerivativesIntegrateToTheDifference) {
  const Scene scene(studio("sphere", {DirectionalLight{{0.2, 0.3, -1}, 3}, everywhere(0.02F)}));
  const auto set = [](float TwoTerm::*number) {
    return [number](RenderRequest& request, double value) {
      TwoTerm phase = kTwoTerms;
      phase.*number = static_cast<float>(value);
      request.phase = phase;
    };
  };
  const RenderRequest request = request_in_two_terms();
  expect_integral(scene, request, 0, set(&TwoTerm::g_1), {-0.5, 0.4, 128}, "g_1");
  expect_integral(scene, request, 1, set(&TwoTerm::g_2), {-0.6, 0.2, 128}, "g_2");
  expect_integral(scene, request, 2, set(&TwoTerm::weight), {0.1, 0.95, 128}, "weight");
}

TEST(TwoTermTest, AgreesWithTheReference) {
  const Scene scene(studio("sphere", {DirectionalLight{{0.2, 0.3, -1}, 3}, everywhere(0.02F)}));
  const auto film_by = [&](Tracer tracer, uint64_t seed) {
    RenderRequest request = request_in_two_terms();
    request.sample_count = 256;
    request.tracer = tracer;
    return estimate_film(scene, request, 64, seed);
  };
  expect_same_film(film_by(Tracer::kWavefront, 1), film_by(Tracer::kReference, 301), 4,
                   "two terms");
}

TEST(VonMisesFisherTest, DerivativeIntegratesToTheDifference) {
  const Scene scene(studio("sphere", {DirectionalLight{{0.2, 0.3, -1}, 3}, everywhere(0.02F)}));
  RenderRequest request{.material = {3, 0.8, 0}, .phase = VonMisesFisher{}};
  request.derivatives = {parameter_named("von_mises_fisher.kappa")};
  const auto set = [](RenderRequest& to, double value) {
    to.phase = VonMisesFisher{static_cast<float>(value)};
  };
  expect_integral(scene, request, 0, set, {0.1, 2, 128}, "kappa");
}

// All weight on the first term: the same image, to the bit, and the same derivative.
TEST(TwoTermTest, OfOneTermIsThatOne) {
  const Scene scene(studio("mug", {paper_sun_sky()}, 0.5F));
  RenderRequest request{.material = {30, 0.8, 0.5}, .sample_count = 16};
  request.phase = HenyeyGreenstein{0.5F};
  request.derivatives = {parameter_named("g")};
  const FilmSums one = render_grad(scene, request);
  request.phase = TwoTerm{.g_1 = 0.5F, .g_2 = -0.2F, .weight = 1};
  request.derivatives = {parameter_named("two_term.g_1")};
  const FilmSums two = render_grad(scene, request);
  EXPECT_EQ(one.estimates[0].radiance, two.estimates[0].radiance);
  EXPECT_NEAR(film_mean(one, 0), film_mean(two, 0), 1e-5 * std::abs(film_mean(one, 0)));
}

TEST(TwoTermTest, RefusesWhatItIsNot) {
  const Scene scene(studio("cube", {ConstantLight{1}}));
  const auto message_of = [&](const RenderRequest& request) -> std::string {
    try {
      render_grad(scene, request);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  RenderRequest request{.material = {30, 0.8, 0}, .phase = TwoTerm{}};
  request.derivatives = {parameter_named("g")};
  EXPECT_EQ(message_of(request),
            "no derivative in g: there is two_term.g_1, two_term.g_2, two_term.weight");
  request.derivatives = {parameter_named("two_term.weight")};
  EXPECT_EQ(message_of(request), "");
  request.phase = std::nullopt;
  EXPECT_EQ(message_of(request), "no derivative in two_term.weight: there is g");
  request.phase = TwoTerm{.g_2 = -1};
  EXPECT_EQ(message_of(request), "phase.two_term.g_2 is -1; it must be in [-0.99, 0.99]");
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
INSTANTIATE_TEST_SUITE_P(
    FineScenes, DerivativeTest,
    ::testing::Values(Row{"not convex, thick",
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
                          {{{3, 50, 576}, {0.5, 0.95, 160}, {-0.6, 0.7, 2048}}}}));

}  // namespace
}  // namespace itn::testing
