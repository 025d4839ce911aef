// Boundaries at which lines stop, by a kind whose effect is known.
#include "server/tracer/boundary/boundary.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <numbers>
#include <string>

#include "common/angle.h"
#include "common/error.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;
constexpr Tracer kTracers[] = {Tracer::kWavefront, Tracer::kReference};

// What a call is refused with; nothing if it is not.
template <typename Call>
std::string message_of(const Call& call) {
  try {
    call();
    return "";
  } catch (const Error& error) {
    return error.what();
  }
}

// Fresnel's reflectance, by the cosines on both sides.
double reflectance(double cosine, double refracted, double index) {
  const double r_s = (cosine - index * refracted) / (cosine + index * refracted);
  const double r_p = (index * cosine - refracted) / (index * cosine + refracted);
  return (r_s * r_s + r_p * r_p) / 2;
}

std::string name_of(Tracer tracer) {
  return tracer == Tracer::kWavefront ? "wavefront" : "reference";
}

// A slab under a constant light, seen under an angle to its normal. It is wide.
constexpr double kChord = 0.7;
SceneDescription slab(double thickness = kChord, double angle = 0) {
  SceneDescription description;
  const auto half = static_cast<float>(100 * thickness);
  description.object = box({-half, 0, -half}, {half, static_cast<float>(thickness), half});
  description.lights = {ConstantLight{1}};
  const Vec3d target{0.03, thickness, 0.02};
  description.camera = {.origin = target + Vec3d{5 * std::sin(angle), 5 * std::cos(angle), 0},
                        .target = target,
                        .up = {0, 0, 1},
                        .fov = 1e-4 / 5};
  description.film = {4, 4};
  return description;
}

// A knot on a ground, whose lines cross the boundary many times.
SceneDescription knot_on_ground(LightDescription light) {
  return studio("knot", {std::move(light)}, 0.5F);
}

RenderRequest request_for(Tracer tracer, Material material, uint32_t samples) {
  RenderRequest request{.material = material, .sample_count = samples};
  request.derivatives = medium_parameters();
  request.tracer = tracer;
  return request;
}

RenderRequest image_request(Tracer tracer, Material material, uint32_t samples) {
  RenderRequest request = request_for(tracer, material, samples);
  request.derivatives.clear();
  return request;
}

// A boundary that lets all pass lets the image be, in expectation: flights are drawn anew at every
// crossing, and the walk finds alone what shadow rays found.
TEST(BoundaryTest, AMirrorOfNothingIsIndexMatchedInExpectation) {
  SceneDescription description = knot_on_ground(ConstantLight{1});
  const Scene scene(description);
  description.boundary = PartialMirror{};
  const Scene behind_mirror(std::move(description));
  for (const Tracer tracer : kTracers) {
    RenderRequest request = request_for(tracer, {5, 0.9, 0.3}, 128);
    request.derivatives.push_back({Parameter::kReflectance, 0});
    const FilmEstimate plain = estimate_film(scene, request, 32);
    const FilmEstimate stopped = estimate_film(behind_mirror, request, 32, 1000);
    expect_equal(stopped.radiance, plain.radiance, 10, name_of(tracer) + " radiance");
    expect_resolution(stopped.radiance, plain.radiance.mean, 0.02, "radiance");
    for (size_t i = 0; i < request.derivatives.size(); ++i) {
      expect_equal(stopped.derivatives[i], plain.derivatives[i], 10,
                   name_of(tracer) + " d / d " + tracer::name_of(request.derivatives[i]));
    }
    EXPECT_EQ(stopped.counters.leaks, 0U);
  }
}

// A slab between two mirrors of reflectance R, transmittance T and the dimming a = exp(-sigma_t d)
// between them, without scattering, at sigma_t = 1: what comes back and what comes through are
// geometric series, which together make
//   L = R + T^2 a / (1 - R a),    dL/dsigma_t = -d T^2 a / (1 - R a)^2.
struct BetweenMirrors {
  double radiance, slope;
};
BetweenMirrors between_mirrors(double reflected, double passed, double length) {
  const double a = std::exp(-length), back = 1 - reflected * a, through = passed * passed * a;
  return {reflected + through / back, -length * through / (back * back)};
}

TEST(BoundaryTest, ReflectsBetweenTwoMirrors) {
  for (const auto& [reflected, absorbed] : {std::pair{0.4, 0.0}, {0.4, 0.2}, {0.0, 0.3}}) {
    SceneDescription description = slab();
    description.boundary =
        PartialMirror{static_cast<float>(reflected), static_cast<float>(absorbed)};
    const Scene scene(std::move(description));
    for (const Tracer tracer : kTracers) {
      const FilmEstimate film = estimate_film(scene, request_for(tracer, {1, 0, 0}, 2048), 32);
      const auto [expected, slope] = between_mirrors(reflected, 1 - reflected - absorbed, kChord);
      expect_equal(film.radiance, {expected, 0}, 12, name_of(tracer) + " radiance");
      expect_resolution(film.radiance, expected, 0.01, "radiance");
      expect_equal(film.derivatives[kSigmaT], {slope, 0}, 12, name_of(tracer) + " d / d sigma_t");
      expect_resolution(film.derivatives[kSigmaT], slope, 0.05, "d / d sigma_t");
    }
  }
}

