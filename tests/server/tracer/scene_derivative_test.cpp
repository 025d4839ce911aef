// Derivatives in what surrounds the object: the reflectance of surfaces, the scale of lights.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>

#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

const std::vector<Parameter> kFloorAndLight{{Parameter::kReflectance, 0},
                                            {Parameter::kLightScale, 0}};

// A floor under a distant light that arrives at the angle theta: L = rho E cos(theta) / pi, so
// dL/drho = E cos(theta) / pi, for black floors too, and dL/dscale = L. The object is under it.
// Every path that is not stopped gives exactly that.
TEST(SceneDerivativeTest, OfALambertianFloor) {
  constexpr double kCosine = 0.8, kIrradiance = 3;
  const RenderOptions no_roulette{.tuning = {.shadow_ray_roulette = 0}};
  for (const float reflectance : {0.0F, 0.3F, 1.0F}) {
    SceneDescription description =
        studio("cube", {DirectionalLight{{0.6, kCosine, 0}, kIrradiance}}, reflectance, 4);
    description.object = box({-0.5F, -3, -0.5F}, {0.5F, -2, 0.5F});
    const Scene scene(std::move(description));
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      RenderRequest request{.material = {30, 0.8, 0}, .sample_count = 4};
      request.derivatives = kFloorAndLight;
      request.tracer = tracer;
      const FilmSums sums = render_grad(scene, request, no_roulette);
      const double slope = kIrradiance * kCosine / std::numbers::pi;
      const double radiance = double{reflectance} * slope;
      EXPECT_NEAR(film_mean(sums, -1), radiance, 1e-5);
      EXPECT_NEAR(film_mean(sums, 0), slope, 1e-5);
      EXPECT_NEAR(film_mean(sums, 1), radiance, 1e-5);
    }
  }
}

// In a furnace the floor, seen alone, has the radiance of its reflectance; a constant light shines
// through a medium that does not scatter as its transmittance T: dT/dscale = T = exp(-sigma_t d).
TEST(SceneDerivativeTest, OfAConstantLight) {
  SceneDescription description;
  description.object = box({-0.5F, 0, -0.5F}, {0.5F, 0.7F, 0.5F});
  description.lights = {ConstantLight{1}};
  description.camera = {
      .origin = {0.03, 5, 0.02}, .target = {0.03, 4, 0.02}, .up = {0, 0, 1}, .fov = 1e-4 / 5};
  description.film = {4, 4};
  const Scene scene(std::move(description));
  RenderRequest request{.material = {2, 0, 0.3}, .sample_count = 1024};
  request.derivatives = {{Parameter::kLightScale, 0}};
  const FilmEstimate film = estimate_film(scene, request, 64);
  const double expected = std::exp(-2 * 0.7);
  expect_equal(film.derivatives[0], {expected, 0}, 1, "d transmittance / d scale");
  expect_resolution(film.derivatives[0], expected, 0.01, "d transmittance / d scale");
}

// Two surfaces that see each other and the object: radiance is a polynomial in their reflectances.
SceneDescription corner(float floor, float wall) {
  SceneDescription scene = studio("mug", {paper_sun_sky(), ConstantLight{20}}, floor);
  scene.surfaces.push_back({box({-3, -0.1F, 0.8F}, {3, 2, 1}), wall});
  return scene;
}

RenderRequest corner_request(Tracer tracer) {
  RenderRequest request{.material = {30, 0.8, 0.3}, .sample_count = 128};
  request.tracer = tracer;
  return request;
}

const std::vector<Parameter> kAllOfTheCorner{{Parameter::kReflectance, 0},
                                             {Parameter::kReflectance, 1},
                                             {Parameter::kLightScale, 0},
                                             {Parameter::kLightScale, 1},
                                             {Parameter::kAlbedo}};

