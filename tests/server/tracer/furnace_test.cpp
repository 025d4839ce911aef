// White furnace: where nothing absorbs (albedo 1) and light of radiance 1 comes from everywhere,
// radiance is 1 everywhere. Where the paths go has then no influence: every derivative but the one
// in the albedo is 0.
#include <gtest/gtest.h>

#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

struct Furnace {
  const char* shape;
  double g;
};

void PrintTo(const Furnace& f, std::ostream* out) {
  *out << f.shape << ", g " << f.g;
}

class FurnaceTest : public ::testing::TestWithParam<Furnace> {};

constexpr int kFurnaceComparisons = 6 * 4;

TEST_P(FurnaceTest, RadianceIsOneAndDerivativesVanish) {
  const Scene scene(studio(GetParam().shape, {ConstantLight{1}}));
  constexpr double kSigmaT0 = 5;
  const RenderRequest settings{.material = {kSigmaT0, 1, GetParam().g},
                               .sample_count = 768,
                               .derivatives = medium_parameters()};
  const FilmEstimate film = estimate_film(scene, settings, 64);
  expect_equal(film.radiance, {1, 0}, kFurnaceComparisons, "radiance");
  expect_resolution(film.radiance, 1, 0.01, "radiance");
  expect_equal(film.derivatives[kSigmaT], {0, 0}, kFurnaceComparisons, "d radiance / d sigma_t");
  expect_equal(film.derivatives[kG], {0, 0}, kFurnaceComparisons, "d radiance / d g");
  // By the radiance, as 0 has no size of its own: what g, or the logarithm of sigma_t, would
  // change.
  expect_resolution(film.derivatives[kSigmaT], 1 / kSigmaT0, 0.02, "d radiance / d sigma_t");
  expect_resolution(film.derivatives[kG], 1, 0.02, "d radiance / d g");
  EXPECT_GT(film.derivatives[kAlbedo].mean, 0.1);
  EXPECT_EQ(film.counters.invalid_samples, 0U);
  // A leak is lost light: that these are rare is part of "exactly 1".
  EXPECT_LT(static_cast<double>(film.counters.leaks),
            1e-5 * static_cast<double>(film.counters.paths));
}

INSTANTIATE_TEST_SUITE_P(Shapes, FurnaceTest,
                         ::testing::Values(Furnace{"sphere", -0.5}, Furnace{"sphere", 0},
                                           Furnace{"sphere", 0.8}, Furnace{"knot", -0.5},
                                           Furnace{"knot", 0}, Furnace{"knot", 0.8}));

// With a white ground too: the object stands on it, coplanar triangles touching.
TEST(FurnaceGroundTest, AWhiteGroundChangesNothing) {
  for (const char* shape : {"cube", "torus"}) {
    const Scene scene(studio(shape, {ConstantLight{1}}, 1));
    const FilmEstimate film =
        estimate_film(scene, {.material = {10, 1, 0.3}, .sample_count = 64}, 32);
    expect_equal(film.radiance, {1, 0}, 2, shape);
    expect_resolution(film.radiance, 1, 0.01, shape);
    EXPECT_EQ(film.counters.invalid_samples, 0U);
  }
}

}  // namespace
}  // namespace itn::testing
