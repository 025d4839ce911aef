// Boundaries at which lines stop, by a kind whose effect is known.
#include "server/tracer/boundary/boundary.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;
constexpr Tracer kTracers[] = {Tracer::kWavefront, Tracer::kReference};

std::string name_of(Tracer tracer) {
  return tracer == Tracer::kWavefront ? "wavefront" : "reference";
}

// A slab of 0.7 mm under a constant light, seen at right angles.
constexpr double kChord = 0.7;
SceneDescription slab() {
  SceneDescription description;
  description.object = box({-0.5F, 0, -0.5F}, {0.5F, static_cast<float>(kChord), 0.5F});
  description.lights = {ConstantLight{1}};
  description.camera = {
      .origin = {0.03, 5, 0.02}, .target = {0.03, 4, 0.02}, .up = {0, 0, 1}, .fov = 1e-4 / 5};
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
// between them, without scattering: what comes back and what comes through are geometric series,
// which together make
//   L = R + T^2 a / (1 - R a),    dL/dsigma_t = -d T^2 a / (1 - R a)^2.
TEST(BoundaryTest, ReflectsBetweenTwoMirrors) {
  for (const auto& [reflected, absorbed] : {std::pair{0.4, 0.0}, {0.4, 0.2}, {0.0, 0.3}}) {
    SceneDescription description = slab();
    description.boundary =
        PartialMirror{static_cast<float>(reflected), static_cast<float>(absorbed)};
    const Scene scene(std::move(description));
    for (const Tracer tracer : kTracers) {
      const double passed = 1 - reflected - absorbed;
      const FilmEstimate film = estimate_film(scene, request_for(tracer, {1, 0, 0}, 2048), 32);
      const double a = std::exp(-kChord);
      const double expected = reflected + passed * passed * a / (1 - reflected * a);
      const double slope = -kChord * passed * passed * a / std::pow(1 - reflected * a, 2);
      expect_equal(film.radiance, {expected, 0}, 12, name_of(tracer) + " radiance");
      expect_resolution(film.radiance, expected, 0.01, "radiance");
      expect_equal(film.derivatives[kSigmaT], {slope, 0}, 12, name_of(tracer) + " d / d sigma_t");
      expect_resolution(film.derivatives[kSigmaT], slope, 0.05, "d / d sigma_t");
    }
  }
}

// Where nothing is lost, all has the light's radiance, however the boundary mirrors.
TEST(BoundaryTest, AMirroredObjectVanishesInAFurnace) {
  SceneDescription description = studio("cube", {ConstantLight{1}});
  description.boundary = PartialMirror{.reflected = 0.5F};
  const Scene scene(std::move(description));
  for (const Tracer tracer : kTracers) {
    const FilmEstimate film = estimate_film(scene, request_for(tracer, {3, 1, 0.5}, 128), 32);
    EXPECT_NEAR(film.radiance.mean, 1, 4 * film.radiance.standard_error + 1e-6) << name_of(tracer);
    expect_resolution(film.radiance, 1, 0.02, "furnace");
    EXPECT_EQ(film.counters.leaks, 0U);
  }
}

}  // namespace
}  // namespace itn::testing
