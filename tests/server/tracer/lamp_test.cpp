// Lamps: closed forms of what they send through air and medium, and the limits in which they are
// far away, or small.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <utility>
#include <variant>
#include <vector>

#include "common/error.h"
#include "server/tracer/scene/compiled_scene.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

using std::numbers::pi;

constexpr double kInverseSquareMm = 1e6;  // from W/sr and mm to W/m^2
constexpr double kReflectance = 0.6;
constexpr Vec3d kSeen{0.03, 0, 0.02};

// Ground at y = 0, seen at kSeen from close above, below all lamps, and an object elsewhere.
SceneDescription seen_ground(std::vector<LightDescription> lights) {
  SceneDescription scene;
  scene.object = box({5, 0, 5}, {6, 1, 6});
  scene.surfaces = {{horizontal_square(0, 20), static_cast<float>(kReflectance)}};
  scene.lights = std::move(lights);
  scene.camera = {
      .origin = kSeen + Vec3d{0, 0.1, 0}, .target = kSeen, .up = {0, 0, 1}, .fov = 2.5e-5};
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
        kReflectance / pi * 7 * kInverseSquareMm * offset.y / std::pow(distance, 3);
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      const Scene scene(seen_ground({PointLight{kSeen + offset, 7}}));
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
    const double phase = (1 - g * g) / (4 * pi * std::pow(1 + g, 3));
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
        .material = {12, 0.7, 0.4}, .sample_count = 192, .derivatives = medium_parameters()};
    request.derivatives.push_back({Parameter::kLightScale, 1});
    return estimate_film(scene, request, 64, seed);
  };
  const FilmEstimate far_away =
      film_of(PointLight{toward * kFar, 3 * kFar * kFar / kInverseSquareMm}, 1);
  const double mean = far_away.radiance.mean;
  expect_same_film(far_away, film_of(DirectionalLight{toward, 3}, 301), 5, "far away",
                   {mean / 12, 0, mean / 0.4, 0});
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
        .material = {12, 0.7, 0.4}, .sample_count = 224, .derivatives = medium_parameters()};
    request.derivatives.push_back({Parameter::kLightScale, 1});
    request.tracer = tracer;
    return estimate_film(scene, request, 64, seed);
  };
  const FilmEstimate film = film_by(Tracer::kWavefront, 1);
  const double mean = film.radiance.mean;
  expect_same_film(film, film_by(Tracer::kReference, 301), 5, "close by",
                   {mean / 12, 0, mean / 0.4, 0});
}

TEST(PointLightTest, StandsOutsideOfTheMedium) {
  SceneDescription scene = studio("cube", {PointLight{{0, 0.5, 0}, 1}});
  EXPECT_THROW(Scene(std::move(scene)), Error);
  EXPECT_THROW(Scene(studio("cube", {PointLight{{0, NAN, 0}, 1}})), Error);
  EXPECT_THROW(Scene(studio("cube", {PointLight{{0, 2, 0}, -1}})), Error);
}

// The irradiance of the ground there, by both tracers, resolved to 1 %.
void expect_irradiance(const LightDescription& lamp, double expected, const char* what) {
  const Scene scene(seen_ground({lamp}));
  for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
    RenderRequest request{.material = {1e3, 0, 0}, .sample_count = 4096};
    request.tracer = tracer;
    const FilmEstimate film = estimate_film(scene, request, 32);
    const double radiance = expected * kReflectance / pi;
    expect_equal(film.radiance, {radiance, 0}, 10, what);
    expect_resolution(film.radiance, radiance, 0.01, what);
  }
}

// A sphere that is above the horizon is as bright as a point in its middle.
TEST(SphereLightTest, LightsTheGround) {
  for (const Vec3d offset : {Vec3d{0, 1.2, 0}, Vec3d{1.5, 1.1, -0.5}, Vec3d{-300, 500, 0}}) {
    const double distance = length(offset);
    expect_irradiance(SphereLight{.center = kSeen + offset, .radius = 1, .radiance = 3},
                      3 * pi / std::pow(distance, 2) * offset.y / distance, "sphere");
  }
}

// A panel over the ground, by the view factor of a rectangle from below a corner (Howell, "A
// catalog of radiation heat transfer configuration factors", B-4).
TEST(PanelLightTest, LightsTheGround) {
  const double a = 0.7, b = 0.4;
  const auto panel = [&](double height, double side) {
    return PanelLight{.center = kSeen + Vec3d{a, height, b},
                      .half_u = {a * side, 0, 0},
                      .half_v = {0, 0, b},
                      .radiance = 5};
  };
  for (const double h : {0.5, 3.0}) {
    const auto term = [&](double c, double d) {
      const double slant = std::hypot(c, h);
      return c / slant * std::atan(d / slant);
    };
    const double view_factor = (term(2 * a, 2 * b) + term(2 * b, 2 * a)) / (2 * pi);
    expect_irradiance(panel(h, 1), 5 * pi * view_factor, "panel");
  }
  const Scene turned_away(seen_ground({panel(0.5, -1)}));
  EXPECT_EQ(film_mean(render_grad(turned_away, {.material = {1e3, 0, 0}, .sample_count = 4}), -1),
            0);
}