// If nothing is lost, all has the light's radiance, however the boundary mirrors or refracts.
TEST(BoundaryTest, AnObjectVanishesInAFurnace) {
  for (const Boundary& boundary :
       {Boundary(PartialMirror{.reflected = 0.5F}), Boundary(Dielectric{1}),
        Boundary(Dielectric{1.5F}), Boundary(Dielectric{2.5F})}) {
    for (const auto& [shape, smooth_angle] :
         {std::pair{"cube", 0.0}, {"knot", 0.0}, {"knot", 1.0}, {"smooth_star", 3.0}}) {
      SceneDescription description = studio(shape, {ConstantLight{1}});
      description.boundary = boundary;
      description.smooth_angle = smooth_angle;
      const Scene scene(std::move(description));
      for (const Tracer tracer : kTracers) {
        const FilmEstimate film = estimate_film(scene, image_request(tracer, {3, 1, 0.5}, 64), 32);
        // A rough one loses or wins some 1e-4 at each of some crossings, as its tables do.
        const double rounding = is_delta(boundary) ? 1e-6 : 2e-3;
        EXPECT_NEAR(film.radiance.mean, 1, 4 * film.radiance.standard_error + rounding)
            << name_of(tracer) << " " << shape;
        expect_resolution(film.radiance, 1, 0.02, "furnace");
        EXPECT_EQ(film.counters.leaks, 0U);
      }
    }
  }
}

// An object that stands on something is one that is held just above it.
void expect_to_stand(const SceneDescription& below, const std::string& what) {
  for (const Boundary& boundary :
       {Boundary(Dielectric{1.3F}), Boundary(RoughDielectric{1.3F, 0.4F}), Boundary(Dielectric{1}),
        Boundary(IndexMatched{})}) {
    const auto at_height = [&](float height) {
      SceneDescription description = below;
      description.object = box({-0.4F, height, -0.4F}, {0.4F, height + 0.3F, 0.4F});
      description.camera.origin = {0, 30, -10};
      description.boundary = boundary;
      return Scene(std::move(description));
    };
    const Scene standing = at_height(0), held = at_height(1e-4F);
    for (const Tracer tracer : kTracers) {
      const RenderRequest request = image_request(tracer, {3, 0.95, 0.5}, 64);
      const FilmEstimate stands = estimate_film(standing, request, 32);
      const FilmEstimate is_held = estimate_film(held, request, 32, 101);
      const std::string name = what + ", " + name_of(tracer);
      expect_equal(stands.radiance, is_held.radiance, 16, name);
      expect_resolution(difference(stands.radiance, is_held.radiance), is_held.radiance.mean, 0.02,
                        name);
    }
  }
}

// What leaves it below is reflected once.
TEST(BoundaryTest, AnObjectStandsOnTheGround) {
  expect_to_stand(studio("cube", {ConstantLight{1}}, 0.6F), "ground");
}

// Light from there goes through the boundary.
TEST(BoundaryTest, AnObjectStandsOnAPanel) {
  PanelLight panel;
  panel.half_u = {0, 0, 1};
  panel.half_v = {1, 0, 0};
  expect_to_stand(studio("cube", {panel}), "panel");
}

// Inside, the radiance is index^2 times that of the light outside.
TEST(DielectricTest, RadianceInsideGrowsWithTheSquareOfTheIndex) {
  SceneDescription description = studio("sphere", {ConstantLight{1}});
  description.camera = {.origin = {0, 0.5, 0}, .target = {0, 0.5, 1}};
  description.boundary = Dielectric{1.5F};
  const Scene scene(std::move(description));
  for (const Tracer tracer : kTracers) {
    const FilmEstimate film = estimate_film(scene, image_request(tracer, {3, 1, 0.5}, 128), 32);
    EXPECT_NEAR(film.radiance.mean, 2.25, 4 * film.radiance.standard_error + 1e-6);
    expect_resolution(film.radiance, 2.25, 0.02, name_of(tracer));
  }
}

// Fresnel at right angles: what lets no light out again mirrors ((n - 1) / (n + 1))^2 of it.
TEST(DielectricTest, ABlackBodyMirrorsByFresnel) {
  for (const double index : {1.5, 2.5}) {
    SceneDescription description = slab();
    description.boundary = Dielectric{static_cast<float>(index)};
    const Scene scene(std::move(description));
    const double expected = std::pow((index - 1) / (index + 1), 2);
    for (const Tracer tracer : kTracers) {
      const std::string what = fmt::format("{} {}", name_of(tracer), index);
      const FilmEstimate film = estimate_film(scene, image_request(tracer, {1000, 0, 0}, 4096), 32);
      expect_equal(film.radiance, {expected, 1e-5 * expected}, 4, what);
      expect_resolution(film.radiance, expected, 0.02, what);
    }
  }
}

