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

// Normals that are given, however they lean, as long as they point outwards.
TEST(FurnaceTest, GivenNormalsLoseNothing) {
  for (const double cosine : {0.7, 0.1, 0.0011}) {
    SceneDescription description = studio("cube", {ConstantLight{1}});
    description.boundary = RoughDielectric{1.5F, 0.3F};
    const Mesh& mesh = description.object;
    for (const auto& triangle : mesh.triangles) {
      const auto corner = [&](size_t k) { return static_cast<Vec3d>(mesh.vertices[triangle[k]]); };
      const Vec3d normal = normalize(cross(corner(1) - corner(0), corner(2) - corner(0)));
      std::array<Vec3f, 3>& normals = description.corner_normals.emplace_back();
      for (size_t k = 0; k < 3; ++k) {
        const Vec3d aside = normalize(corner(k) - corner((k + 1) % 3));
        normals[k] = static_cast<Vec3f>(normal * cosine + aside * std::sqrt(1 - cosine * cosine));
      }
    }
    const FilmEstimate film =
        estimate_film(Scene(std::move(description)),
                      {.material = {3, 1, 0.3}, .sample_count = 128, .estimates = 1}, 32);
    std::printf("  cosine %g: %.5f +- %.2g\n", cosine, film.radiance.mean,
                film.radiance.standard_error);
    EXPECT_NEAR(film.radiance.mean, 1, 4 * film.radiance.standard_error + 2e-3) << cosine;
  }
}

}  // namespace
}  // namespace itn::testing
