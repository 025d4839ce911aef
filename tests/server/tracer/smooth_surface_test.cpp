// Opaque meshes that stand for something round.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

constexpr float kWhite = 0.8F;
constexpr double kSmoothAngle = 0.7;

// A ball of triangles at the origin, seen from above; the object is elsewhere.
SceneDescription ball(double smooth_angle, const LightDescription& light) {
  SceneDescription scene;
  scene.object = box({9, 0, 9}, {10, 1, 10});
  scene.surfaces = {{sphere_of_triangles(), kWhite}};
  scene.surfaces.back().smooth_angle = smooth_angle;
  scene.lights = {light};
  scene.camera = {
      .origin = {0.3, 4000, 0.2}, .target = {0.3, 0, 0.2}, .up = {0, 0, 1}, .fov = 0.0002};
  scene.film = {16, 16};
  return scene;
}

// If a pixel of that view sees the unit sphere, and the light stands over it, the radiance is
// reflectance cos / pi.
TEST(SmoothSurfaceTest, IsRound) {
  const DirectionalLight sun{itn::normalize(Vec3d{0.5, 1, -0.3}), 2};
  const auto error = [&](double smooth_angle, Tracer tracer) {
    const Scene scene(ball(smooth_angle, sun));
    RenderRequest request{.material = {1, 0, 0}, .sample_count = 1024};
    request.tracer = tracer;
    const auto radiance = means(render_grad(scene, request)).estimates[0].radiance;
    double squares = 0;
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 16; ++x) {
        // The view is parallel; image x grows along -x, y along -z.
        const double pixel = 2 * 4000 * std::tan(0.0001) / 16;
        const double px = 0.3 - (x - 7.5) * pixel, pz = 0.2 - (y - 7.5) * pixel;
        const Vec3d normal{px, std::sqrt(1 - px * px - pz * pz), pz};
        const double expected = double{kWhite} * 2 * dot(normal, sun.direction) / std::numbers::pi;
        squares += std::pow(double{radiance[static_cast<size_t>(16 * y + x)]} / expected - 1, 2);
      }
    }
    return std::sqrt(squares / 256);
  };
  for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
    EXPECT_LT(error(kSmoothAngle, tracer), 0.004);
    EXPECT_GT(error(0, tracer), 0.01);
  }
}

// Only uniform light that a normal would send through a triangle is lost.
TEST(SmoothSurfaceTest, KeepsTheLightInAFurnace) {
  for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
    const Scene scene(ball(kSmoothAngle, ConstantLight{1}));
    RenderRequest request{.material = {1, 0, 0}, .sample_count = 1024};
    request.tracer = tracer;
    const FilmEstimate film = estimate_film(scene, request, 16);
    EXPECT_LT(film.radiance.mean, double{kWhite} + 5 * film.radiance.standard_error);
    EXPECT_GT(film.radiance.mean, 0.998 * double{kWhite});
  }
}

// Beside a medium, with patterns and a derivative, as the reference sees it.
TEST(SmoothSurfaceTest, TracersAgree) {
  SceneDescription description =
      studio("cube", {ConstantLight{0.3}, DirectionalLight{{0.3, 1, -0.6}, 2}}, 0.5F);
  Mesh round = sphere_of_triangles();
  for (Vec3f& v : round.vertices) v = v * 0.5F + Vec3f{0.85F, 0.5F, -0.45F};
  description.surfaces.push_back({std::move(round), 0.7F});
  description.surfaces.back().smooth_angle = kSmoothAngle;
  const Scene scene(std::move(description));
  const auto film_by = [&](Tracer tracer, uint64_t seed) {
    RenderRequest request{
        .material = {8, 0.8, 0.4}, .sample_count = 288, .derivatives = medium_parameters()};
    request.derivatives.push_back({Parameter::kReflectance, 1});
    request.tracer = tracer;
    return estimate_film(scene, request, 64, seed);
  };
  const FilmEstimate film = film_by(Tracer::kWavefront, 1);
  expect_same_film(film, film_by(Tracer::kReference, 301), 5, "round",
                   {film.radiance.mean / 8, 0, film.radiance.mean / 0.4, 0});
}

}  // namespace
}  // namespace itn::testing