// Snell's cone: upwards from inside a slab that absorbs, one sees index^2 times the series of what
// comes through; beyond the critical angle (41.81 degrees) all is mirrored, and there is nothing.
TEST(DielectricTest, NoLightComesFromBeyondSnellsCone) {
  constexpr double kIndex = 1.5, kDepth = 0.2;
  SceneDescription description = slab();
  description.boundary = Dielectric{kIndex};
  for (const double degrees : {0.0, 30.0, 41.5, 42.1, 60.0}) {
    const double angle = degrees * kRadiansPerDegree, cosine = std::cos(angle);
    const Vec3d origin{0.03, kChord - kDepth, 0.02};
    description.camera = {.origin = origin,
                          .target = origin + Vec3d{std::sin(angle), cosine, 0},
                          .up = {0, 0, 1},
                          .fov = 1e-4};
    const double sine_outside = kIndex * std::sin(angle);
    double expected = 0;
    if (sine_outside < 1) {
      const double mirrored =
          reflectance(std::sqrt(1 - sine_outside * sine_outside), cosine, kIndex);
      expected = kIndex * kIndex * (1 - mirrored) * std::exp(-kDepth / cosine) /
                 (1 - mirrored * std::exp(-kChord / cosine));
    }
    const Scene scene{SceneDescription(description)};
    for (const Tracer tracer : kTracers) {
      const std::string what = fmt::format("{} at {}", name_of(tracer), degrees);
      const FilmEstimate film = estimate_film(scene, image_request(tracer, {1, 0, 0}, 1280), 32);
      if (expected == 0) {
        EXPECT_EQ(film.radiance.mean, 0) << what;
      } else {
        expect_equal(film.radiance, {expected, 0}, 6, what);
        expect_resolution(film.radiance, expected, 0.01, what);
      }
    }
  }
}

// In a thin body, total internal reflection keeps light for hundreds of crossings between two
// scatterings. All that is lost of a light from everywhere is absorbed there.
TEST(DielectricTest, CaughtLightCounts) {
  SceneDescription description = studio("cube", {ConstantLight{1}});
  description.boundary = Dielectric{1.7F};
  const Scene scene(std::move(description));
  const auto film_of = [&](Tracer tracer) {
    return estimate_film(scene, request_for(tracer, {0.15, 0.99, 0.9}, 768), 32);
  };
  const FilmEstimate film = film_of(Tracer::kWavefront), expected = film_of(Tracer::kReference);
  expect_equal(film.radiance, expected.radiance, 2, "radiance");
  expect_equal(film.derivatives[kAlbedo], expected.derivatives[kAlbedo], 2, "d / d albedo");
  expect_resolution(film.derivatives[kAlbedo], expected.derivatives[kAlbedo].mean, 0.02, "ours");
  expect_resolution(expected.derivatives[kAlbedo], expected.derivatives[kAlbedo].mean, 0.03,
                    "reference");
}

// A slab that absorbs: the series of ReflectsBetweenTwoMirrors, with Fresnel's reflectances, and
// the length of the way that Snell's law gives.
TEST(DielectricTest, ASlabThatAbsorbsReflectsAndRefracts) {
  for (const auto& [index, degrees] :
       {std::pair{1.33, 0.0}, {1.5, 0.0}, {2.5, 0.0}, {1.5, 50.0}, {1.5, 80.0}, {1.0, 50.0}}) {
    const double angle = degrees * kRadiansPerDegree, cosine = std::cos(angle);
    SceneDescription description = slab(kChord, angle);
    description.boundary = Dielectric{static_cast<float>(index)};
    const Scene scene(std::move(description));
    const double refracted = std::sqrt(1 - std::pow(std::sin(angle) / index, 2));
    const double reflected = reflectance(cosine, refracted, index);
    const auto [expected, slope] = between_mirrors(reflected, 1 - reflected, kChord / refracted);
    for (const Tracer tracer : kTracers) {
      const std::string what = fmt::format("{} {} at {}", name_of(tracer), index, degrees);
      const FilmEstimate film = estimate_film(scene, request_for(tracer, {1, 0, 0}, 1280), 32);
      expect_equal(film.radiance, {expected, 0}, 24, what);
      expect_resolution(film.radiance, expected, 0.01, what);
      expect_equal(film.derivatives[kSigmaT], {slope, 0}, 24, what + " d / d sigma_t");
      expect_resolution(film.derivatives[kSigmaT], slope, 0.05, what);
    }
  }
}