// What it sends to the object is at most that of half of all directions, however large it is: that
// decides what roulette thinks little of.
TEST(PanelLightTest, MayBeMuchLargerThanTheObject) {
  const auto over = [](double half) {
    SceneDescription scene = studio("cube", {});
    scene.lights = {PanelLight{{0, -0.6, 0}, {half, 0, 0}, {0, 0, -half}, 1}};
    return Scene(std::move(scene));
  };
  RenderRequest request{.material = {5, 0.9, 0}, .sample_count = 256, .estimates = 1};
  for (const double half : {1e3, 1e5}) {
    request.tracer = Tracer::kReference;
    const FilmEstimate expected = estimate_film(over(half), request, 16, 1000);
    request.tracer = Tracer::kWavefront;
    const FilmEstimate film = estimate_film(over(half), request, 16);
    expect_equal(film.radiance, expected.radiance, 2, fmt::format("half a side of {} mm", half));
    expect_resolution(film.radiance, expected.radiance.mean, 0.02, "panel");
  }
}

// Turned to one side by an angle between its two, it is a point that has faded.
TEST(SpotLightTest, ShinesInACone) {
  constexpr double kInner = 0.3, kOuter = 0.5, kHeight = 2;
  for (const double angle : {0.0, 0.25, 0.4, 0.45, 0.51, 1.7}) {
    const Vec3d position = kSeen + Vec3d{0, kHeight, 0};
    const Vec3d axis{std::sin(angle), -std::cos(angle), 0};
    const double t = std::clamp(
        (std::cos(angle) - std::cos(kOuter)) / (std::cos(kInner) - std::cos(kOuter)), 0.0, 1.0);
    const double expected = 2 * 1e6 / (kHeight * kHeight) * t * t * (3 - 2 * t);
    const Scene scene(seen_ground({SpotLight{position, position + axis * 7, 2, kInner, kOuter}}));
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      RenderRequest request{.material = {1e3, 0, 0}, .sample_count = 4};
      request.tracer = tracer;
      EXPECT_NEAR(film_mean(render_grad(scene, request), -1), expected * kReflectance / pi,
                  1e-4 * expected + 1e-9)
          << angle;
    }
  }
}

// Turned away it changes nothing, and what else shines counts once.
TEST(SpotLightTest, AddsNothingOutsideOfItsCone) {
  const Vec3d above = kSeen + Vec3d{0, 2, 0};
  const Scene scene(
      seen_ground({ConstantLight{0.5}, SpotLight{above, above + Vec3d{0, 1, 0}, 4e-4, 0.3, 0.5}}));
  for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
    RenderRequest request{.material = {1e3, 0, 0}, .sample_count = 1024};
    request.tracer = tracer;
    expect_equal(estimate_film(scene, request, 32).radiance, {kReflectance * 0.5, 0}, 4, "turned");
  }
}

constexpr double kSize = 0.02, kRadiance = 1000;

FilmEstimate film_of(const LightDescription& lamp, uint64_t seed) {
  const Scene scene(studio("smooth_star", {ConstantLight{0.005}, lamp}));
  RenderRequest request{
      .material = {12, 0.7, 0.4}, .sample_count = 256, .derivatives = medium_parameters()};
  request.derivatives.push_back({Parameter::kLightScale, 1});
  return estimate_film(scene, request, 64, seed);
}
// What the image changes with the logarithms of sigma_t and g at most.
std::vector<double> scales_of(const FilmEstimate& film) {
  return {film.radiance.mean / 12, 0, film.radiance.mean / 0.4, 0};
}

// Small ones are points, in all that is rendered of a medium.
TEST(LampTest, IsAPointWhereItIsSmall) {
  const Vec3d position{0.9, 1.2, -0.6};
  const PointLight point{position, kRadiance * pi * kSize * kSize / 1e6};
  const FilmEstimate sphere = film_of(SphereLight{position, kSize, kRadiance}, 1);
  expect_same_film(sphere, film_of(point, 301), 5, "sphere", scales_of(sphere));
}