// Central differences with common random numbers. They are exact up to the third derivative, of
// paths of three reflections, times the square of the step.
TEST(SceneDerivativeTest, InReflectancesEqualsFiniteDifference) {
  constexpr float kFloor = 0.4F, kWall = 0.6F, kStep = 0.05F;
  constexpr int kBatches = 24;
  RenderRequest request = corner_request(Tracer::kWavefront);
  const auto slope = [&](float floor_step, float wall_step) {
    const Scene above(corner(kFloor + floor_step, kWall + wall_step));
    const Scene below(corner(kFloor - floor_step, kWall - wall_step));
    std::vector<double> slopes;
    for (request.seed = 1000; request.seed < 1000 + kBatches; ++request.seed) {
      slopes.push_back((film_mean(render_grad(above, request), -1) -
                        film_mean(render_grad(below, request), -1)) /
                       double{2 * kStep});
    }
    return over_batches(slopes);
  };
  const Estimated by_floor = slope(kStep, 0), by_wall = slope(0, kStep);
  request.derivatives = kAllOfTheCorner;
  const FilmEstimate film = estimate_film(Scene(corner(kFloor, kWall)), request, kBatches);
  expect_equal(film.derivatives[0], by_floor, 2, "d / d reflectance of the floor");
  expect_equal(film.derivatives[1], by_wall, 2, "d / d reflectance of the wall");
  expect_resolution(film.derivatives[0], by_floor.mean, 0.02, "floor");
  expect_resolution(film.derivatives[1], by_wall.mean, 0.02, "wall");
}

// The derivative in a light's scale is the image of this light alone.
TEST(SceneDerivativeTest, InScalesIsTheImageOfThatLight) {
  SceneDescription only_sun = corner(0.4F, 0.6F), only_rest = corner(0.4F, 0.6F);
  only_sun.lights.pop_back();
  only_rest.lights.erase(only_rest.lights.begin());
  const std::vector<SceneDescription> delta_bounce{only_sun, only_rest};
  RenderRequest request = corner_request(Tracer::kWavefront);
  request.derivatives = kAllOfTheCorner;
  const FilmEstimate film = estimate_film(Scene(corner(0.4F, 0.6F)), request, 24);
  request.derivatives.clear();
  for (size_t l = 0; l < delta_bounce.size(); ++l) {
    const Estimated image = estimate_film(Scene(delta_bounce[l]), request, 24, 501).radiance;
    expect_equal(film.derivatives[2 + l], image, 2, "light " + std::to_string(l));
    expect_resolution(film.derivatives[2 + l], image.mean, 0.02, "light");
  }
}

// Surfaces of every brightness, black ones too, where the weight of a path says nothing of what the
// derivative still is.
TEST(SceneDerivativeTest, WavefrontEqualsReference) {
  for (const auto& [floor, wall] : {std::pair{0.0F, 0.6F}, std::pair{0.9F, 0.0F}}) {
    const Scene scene(corner(floor, wall));
    std::vector<FilmEstimate> films;
    for (const Tracer tracer : {Tracer::kReference, Tracer::kWavefront}) {
      RenderRequest request = corner_request(tracer);
      request.derivatives = kAllOfTheCorner;
      request.pilot_spp = tracer == Tracer::kWavefront ? 4 : 0;
      films.push_back(estimate_film(scene, request, 32, tracer == Tracer::kReference ? 1 : 501));
    }
    for (size_t i = 0; i < kAllOfTheCorner.size(); ++i) {
      const std::string what = "floor " + std::to_string(floor) + ", wall " + std::to_string(wall) +
                               ", " + name_of(kAllOfTheCorner[i]);
      expect_equal(films[1].derivatives[i], films[0].derivatives[i], 10, what);
      expect_resolution(films[1].derivatives[i], films[0].derivatives[i].mean, 0.02, what);
    }
  }
}