// A sphere of glass, seen from far, under light that is 1 + y from direction (x, y, z). A path
// meets the sphere under one angle theta all the time, whose sine is the distance of its line to
// the middle; it goes on turned by pi - 2 theta if it is reflected outside, and by 2 (theta -
// theta') + k (pi - 2 theta') after k reflections inside, with theta' the angle inside.
TEST(DielectricTest, ASphereOfTrianglesIsASphere) {
  constexpr double kIndex = 1.5, kHalf = 0.64, kDistance = 1000, kPi = std::numbers::pi;
  constexpr int kPixels = 16;
  const auto expected = [](double x, double y) {
    const double sine = std::hypot(x, y), theta = std::asin(sine);
    const double inside = std::asin(sine / kIndex), cosine = std::cos(theta),
                 refracted = std::cos(inside);
    const double r = reflectance(cosine, refracted, kIndex);
    const auto light = [&](double turn) {
      return 1 - std::sin(turn) * y / sine;
    };  // towards the axis
    double sum = r * light(2 * theta - kPi);
    for (int k = 0; k < 30; ++k) {
      sum +=
          (1 - r) * (1 - r) * std::pow(r, k) * light(2 * (theta - inside) + k * (kPi - 2 * inside));
    }
    return sum;
  };
  const auto error = [&](double smooth_angle, Tracer tracer) {
    EnvironmentMapLight map{.width = 4, .height = 256, .rgb = {}, .scale = 1, .rotate_y = 0};
    for (int p = 0; p < 3 * map.width * map.height; ++p) {
      const int row = p / (3 * map.width);
      map.rgb.push_back(static_cast<float>(1 + std::cos(kPi * (row + 0.5) / map.height)));
    }
    SceneDescription description;
    description.object = sphere_of_triangles();
    description.smooth_angle = smooth_angle;
    description.boundary = Dielectric{static_cast<float>(kIndex)};
    description.lights = {map};
    description.camera = {
        .origin = {0, 0, kDistance}, .target = {}, .fov = 2 * std::atan(kHalf / kDistance)};
    description.film = {kPixels, kPixels};
    RenderRequest request = request_for(tracer, {1e-6, 1, 0}, 8192);
    request.derivatives.clear();
    const FilmSums sums = render_grad(Scene(std::move(description)), request);
    const auto& estimate = sums.estimates[0];
    double squares = 0;
    for (size_t p = 0; p < kPixels * kPixels; ++p) {
      const auto at = [&](size_t pixel) {
        return kHalf * ((2 * static_cast<double>(pixel) + 1) / kPixels - 1);
      };
      const double truth = expected(at(p % kPixels), -at(p / kPixels));
      const double got =
          sums.quantum * static_cast<double>(estimate.radiance[p]) / estimate.counts[p];
      squares += (got / truth - 1) * (got / truth - 1) / (kPixels * kPixels);
    }
    return std::sqrt(squares);
  };
  for (const Tracer tracer : kTracers) {
    const double flat = error(0, tracer), smooth = error(0.5, tracer);
    std::printf("  %s: root mean square error %.4f flat, %.4f smooth\n", name_of(tracer).c_str(),
                flat, smooth);
    EXPECT_LT(smooth, 0.004);
    EXPECT_GT(flat, 2 * smooth);
  }
}

// Light that it mirrors to the camera is no noise: here there is no other.
TEST(DielectricTest, AMirroredLightIsNoNoise) {
  constexpr double kAngle = 0.6;
  SceneDescription description = slab(kChord, kAngle);
  description.boundary = Dielectric{1.5F};
  description.lights = {DirectionalLight{{-std::sin(kAngle), std::cos(kAngle), 0}, 1, 0.02}};
  const RenderedImages images =
      means(render_grad(Scene(std::move(description)),
                        {.material = {1000, 0, 0}, .sample_count = 64, .estimates = 1}));
  const double c = std::cos(kAngle), t = std::sqrt(1 - (1 - c * c) / 2.25);
  const double r_s = (c - 1.5 * t) / (c + 1.5 * t), r_p = (1.5 * c - t) / (1.5 * c + t);
  const double sun = 1 / (std::numbers::pi * std::pow(std::sin(0.02), 2));
  for (size_t p = 0; p < images.mask.size(); ++p) {
    const double radiance = double{images.estimates[0].radiance[p]};
    EXPECT_NEAR(radiance, (r_s * r_s + r_p * r_p) / 2 * sun, 1e-3 * radiance);
    EXPECT_LT(double{images.standard_error[p]}, 1e-3 * radiance);
  }
}

