// Derivatives against central finite differences with common random numbers. A test is a row of
// data. The steps are so small that the third derivative does not show: in the albedo it grows as
// (1 - albedo)^-2, and a step of a tenth of 1 - albedo would be wrong by 0.3 %.
#include <gtest/gtest.h>

#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

struct Row {
  const char* name;
  const char* shape;
  bool sun_sky;  // and a ground; else a constant environment
  Material material;
  std::array<double, kCoordinates> step;  // of the finite difference
  uint32_t spp;
};

void PrintTo(const Row& row, std::ostream* out) {
  *out << row.name;
}

class DerivativeTest : public ::testing::TestWithParam<Row> {};

constexpr const char* kNames[] = {"sigma_t", "albedo", "g"};

Material moved(Material material, int coordinate, double by) {
  (coordinate == kSigmaT   ? material.sigma_t
   : coordinate == kAlbedo ? material.albedo
                           : material.g) += by;
  return material;
}

// The same seeds on both sides: what the noise of the two has in common goes away.
Estimated finite_difference(const Scene& scene, RenderRequest settings, int coordinate, double step,
                            int batches) {
  const Material middle = settings.material;
  settings.derivatives = {};
  std::vector<double> slopes;
  for (int b = 0; b < batches; ++b) {
    settings.seed = 1000 + static_cast<uint64_t>(b);
    settings.material = moved(middle, coordinate, step);
    const double above = film_mean(render_grad(scene, settings), -1);
    settings.material = moved(middle, coordinate, -step);
    const double below = film_mean(render_grad(scene, settings), -1);
    slopes.push_back((above - below) / (2 * step));
  }
  return over_batches(slopes);
}

constexpr int kBatches = 32;
constexpr int kComparisons = 7 * kCoordinates;

TEST_P(DerivativeTest, EqualsFiniteDifference) {
  const Row& row = GetParam();
  std::vector<LightDescription> lights;
  if (row.sun_sky) {
    lights = {paper_sun_sky()};
  } else {
    lights = {ConstantEnvironment{1}};
  }
  const Scene scene(studio(row.shape, lights, row.sun_sky ? 0.5F : -1));
  const RenderRequest settings{
      .material = row.material, .sample_count = row.spp, .derivatives = medium_parameters()};
  const FilmEstimate film = estimate_film(scene, settings, kBatches);
  for (int i = 0; i < kCoordinates; ++i) {
    const Estimated slope =
        finite_difference(scene, settings, i, row.step[static_cast<size_t>(i)], kBatches);
    const Estimated derivative = film.derivatives[static_cast<size_t>(i)];
    const std::string what = std::string(row.name) + ", d/d " + kNames[i];
    expect_equal(derivative, slope, kComparisons, what);
    if (i == kAlbedo) {  // the one of the three that is quiet enough everywhere
      expect_resolution(derivative, slope.mean, 0.01, what);
    }
  }
  EXPECT_EQ(film.counters.invalid_samples, 0U);
}

INSTANTIATE_TEST_SUITE_P(
    Scenes, DerivativeTest,
    ::testing::Values(
        Row{"convex, thin", "sphere", false, {3, 0.7, 0.3}, {0.1, 0.005, 0.02}, 1024},
        Row{"convex, thick", "cube", false, {30, 0.9, 0}, {1, 0.002, 0.02}, 512},
        Row{"not convex, thin", "torus", false, {6, 0.6, -0.4}, {0.2, 0.005, 0.02}, 1024},
        Row{"not convex, thick", "smooth_star", true, {40, 0.87, 0.4}, {1, 0.002, 0.02}, 256},
        Row{"thin features, high g", "knot", true, {60, 0.9, 0.8}, {2, 0.002, 0.01}, 768},
        Row{"sun and sky", "mug", true, {30, 0.39, 0}, {1, 0.005, 0.02}, 1024},
        Row{"standing on the floor", "cube", true, {10, 0.8, 0.2}, {0.5, 0.003, 0.02}, 512}));

}  // namespace
}  // namespace itn::testing