// From afar, a panel that faces the object is a spot that shines on it: the cosine is 1 to half a
// per cent.
TEST(LampTest, IsASpotWhereItIsFarAway) {
  const Vec3d target{0, 0.5, 0}, position{4.5, 6, -3};
  const Vec3d u = itn::normalize(cross(target - position, Vec3d{0, 1, 0})) * kSize;
  const Vec3d v = cross(itn::normalize(target - position), u);
  const FilmEstimate panel = film_of(PanelLight{position, u, v, kRadiance}, 1);
  const SpotLight spot{position, target, kRadiance * 4 * kSize * kSize / 1e6, 0.4, 0.5};
  expect_same_film(panel, film_of(spot, 301), 5, "panel", scales_of(panel));
}

// Close by, as the reference sees them: over an object in a pose.
TEST(LampTest, AgreesWithTheReference) {
  SceneDescription description =
      studio("smooth_star",
             {SphereLight{{0.9, 1.2, -0.6}, 0.3, 2},
              PanelLight{{-0.8, 1.1, -0.2}, {0.3, 0.3, 0}, {0, 0.3, 0.2}, 6},
              SpotLight{{0.2, 1.5, -1}, {0, 0.4, 0}, 2e-6, 0.1, 0.3}},
             0.5F);
  description.pose = {.rotation = {Vec3d{0, 0.6, -0.8}, Vec3d{0, 0.8, 0.6}, Vec3d{1, 0, 0}},
                      .translation = {0.1, 0.2, 0.1}};
  const Scene scene(std::move(description));
  const auto film_by = [&](Tracer tracer, uint64_t seed) {
    RenderRequest request{
        .material = {8, 0.7, 0.4}, .sample_count = 384, .derivatives = medium_parameters()};
    for (const uint32_t light : {0U, 1U, 2U}) {
      request.derivatives.push_back({Parameter::kLightScale, light});
    }
    request.tracer = tracer;
    return estimate_film(scene, request, 64, seed);
  };
  const FilmEstimate film = film_by(Tracer::kWavefront, 1);
  expect_same_film(film, film_by(Tracer::kReference, 301), 7, "close by",
                   {film.radiance.mean / 8, 0, film.radiance.mean / 0.4, 0, 0, 0});
}

// The camera sees them as bright as they are, from the side that shines, and they hide the rest.
TEST(LampTest, IsSeen) {
  const Vec3d position{0, 3, 0};
  const struct {
    LightDescription lamp;
    double radiance;
  } cases[] = {{SphereLight{position, 0.5, 7}, 7},
               {SphereLight{position, 0.5, 0}, 0},
               {PanelLight{position, {0.5, 0, 0}, {0.1, 0, 0.5}, 7}, 0},
               {PanelLight{position, {0.5, 0, 0}, {0.1, 0, -0.5}, 7}, 7}};
  for (const auto& [lamp, radiance] : cases) {
    SceneDescription scene = seen_ground({ConstantLight{2}, lamp});
    scene.camera = {.origin = {0.2, 5, 0.1}, .target = {0.2, 0, 0.1}, .up = {0, 0, 1}, .fov = 0.01};
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      for (const double beside : {0.0, 0.9}) {
        SceneDescription shown = scene;
        shown.camera.origin.x += beside;
        shown.camera.target = shown.camera.origin - Vec3d{0, 1, 0};
        RenderRequest request{.material = {1e3, 0, 0}, .sample_count = 4};
        request.tracer = tracer;
        const double seen = film_mean(render_grad(Scene(std::move(shown)), request), -1);
        if (beside == 0) {
          EXPECT_NEAR(seen, radiance, 1e-6);
        } else {
          EXPECT_GT(std::abs(seen - radiance), 0.01);
        }
      }
    }
  }
}

// Light of a constant sky and from lamps behind them does not come through.
TEST(LampTest, HidesWhatIsBehindIt) {
  const double size = 1, height = 1.5;
  const SphereLight ball{kSeen + Vec3d{0, height, 0}, size, 0};
  const double hidden = std::pow(size / height, 2);  // of the irradiance of a constant sky
  const PanelLight black{kSeen + Vec3d{0, height, 0}, {1, 0, 0}, {0, 0, -1}, 3};
  const Vec3d above = kSeen + Vec3d{0.1, 4, 0.2};
  const struct {
    std::vector<LightDescription> lights;
    double irradiance;
  } cases[] = {{{ConstantLight{2}, ball}, 2 * pi * (1 - hidden)},
               {{PointLight{above, 2e-4}, ball, ConstantLight{0.1}}, 0.1 * pi * (1 - hidden)},
               {{DirectionalLight{{0, 1, 0}, 2}, black, SphereLight{above, 0.1, 1e3}}, 0},
               {{PanelLight{above, {0.2, 0, 0}, {0, 0, 0.2}, 50}, ball, ConstantLight{1}},
                pi * (1 - hidden)}};
  for (const auto& [lights, irradiance] : cases) {
    const Scene scene(seen_ground(lights));
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      RenderRequest request{.material = {1e3, 0, 0}, .sample_count = 4096};
      for (uint32_t i = 0; i < lights.size(); ++i) {
        request.derivatives.push_back({Parameter::kLightScale, i});
      }
      request.tracer = tracer;
      const FilmEstimate film = estimate_film(scene, request, 32);
      const double radiance = irradiance * kReflectance / pi;
      if (irradiance == 0) {
        EXPECT_EQ(film.radiance.mean, 0);
        continue;
      }
      expect_equal(film.radiance, {radiance, 0}, 12, "beside it");
      expect_resolution(film.radiance, radiance, 0.01, "beside it");
      // All that arrives is the constant's.
      for (uint32_t i = 0; i < lights.size(); ++i) {
        const bool constant = std::holds_alternative<ConstantLight>(lights[i]);
        EXPECT_NEAR(film.derivatives[i].mean, constant ? film.radiance.mean : 0, 1e-5 * radiance);
      }
    }
  }
}