// Slabs that scatter, under light from above and below: the sum of the total reflectance and
// transmittance for a beam at right angles, by the adding-doubling method (iadpython 0.5, 32
// quadrature points; the thick one 0.2600 by Giovanelli, "Reflection by semi-infinite diffusers",
// Optica Acta 1955).
TEST(DielectricTest, SlabsThatScatterByAddingDoubling) {
  struct Row {
    double albedo, optical_thickness, g, index, expected;
  };
  for (const Row& row :
       {Row{0.9, 60, 0, 1.5, 0.25994}, Row{0.9, 1, 0, 1.5, 0.22200 + 0.50596},
        Row{0.95, 10, 0.5, 1.33, 0.29161 + 0.05567}, Row{0.8, 2, 0, 1, 0.26591 + 0.28593}}) {
    SceneDescription description = slab();
    description.boundary = Dielectric{static_cast<float>(row.index)};
    const Scene scene(std::move(description));
    for (const Tracer tracer : kTracers) {
      const FilmEstimate film = estimate_film(
          scene, image_request(tracer, {row.optical_thickness / kChord, row.albedo, row.g}, 512),
          32);
      const std::string what = fmt::format("{} {}", name_of(tracer), row.expected);
      expect_equal(film.radiance, {row.expected, 1e-4}, 8, what);
      expect_resolution(film.radiance, row.expected, 0.01, what);
    }
  }
}

// However much wider than thick a slab is: the paths of its light are as long, and what looks for
// the boundary knows only where a cell of it is. The truth is that of the test before.
TEST(DielectricTest, SlabsMayBeWide) {
  constexpr double kExpected = 0.402967 + 0.121716;
  for (const float half : {20.0F, 200.0F, 1000.0F}) {
    SceneDescription description = slab(1);
    description.object = box({-half, 0, -half}, {half, 1, half});
    description.boundary = Dielectric{1.33F};
    const FilmEstimate film =
        estimate_film(Scene(std::move(description)),
                      {.material = {5, 0.95, 0}, .sample_count = 256, .estimates = 1}, 32);
    const std::string what = fmt::format("{} times as wide as thick", 2 * half);
    expect_equal(film.radiance, {kExpected, 1e-4}, 3, what);
    expect_resolution(film.radiance, kExpected, 0.01, what);
    EXPECT_EQ(film.counters.leaks, 0U) << what;
  }
}

// With all derivatives, each resolved by its own size, or by this part of the radiance: what the
// image changes with the logarithm of the parameter at most.
void expect_tracers_agree(const Scene& scene, RenderRequest request, int comparisons,
                          const std::string& what, std::vector<double> parts) {
  request.tracer = Tracer::kWavefront;
  const FilmEstimate wavefront = estimate_film(scene, request, 32);
  request.tracer = Tracer::kReference;
  const FilmEstimate reference = estimate_film(scene, request, 32, 1000);
  for (double& part : parts) part *= wavefront.radiance.mean;
  expect_same_film(wavefront, reference, comparisons, what, parts);
}

// Both tracers, between surfaces and under a light that is not the same everywhere.
TEST(DielectricTest, TracersAgree) {
  SceneDescription description = knot_on_ground(paper_sun_sky());
  description.boundary = Dielectric{1.5F};
  const Scene scene(std::move(description));
  RenderRequest request = request_for(Tracer::kWavefront, {5, 0.9, 0.3}, 1024);
  request.derivatives.push_back({Parameter::kReflectance, 0});
  request.derivatives.push_back({Parameter::kLightScale, 0});
  expect_tracers_agree(scene, request, 6, "a dielectric knot", {1 / 5.0, 0, 1 / 0.3});
}

// A rough boundary under every kind of light that a path can, or cannot, find by itself.
SceneDescription rough_knot(float index, float roughness, bool single_scattering = false) {
  SceneDescription description =
      studio("knot", {ConstantLight{1}, DirectionalLight{{0.5, 0.8, -0.3}, 2}}, 0.5F);
  description.boundary = RoughDielectric{index, roughness, single_scattering};
  return description;
}

const Parameter kRoughness = parameter_named("rough_dielectric.roughness");
const Parameter kIndex = parameter_named("rough_dielectric.index");

TEST(RoughDielectricTest, TracersAgree) {
  SceneDescription description = rough_knot(1.5F, 0.25F);
  description.smooth_angle = 1;
  const Scene scene(std::move(description));
  RenderRequest request = request_for(Tracer::kWavefront, {5, 0.7, 0.3}, 1280);
  request.derivatives.push_back(kRoughness);
  request.derivatives.push_back({Parameter::kReflectance, 0});
  request.derivatives.push_back({Parameter::kLightScale, 1});
  expect_tracers_agree(scene, request, 8, "a rough knot", {1 / 5.0, 0, 1 / 0.3, 1 / 0.25});
}

