// A lamp that is a point: closed forms of what it sends through air and medium, and the limit in
// which it is far away.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "common/error.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

constexpr double kInverseSquareMm = 1e6;  // from W/sr and mm to W/m^2

// Ground at y = 0, seen from above at (0.03, 0.02), and an object elsewhere.
SceneDescription seen_ground(std::vector<LightDescription> lights) {
  SceneDescription scene;
  scene.object = box({5, 0, 5}, {6, 1, 6});
  scene.surfaces = {{horizontal_square(0, 20), 0.6F}};
  scene.lights = std::move(lights);
  scene.camera = {
      .origin = {0.03, 4, 0.02}, .target = {0.03, 3, 0.02}, .up = {0, 0, 1}, .fov = 2.5e-5};
  scene.film = {2, 2};
  return scene;
}

double mean_of(SceneDescription scene) {
  return film_mean(
      render_grad(Scene(std::move(scene)), {.material = {1e3, 0, 0}, .sample_count = 4}), -1);
}

// Radiance = reflectance E cos / pi, with E falling by the square of the distance.
TEST(PointLightTest, LightsTheGroundByTheInverseSquare) {
  for (const Vec3d offset :
       {Vec3d{0, 2, 0}, Vec3d{0, 20, 0}, Vec3d{3, 2, -1}, Vec3d{-500, 900, 0}}) {
    const double distance = length(offset);
    const double expected =
        0.6 / std::numbers::pi * 7 * kInverseSquareMm * offset.y / std::pow(distance, 3);
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      const Scene scene(seen_ground({PointLight{offset + Vec3d{0.03, 0, 0.02}, 7}}));
      RenderRequest request{.material = {1e3, 0, 0}, .sample_count = 4};
      request.tracer = tracer;
      EXPECT_NEAR(film_mean(render_grad(scene, request), -1) / expected, 1, 1e-4) << offset.y;
    }
  }
}

// What stands between them casts a shadow; what stands behind the lamp does not.
TEST(PointLightTest, ShadowsEndAtTheLamp) {
  const auto lamp_at = [](double y) { return seen_ground({PointLight{{0.03, y, 3}, 1}}); };
  const double free = mean_of(lamp_at(2));
  EXPECT_GT(free, 0);
  SceneDescription roof = lamp_at(2);
  roof.surfaces.push_back({horizontal_square(2.5F, 1), 0});
  for (Vec3f& v : roof.surfaces.back().mesh.vertices) v.z += 3;
  EXPECT_EQ(mean_of(roof), free);
  SceneDescription awning = std::move(roof);
  awning.lights = {PointLight{{0.03, 3, 3}, 1}};
  EXPECT_EQ(mean_of(std::move(awning)), 0);
  SceneDescription wall = lamp_at(2);
  wall.object = box({-1, 0, 1}, {1, 3, 2});
  EXPECT_EQ(mean_of(std::move(wall)), 0);
}

// A lamp at height h over a slab of thickness D, the camera above it, to first order in the albedo
// (see SingleScatteringTest):
//   d T / d albedo at albedo 0 = I p(-1; g) integral of sigma_t exp(-2 sigma_t y) / (h + y)^2 dy.
TEST(PointLightTest, IsScatteredOnceInASlab) {
  constexpr double kSigmaT = 2, kThickness = 0.5, kHeight = 0.3, kIntensity = 4e-6;
  SceneDescription description;
  description.object = box({-1, 0, -1}, {1, kThickness, 1});
  description.lights = {PointLight{{0.03, kThickness + kHeight, 0.02}, kIntensity}};
  description.camera = {
      .origin = {0.03, 4, 0.02}, .target = {0.03, 3, 0.02}, .up = {0, 0, 1}, .fov = 2.5e-5};
  description.film = {4, 4};
  const Scene scene(std::move(description));
  double integral = 0;
  constexpr int kSteps = 10'000;
  for (int i = 0; i < kSteps; ++i) {
    const double y = (i + 0.5) / kSteps * kThickness;
    integral +=
        kSigmaT * std::exp(-2 * kSigmaT * y) / std::pow(kHeight + y, 2) * kThickness / kSteps;
  }
  for (const double g : {-0.4, 0.6}) {
    const RenderRequest request{
        .material = {kSigmaT, 0, g}, .sample_count = 1024, .derivatives = medium_parameters()};
    const FilmEstimate film =
        estimate_film(scene, request, 64, 1, {.tuning = {.shadow_ray_roulette = 0}});
    const double phase = (1 - g * g) / (4 * std::numbers::pi * std::pow(1 + g, 3));
    const double expected = kIntensity * kInverseSquareMm * phase * integral;
    const auto& seen = film.derivatives[static_cast<size_t>(Coordinate::kAlbedo)];
    expect_equal(seen, {expected, 0}, 2, "single scattering");
    expect_resolution(seen, expected, 0.01, "single scattering");
  }
}

// From far away it is a distant light, and the two add up with others alike.
TEST(PointLightTest, IsADistantLightFromFarAway) {
  constexpr double kFar = 2e5;
  const Vec3d toward = itn::normalize(Vec3d{0.4, 0.8, -0.5});
  const auto film_of = [&](const LightDescription& light, uint64_t seed) {
    const Scene scene(studio("mug", {ConstantLight{0.3}, light}, 0.5F));
    RenderRequest request{
        .material = {12, 0.7, 0.4}, .sample_count = 1024, .derivatives = medium_parameters()};
    request.derivatives.push_back({Parameter::kLightScale, 1});
    return estimate_film(scene, request, 64, seed);
  };
  expect_same_film(film_of(PointLight{toward * kFar, 3 * kFar * kFar / kInverseSquareMm}, 1),
                   film_of(DirectionalLight{toward, 3}, 301), 5, "far away");
}

// Close by, as the reference sees it: over an object in a pose, with a ground and other lights.
TEST(PointLightTest, AgreesWithTheReference) {
  SceneDescription description =
      studio("smooth_star", {ConstantLight{0.2}, PointLight{{0.9, 1.2, -0.6}, 2e-6}}, 0.5F);
  description.pose = {.rotation = {Vec3d{0, 0.6, -0.8}, Vec3d{0, 0.8, 0.6}, Vec3d{1, 0, 0}},
                      .translation = {0.1, 0.2, 0.1}};
  const Scene scene(std::move(description));
  const auto film_by = [&](Tracer tracer, uint64_t seed) {
    RenderRequest request{
        .material = {12, 0.7, 0.4}, .sample_count = 1408, .derivatives = medium_parameters()};
    request.derivatives.push_back({Parameter::kLightScale, 1});
    request.tracer = tracer;
    return estimate_film(scene, request, 64, seed);
  };
  expect_same_film(film_by(Tracer::kWavefront, 1), film_by(Tracer::kReference, 301), 5, "close by");
}

TEST(PointLightTest, StandsOutsideOfTheMedium) {
  SceneDescription scene = studio("cube", {PointLight{{0, 0.5, 0}, 1}});
  EXPECT_THROW(Scene(std::move(scene)), Error);
  EXPECT_THROW(Scene(studio("cube", {PointLight{{0, NAN, 0}, 1}})), Error);
  EXPECT_THROW(Scene(studio("cube", {PointLight{{0, 2, 0}, -1}})), Error);
}

}  // namespace
}  // namespace itn::testing