// A light that moves, and what is rendered under it.
class LightPlace : public ::testing::TestWithParam<const char*> {
 protected:
  struct Case {
    SceneDescription scene;
    std::vector<std::string> names;
    // The light, moved by this along a coordinate.
    std::function<LightDescription(int axis, double by)> light;
    uint32_t samples = 416;
    double step = 0.05;
  };
  static Vec3d moved(Vec3d place, int axis, double by) {
    return place + Vec3d{axis == 0 ? by : 0, axis == 1 ? by : 0, axis == 2 ? by : 0};
  }
  static Case named(const std::string& name) {
    SceneDescription scene = studio("knot", {ConstantLight{1}}, 0.5F);
    if (name == "sun" || name == "rough") {
      // Seen by an object that is turned.
      scene.pose = {Rotation<double>{{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}}, {0, 0.1, 0}};
      const bool rough = name == "rough";
      if (rough) scene.boundary = RoughDielectric{1.3F, 0.8F};
      return {scene,
              {"light[1].directional.direction.x", "light[1].directional.direction.z"},
              [=](int axis, double by) {
                const Vec3d direction{0.5, 0.7, -0.4};
                return DirectionalLight{moved(direction, axis == 1 ? 2 : 0, by), 20,
                                        rough ? 0.5 : 0.05};
              },
              rough ? 8192U : 640U,
              rough ? 0.06 : 0.05};
    }
    if (name == "panel") {
      return {
          scene,
          {"light[1].panel.center.x", "light[1].panel.center.y", "light[1].panel.center.z"},
          [](int axis, double by) {
            return PanelLight{moved({-1, 1.3, -0.7}, axis, by), {0.4, 0.4, 0}, {0, 0.4, 0.5}, 1000};
          }};
    }
    // A lamp that is darker than the sky which it hides.
    const bool dark = name == "dark";
    if (dark) scene.surfaces.clear();
    return {
        scene,
        {"light[1].sphere.center.x", "light[1].sphere.center.y", "light[1].sphere.center.z"},
        [=](int axis, double by) {
          return SphereLight{moved({1.4, 1.3, -0.5}, axis, by), dark ? 0.8 : 0.1, dark ? 0.1 : 600};
        },
        dark ? 6144U : 1152U,
        dark ? 0.1 : 0.05};
  }
};

TEST_P(LightPlace, DerivativesEqualFiniteDifferences) {
  constexpr int kBatches = 32;
  const auto [description, names, light, samples, step] = named(GetParam());
  const auto scene_at = [&](int axis, double by) {
    SceneDescription moved = description;
    moved.lights.push_back(light(axis, by));
    return Scene(std::move(moved));
  };
  RenderRequest request{.material = {8, 0.9, 0.3}, .sample_count = samples};
  for (const std::string& name : names) request.derivatives.push_back(parameter_named(name));
  const FilmEstimate film = estimate_film(scene_at(0, 0), request, kBatches / 2);
  request.derivatives.clear();
  double scale = 0;
  for (const Estimated& derivative : film.derivatives) {
    scale = std::max(scale, std::abs(derivative.mean));
  }
  for (int axis = 0; axis < static_cast<int>(names.size()); ++axis) {
    const Scene above = scene_at(axis, step), below = scene_at(axis, -step);
    std::vector<double> slopes;
    for (request.seed = 1000; request.seed < 1000 + kBatches; ++request.seed) {
      slopes.push_back((film_mean(render_grad(above, request), -1) -
                        film_mean(render_grad(below, request), -1)) /
                       (2 * step));
    }
    const Estimated expected = over_batches(slopes);
    const std::string& what = names[static_cast<size_t>(axis)];
    expect_equal(film.derivatives[static_cast<size_t>(axis)], expected, 11, what);
    expect_resolution(film.derivatives[static_cast<size_t>(axis)], scale, 0.02, what);
    expect_resolution(expected, scale, 0.02, what);
  }
}
INSTANTIATE_TEST_SUITE_P(Cases, LightPlace,
                         ::testing::Values("sun", "rough", "sphere", "dark", "panel"),
                         [](const auto& of) { return of.param; });

}  // namespace
}  // namespace itn::testing