TEST(RoughDielectricTest, TracersAgreeOnTheIndex) {
  SceneDescription description = rough_knot(1.5F, 0.7F);
  description.lights = {ConstantLight{0.3}, DirectionalLight{{0.5, 0.8, -0.3}, 2, 0.5},
                        PanelLight{{-0.8, 1.1, -0.2}, {0.3, 0.3, 0}, {0, 0.3, 0.2}, 3}};
  description.smooth_angle = 1;
  const Scene scene(std::move(description));
  RenderRequest request{.material = {8, 0.6, 0.3}, .sample_count = 768, .derivatives = {kIndex}};
  expect_tracers_agree(scene, request, 2, "a rough knot", {2});
}

// A path that follows an edge does not find it.
TEST(RoughDielectricTest, TheIndexKnowsNoLightWithoutSize) {
  RenderRequest request;
  request.derivatives = {kIndex};
  const auto refused = [&](const LightDescription& light) {
    SceneDescription description = slab();
    description.boundary = RoughDielectric{};
    description.lights = {ConstantLight{1}, light};
    return message_of([&] { validate(request, Scene(std::move(description))); });
  };
  EXPECT_EQ(refused(DirectionalLight{{0, 1, 0}, 2, 0.1}), "");
  for (const LightDescription& light : std::vector<LightDescription>{
           DirectionalLight{}, PointLight{{0, 5, 0}, 1}, SpotLight{{0, 5, 0}, {0, 0, 0}, 1}}) {
    EXPECT_THAT(refused(light),
                ::testing::StartsWith("no derivative in the index of refraction under lights[1]"));
  }
}

// What the walk finds by itself, and what shadow rays find, are the same.
TEST(RoughDielectricTest, TechniquesAgree) {
  SceneDescription description = rough_knot(1.5F, 0.25F);
  description.lights = {paper_sun_sky(), SphereLight{{0.6, 1.2, -0.9}, 0.3, 30},
                        PanelLight{{-0.8, 1.1, -0.2}, {0.3, 0.3, 0}, {-0.1, 0.1, 0.2}, 30}};
  description.object = make_shape("smooth_star");
  description.smooth_angle = 1;
  const Scene scene(std::move(description));
  for (const Tracer tracer : kTracers) {
    const RenderRequest request = image_request(tracer, {5, 0.9, 0.3}, 352);
    const auto by = [&](Switches::Techniques techniques) {
      return estimate_film(scene, request, 32, 1, {.switches = {.techniques = techniques}});
    };
    const FilmEstimate both = by(Switches::Techniques::kBoth);
    for (const auto& alone :
         {by(Switches::Techniques::kLightsOnly), by(Switches::Techniques::kPhaseOnly)}) {
      expect_equal(alone.radiance, both.radiance, 4, name_of(tracer) + " radiance");
      expect_resolution(alone.radiance, both.radiance.mean, 0.02, "radiance");
    }
  }
}

// Shadow rays that are refracted take noise away, and nothing else: seen from outside, under a sun,
// a sky and lamps nearby, some of which hide others; and from inside.
class RefractedShadowRays : public ::testing::TestWithParam<const char*> {
 protected:
  static SceneDescription star(const Boundary& boundary, std::vector<LightDescription> lights) {
    SceneDescription scene = rough_knot(1.5F, 0.5F);
    scene.object = make_shape("smooth_star");
    scene.smooth_angle = 1;
    scene.surfaces.clear();
    scene.boundary = boundary;
    scene.lights = std::move(lights);
    return scene;
  }
  // Lamps of such a radiance.
  static std::vector<LightDescription> lamps(double radiance) {
    return {SphereLight{{0.6, 1.2, -0.9}, 0.3, radiance},
            PanelLight{{-0.8, 1.1, -0.2}, {0.3, 0.3, 0}, {-0.1, 0.1, 0.2}, radiance}};
  }

  struct Case {
    SceneDescription scene;
    Material material;
    uint32_t samples = 3584;
  };
  static Case named(const std::string& name) {
    const Material material{8, 0.85, 0.4};
    if (name == "rough") {
      const PointLight point{.position = {0.6F, 1.2F, -0.9F}, .intensity = 1e-5F};
      return {star(RoughDielectric{1.5F, 0.5F}, {paper_sun_sky(), point}), material};
    }
    if (name == "lamps") {
      std::vector<LightDescription> lights = lamps(1);
      lights.insert(lights.begin() + 1, ConstantLight{0.3});
      lights.emplace_back(SpotLight{{0.2, 1.5, -1}, {0, 0.4, 0}, 1e-6, 0.1, 0.3});
      return {star(RoughDielectric{1.5F, 0.5F}, std::move(lights)), {4, 0.7, 0.4}, 12288};
    }
    if (name == "inside") {
      SceneDescription inside = rough_knot(1.4F, 0.2F);
      inside.object = make_shape("cube");
      inside.camera.origin = {0, 0.5, -0.4};
      inside.camera.fov = 1;
      return {std::move(inside), {3, 0.8, 0.3}};
    }
    std::vector<LightDescription> lights = lamps(30);
    lights.insert(lights.begin(), paper_sun_sky());
    Case smooth{star(Dielectric{1.5F}, std::move(lights)), material};
    if (name.starts_with("nearly")) {
      smooth.scene.boundary = RoughDielectric{1.5F, 0.05F};
      smooth.scene.lights.emplace_back(SpotLight{{0.2, 1.5, -1}, {0, 0.4, 0}, 1e-6, 0.1, 0.3});
      smooth.scene.lights.emplace_back(DirectionalLight{{0.5, 0.8, -0.3}, 0.1});
    }
    if (name.ends_with("facets")) smooth.scene.smooth_angle = 0;
    return smooth;
  }
};