// The pixels that see the object: none, where a lamp stands in front of it.
TEST(LampTest, HidesTheObject) {
  const auto pixels = [](double x) {
    SceneDescription scene = studio("cube", {PanelLight{{x, 0.5, -2}, {1, 0, 0}, {0, 1, 0}, 3}});
    scene.camera = {.origin = {0, 0.5, -4}, .target = {0, 0.5, 0}};
    return Scene(std::move(scene)).compiled().object_pixels().size();
  };
  EXPECT_EQ(pixels(0), 0);
  EXPECT_GT(pixels(3), 0);
  const size_t free = pixels(3), half = pixels(-1);
  EXPECT_GT(half, free / 3);
  EXPECT_LT(half, free * 2 / 3);
}

TEST(LampTest, RefusesWhatCannotStand) {
  const auto refuses = [](const LightDescription& light) {
    EXPECT_THROW(Scene(studio("cube", {light})), Error);
  };
  refuses(SphereLight{{0, 0.5, 0}, 0.1, 1});  // in the object
  refuses(SphereLight{{0, 1.5, 0}, 2, 1});    // around it
  refuses(SphereLight{{0, 3, 0}, 0, 1});      // of no size
  refuses(PanelLight{{0, 3, 0}, {1, 0, 0}, {2, 0, 0}, 1});
  refuses(PanelLight{{0, 3, 0}, {1, 0, 0}, {0, 0, 1}, -1});
  refuses(SpotLight{{0, 3, 0}, {0, 3, 0}, 1});  // turned to nothing
  refuses(SpotLight{{0, 3, 0}, {0, 0, 0}, 1, 0.5, 0.4});
}

// A lamp that is partly in what refracts light would send too little inside. It may touch it.
TEST(LampTest, IsNotPartlyInsideOfWhatRefracts) {
  const auto message = [](const LightDescription& light, const Boundary& boundary,
                          double turn = 0) -> std::string {
    SceneDescription scene = studio("cube", {ConstantLight{1}, light});
    scene.boundary = boundary;
    scene.pose.rotation = turned_back(turn);
    try {
      Scene(std::move(scene)).compiled();
      return "";
    } catch (const Error& error) {
      return error.what();
    }
  };
  const std::string
      sphere =
          "lights[1].sphere is partly inside of an object that refracts light; a lamp "
          "must stand outside of it, and may touch it",
      panel = "lights[1].panel" + sphere.substr(sphere.find(' '));
  const auto ball = [](double x) { return SphereLight{{x, 0.5, 0.1}, 0.3, 1}; };
  const auto level = [](double x, double y) {
    return PanelLight{{x, y, 0}, {0, 0, 0.3}, {0.4, 0, 0}, 1};
  };
  for (const Boundary& boundary : {Boundary(Dielectric{1.3F}), Boundary(RoughDielectric{})}) {
    EXPECT_EQ(message(ball(0.75), boundary), sphere);
    EXPECT_EQ(message(ball(0.79999), boundary), sphere);
    EXPECT_EQ(message(ball(0.8), boundary), "");  // the cube ends at x = 0.5
    EXPECT_EQ(message(ball(0.8), boundary, 0.4), sphere);
    EXPECT_EQ(message(level(0.6, 0.4), boundary), panel);
    EXPECT_EQ(message(level(0.89999, 0.4), boundary), panel);
    EXPECT_EQ(message(level(0.9, 0.4), boundary), "");
    EXPECT_EQ(message(level(0, 0), boundary), "");  // the cube stands on it
    EXPECT_EQ(message(level(0, 1), boundary), "");
    EXPECT_EQ(message(level(0.6, 1e-4), boundary), panel);
    EXPECT_EQ(message(level(0.6, -1e-4), boundary), "");
  }
  EXPECT_EQ(message(ball(0.75), IndexMatched{}), "");
  EXPECT_EQ(message(ball(0.75), Dielectric{1}), "");
}

}  // namespace
}  // namespace itn::testing
