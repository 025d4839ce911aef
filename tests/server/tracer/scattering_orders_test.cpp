// The parts of the radiance by how often the object's medium has scattered the light.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

std::vector<Parameter> orders_below(uint32_t count) {
  std::vector<Parameter> orders;
  for (uint32_t k = 0; k < count; ++k) orders.push_back({Parameter::kScattered, k});
  return orders;
}

// A slab of thickness D, seen at right angles. Of a constant light of radiance 1,
// exp(-sigma_t D) shines through unscattered; of a light in the zenith of irradiance E,
// E p(-1) albedo (1 - exp(-2 sigma_t D)) / 2 comes back after one scattering.
TEST(ScatteringOrdersTest, SlabInClosedForm) {
  constexpr double kThickness = 0.5, kIrradiance = 3;
  const Material medium{2, 0.5, 0.3};
  SceneDescription description;
  description.object = box({-1, 0, -1}, {1, static_cast<float>(kThickness), 1});
  description.camera = {
      .origin = {0.03, 4, 0.02}, .target = {0.03, 3, 0.02}, .up = {0, 0, 1}, .fov = 1e-4 / 4};
  description.film = {4, 4};
  SceneDescription from_all_sides = description;
  from_all_sides.lights = {ConstantLight{1}};
  description.lights = {DirectionalLight{{0, 1, 0}, kIrradiance}};
  const Scene zenith(std::move(description)), furnace(std::move(from_all_sides));
  const double phase =
      (1 - medium.g * medium.g) / (4 * std::numbers::pi * std::pow(1 + medium.g, 3));
  const double once =
      kIrradiance * phase * medium.albedo * (1 - std::exp(-2 * medium.sigma_t * kThickness)) / 2;
  const double never = std::exp(-medium.sigma_t * kThickness);
  for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
    RenderRequest request{
        .material = medium, .sample_count = 1024, .derivatives = orders_below(2), .tracer = tracer};
    const FilmEstimate lit = estimate_film(zenith, request, 64);
    EXPECT_EQ(lit.derivatives[0].mean, 0);
    expect_equal(lit.derivatives[1], {once, 0}, 4, "scattered once");
    expect_resolution(lit.derivatives[1], once, 0.01, "scattered once");
    const FilmEstimate through = estimate_film(furnace, request, 64);
    expect_equal(through.derivatives[0], {never, 0}, 4, "never scattered");
    expect_resolution(through.derivatives[0], never, 0.01, "never scattered");
  }
}

// A mug on a floor; one with gloss beside another object, whose scatterings do not count.
SceneDescription still_life(const Boundary& boundary) {
  SceneDescription scene = studio("mug", {paper_sun_sky(), ConstantLight{5}}, 0.4F);
  scene.boundary = boundary;
  if (!std::holds_alternative<IndexMatched>(boundary)) {
    scene.other_objects.push_back(
        {box({0.6F, 0, -0.2F}, {0.9F, 0.5F, 0.2F}), {20, 0.9, 0.4}, boundary});
  }
  return scene;
}
const std::vector<Boundary> kBoundaries{IndexMatched{}, RoughDielectric{1.4F, 0.3F},
                                        Dielectric{1.4F}};

// What is left after the first orders is as small as the albedo to their number, sample for sample.
TEST(ScatteringOrdersTest, AddUpToTheRadiance) {
  constexpr uint32_t kOrders = 12;
  for (const Boundary& boundary : kBoundaries) {
    const Scene scene(still_life(boundary));
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      const FilmSums sums = render_grad(scene, {.material = {20, 0.2, 0.3},
                                                .sample_count = 64,
                                                .derivatives = orders_below(kOrders),
                                                .tracer = tracer});
      double sum = 0;
      for (int k = 0; k < static_cast<int>(kOrders); ++k) {
        const double part = film_mean(sums, k);
        EXPECT_TRUE(k >= 3 || part > 0) << k;
        sum += part;
      }
      EXPECT_NEAR(sum, film_mean(sums, -1), 1e-5 * film_mean(sums, -1));
    }
  }
}

// Order K is in proportion to albedo^K: albedo times the derivative in it is the sum of K times the
// orders.
TEST(ScatteringOrdersTest, GrowWithTheAlbedo) {
  constexpr uint32_t kOrders = 12;
  const Scene scene(still_life(IndexMatched{}));
  RenderRequest request{.material = {20, 0.2, 0.3}, .sample_count = 512};
  request.derivatives = {{Parameter::kAlbedo}};
  const FilmEstimate by_albedo = estimate_film(scene, request, 32, 501);
  request.derivatives = orders_below(kOrders);
  std::vector<double> sums;
  for (request.seed = 1; request.seed <= 32; ++request.seed) {
    const FilmSums film = render_grad(scene, request);
    double& sum = sums.emplace_back();
    for (int k = 1; k < static_cast<int>(kOrders); ++k) sum += k * film_mean(film, k);
  }
  const Estimated weighted = over_batches(sums);
  const double albedo = request.material.albedo;
  const Estimated expected{albedo * by_albedo.derivatives[0].mean,
                           albedo * by_albedo.derivatives[0].standard_error};
  expect_equal(weighted, expected, 1, "sum of K I_K");
  expect_resolution(difference(weighted, expected), expected.mean, 0.02, "sum of K I_K");
}

TEST(ScatteringOrdersTest, WavefrontEqualsReference) {
  for (const Boundary& boundary : {kBoundaries[0], kBoundaries[1]}) {
    SceneDescription description = still_life(boundary);
    // The reference meets a sun behind a boundary seldom.
    if (stops_lines(boundary)) description.lights = {ConstantLight{5}};
    const Scene scene(std::move(description));
    std::vector<FilmEstimate> films;
    for (const Tracer tracer : {Tracer::kReference, Tracer::kWavefront}) {
      films.push_back(estimate_film(scene,
                                    {.material = {20, 0.8, 0.3},
                                     .sample_count = 384,
                                     .derivatives = orders_below(2),
                                     .tracer = tracer},
                                    32, tracer == Tracer::kReference ? 1 : 501));
    }
    expect_same_film(films[1], films[0], 6, "boundary " + std::to_string(boundary.index()));
  }
}

}  // namespace
}  // namespace itn::testing