TEST_P(RefractedShadowRays, AreFair) {
  const auto [description, material, samples] = named(GetParam());
  const Scene scene(description);
  RenderRequest request = request_for(Tracer::kWavefront, material, samples);
  for (const uint32_t light : {0U, 1U}) {
    request.derivatives.push_back({Parameter::kLightScale, light});
  }
  // That of what is nearly smooth is too noisy.
  if (refracts(description.boundary) && !is_nearly_smooth(description.boundary)) {
    request.derivatives.push_back(kRoughness);
  }
  const FilmEstimate with = estimate_film(scene, request, 32);
  const FilmEstimate without =
      estimate_film(scene, request, 32, 1000, {.switches = {.refracted_shadow_rays = false}});
  const double mean = with.radiance.mean;
  expect_same_film(with, without, 45, GetParam(),
                   {mean / material.sigma_t, 0, mean / 0.3, mean, mean, mean / 0.3});
}
INSTANTIATE_TEST_SUITE_P(Cases, RefractedShadowRays,
                         ::testing::Values("rough", "lamps", "inside", "smooth", "facets", "nearly",
                                           "nearly_facets"),
                         [](const auto& of) { return of.param; });

// A lamp that is a hundred times smaller, and no less bright, lights a body alike; so does a point.
// What the boundary mirrors of it does not depend on the albedo.
TEST(DielectricTest, LampsMayBeSmall) {
  constexpr Vec3d kPlace{6, 8, -6};
  const auto lit_by = [&](const LightDescription& light, const char* shape, double smooth_angle,
                          const Boundary& boundary) {
    SceneDescription description = knot_on_ground(light);
    description.object = make_shape(shape);
    description.smooth_angle = smooth_angle;
    description.boundary = boundary;
    description.surfaces.clear();
    RenderRequest request = request_for(Tracer::kWavefront, {200, 0.9, 0.4}, 104);
    request.derivatives = {{Parameter::kAlbedo}};
    return estimate_film(Scene(std::move(description)), request, 32).derivatives[0];
  };
  const auto lamp = [&](double radius) {
    return SphereLight{kPlace, radius, 10 / (radius * radius)};
  };
  const double of_lamp = 10 * std::numbers::pi / kSquareMmPerSquareM;
  for (const auto& [shape, smooth_angle] :
       {std::pair{"cube", 0.0}, {"sphere", 0.0}, {"sphere", 1.0}}) {
    for (const Boundary& boundary :
         {Boundary(Dielectric{1.4F}), Boundary(RoughDielectric{1.4F, 0.002F})}) {
      const std::string what =
          fmt::format("{} {}", shape, is_delta(boundary) ? "smooth" : "nearly");
      const Estimated large = lit_by(lamp(1), shape, smooth_angle, boundary);
      const Estimated small = lit_by(lamp(0.01), shape, smooth_angle, boundary);
      expect_equal(small, large, 9, what);
      expect_resolution(small, large.mean, 0.02, what);
      if (is_delta(boundary)) continue;
      const Estimated point = lit_by(PointLight{kPlace, of_lamp}, shape, smooth_angle, boundary);
      expect_equal(point, large, 9, what + ", point");
      expect_resolution(point, large.mean, 0.02, what);
    }
  }
}

// It is smooth where the microfacets are nearly level.
TEST(RoughDielectricTest, WithoutRoughnessIsSmooth) {
  SceneDescription description = knot_on_ground(ConstantLight{1});
  description.boundary = RoughDielectric{1.5F, 0.005F};
  const Scene rough(description);
  description.boundary = Dielectric{1.5F};
  const Scene smooth(std::move(description));
  for (const Tracer tracer : kTracers) {
    const RenderRequest request = image_request(tracer, {5, 0.9, 0.3}, 48);
    const FilmEstimate a = estimate_film(rough, request, 32),
                       b = estimate_film(smooth, request, 32, 1000);
    expect_equal(a.radiance, b.radiance, 2, name_of(tracer));
    expect_resolution(a.radiance, b.radiance.mean, 0.01, "radiance");
  }
}

// Central differences of the film with common random numbers, and the derivative there.
struct Slopes {
  Estimated differences;
  FilmEstimate film;
};
Slopes slopes_in(const Parameter& parameter, RenderRequest request, int batches, float step,
                 const std::function<SceneDescription(float by)>& scene_at) {
  const Scene above(scene_at(step)), below(scene_at(-step)), here(scene_at(0));
  std::vector<double> slopes;
  for (request.seed = 1000; request.seed < 1000 + static_cast<uint64_t>(batches); ++request.seed) {
    slopes.push_back(
        (film_mean(render_grad(above, request), -1) - film_mean(render_grad(below, request), -1)) /
        double{2 * step});
  }
  request.derivatives = {parameter};
  return {over_batches(slopes), estimate_film(here, request, batches)};
}

TEST(RoughDielectricTest, TheDerivativeInRoughnessEqualsFiniteDifferences) {
  constexpr float kAlpha = 0.4F;
  for (const bool single_scattering : {false, true}) {
    const auto [expected, film] = slopes_in(
        kRoughness, {.material = {5, 0.6, 0.3}, .sample_count = single_scattering ? 2048U : 1024U},
        32, 0.04F, [&](float by) { return rough_knot(1.4F, kAlpha + by, single_scattering); });
    expect_equal(film.derivatives[0], expected, 2, "d / d roughness");
    // If no light is lost, hardly any is won or lost by roughness: 2 % of the image.
    const double scale = single_scattering ? expected.mean : film.radiance.mean / double{kAlpha};
    expect_resolution(film.derivatives[0], scale, 0.02, "d / d roughness");
    expect_resolution(expected, scale, 0.03, "differences");
  }
}

// From inside, the radiance counts index^2 times, which is as much again as the derivative that is
// left: 6 % show it.
TEST(RoughDielectricTest, TheDerivativeInTheIndexEqualsFiniteDifferences) {
  struct Case {
    const char* name;
    RoughDielectric boundary;
    bool from_inside;
    double albedo;
    uint32_t samples;
    double resolution;
  };
  for (const auto& [name, boundary, from_inside, albedo, samples, resolution] :
       {Case{"index", {1.5F, 0.9F, true}, false, 0.9, 1408, 0.02},
        Case{"index, from inside", {1.4F, 0.5F}, true, 0.6, 896, 0.06}}) {
    const auto [expected, film] = slopes_in(
        kIndex, {.material = {2, albedo, 0.3}, .sample_count = samples}, 32, 0.04F, [&](float by) {
          SceneDescription description = rough_knot(1, 1);
          description.object = make_shape("cube");
          description.lights[1] = DirectionalLight{{0.5, 0.8, -0.3}, 2, 0.5};
          description.boundary =
              RoughDielectric{boundary.index + by, boundary.roughness, boundary.single_scattering};
          if (from_inside) {
            description.camera.origin = {0, 0.5, -0.4};
            description.camera.fov = 1;
          }
          return description;
        });
    expect_equal(film.derivatives[0], expected, 2, name);
    expect_resolution(film.derivatives[0], expected.mean, resolution, name);
    expect_resolution(expected, expected.mean, resolution, "differences");
  }
}

TEST(RoughDielectricTest, DerivativesAreOfTheBoundaryThatThereIs) {
  const auto refused = [](const Boundary& boundary) {
    SceneDescription description = slab();
    description.boundary = boundary;
    RenderRequest request;
    request.derivatives = {kRoughness};
    return message_of([&] { validate(request, Scene(std::move(description))); });
  };
  EXPECT_EQ(refused(RoughDielectric{}), "");
  EXPECT_EQ(
      refused(Dielectric{}),
      "no derivative in rough_dielectric.roughness: there is none in what the scene has instead");
}

TEST(DielectricTest, WhatItCannotDoIsRefused) {
  const auto refused = [](const SceneDescription& description) {
    return message_of([&] { const Scene scene(description); });
  };
  SceneDescription description = slab();
  description.boundary = Dielectric{0.75F};
  EXPECT_EQ(refused(description), "object.dielectric.index is 0.75; it must be in [1, 2.5]");
  description.boundary = Dielectric{1.3F};
  EXPECT_EQ(refused(description), "");
  description.lights.emplace_back(SphereLight{{0, 9, 0}});
  EXPECT_EQ(refused(description), "");
  description.lights.back() = DirectionalLight{};
  EXPECT_EQ(
      refused(description),
      "lights[1].directional cannot be seen through object.dielectric, which is smooth: no "
      "path finds such a light; one of a size (angular_radius_degrees, sphere, panel), or a rough "
      "boundary, can be rendered");
  description.lights.back() = DirectionalLight{.angular_radius = 0.01};
  EXPECT_EQ(refused(description), "");
  description.lights.back() = DirectionalLight{.angular_radius = 1e-4};
  EXPECT_EQ(refused(description),
            "lights[1].directional.angular_radius_degrees must be 0, or in [0.1, 45]");
}

}  // namespace
}  // namespace itn::testing
