// The seam between the tracers and models of the medium's boundary: by models whose effect is
// known.
#include "server/tracer/boundary/boundary.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <string>

#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;
using Event = BoundarySample::Event;

constexpr Tracer kTracers[] = {Tracer::kWavefront, Tracer::kReference};

std::string name_of(Tracer tracer) {
  return tracer == Tracer::kWavefront ? "wavefront" : "reference";
}

// Holds every interaction against the mesh.
class CheckedModel : public BoundaryModel {
 public:
  explicit CheckedModel(const Mesh& mesh) : mesh_(mesh) {}
  ~CheckedModel() override { EXPECT_GT(asked_, 0U) << "the model was never asked"; }

 protected:
  void check(const BoundaryInteraction& at) const {
    ++asked_;
    ASSERT_LT(at.triangle, mesh_.triangles.size());
    const auto corner = [&](size_t k) {
      return static_cast<Vec3d>(mesh_.vertices[mesh_.triangles[at.triangle][k]]);
    };
    const Vec3d a = corner(0), b = corner(1), c = corner(2);
    const Vec3d normal = itn::normalize(cross(b - a, c - a));
    EXPECT_GT(dot(normal, static_cast<Vec3d>(at.normal)), 1 - 1e-4);
    EXPECT_NEAR(length(at.direction), 1, 1e-5);
    EXPECT_EQ(dot(at.direction, at.normal) > 0, at.leaving);
    // Within the triangle: on the inner side of its three edges, less rounding.
    const auto point = static_cast<Vec3d>(at.point);
    EXPECT_NEAR(dot(point - a, normal), 0, 1e-4);
    for (const auto& [from, to] : {std::pair{a, b}, {b, c}, {c, a}}) {
      EXPECT_GT(dot(cross(itn::normalize(to - from), point - from), normal), -1e-4);
    }
  }

 private:
  const Mesh& mesh_;
  mutable std::atomic<uint64_t> asked_ = 0;
};

// Light goes straight on, less a fraction.
class Absorbing : public CheckedModel {
 public:
  Absorbing(const Mesh& mesh, float fraction) : CheckedModel(mesh), fraction_(fraction) {}
  bool straight() const override { return true; }
  float transmittance(const BoundaryInteraction& at) const override {
    check(at);
    return 1 - fraction_;
  }
  BoundarySample sample(const BoundaryInteraction& /*at*/,
                        const std::array<float, 5>& /*u*/) const override {
    ADD_FAILURE() << "a straight model is asked for a direction";
    return {};
  }

 private:
  const float fraction_;
};

// A mirror that a fraction of the light passes through straight, and another is lost in. The
// tracers have to expect that it bends all of it.
class HalfMirror : public CheckedModel {
 public:
  HalfMirror(const Mesh& mesh, float reflected, float absorbed = 0)
      : CheckedModel(mesh), reflected_(reflected), absorbed_(absorbed) {}
  bool straight() const override { return false; }
  float transmittance(const BoundaryInteraction& /*at*/) const override {
    ADD_FAILURE() << "a bending model is asked what passes straight";
    return 0;
  }
  BoundarySample sample(const BoundaryInteraction& at,
                        const std::array<float, 5>& u) const override {
    check(at);
    if (u[0] < absorbed_) return {};
    if (u[0] < absorbed_ + reflected_) {
      const Vec3f mirrored = at.direction - at.normal * (2 * dot(at.direction, at.normal));
      return {Event::kReflected, itn::normalize(mirrored), 1, 0};
    }
    return {Event::kTransmitted, at.direction, 1, 0};
  }

 private:
  const float reflected_, absorbed_;
};

RenderOptions with(const BoundaryModel& model) {
  RenderOptions options;
  options.switches.boundary = &model;
  return options;
}

// A slab of 0.7 mm under a constant light, seen at right angles.
constexpr double kChord = 0.7;
SceneDescription slab() {
  SceneDescription description;
  description.object = box({-0.5F, 0, -0.5F}, {0.5F, static_cast<float>(kChord), 0.5F});
  description.lights = {ConstantEnvironment{1}};
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

// A model that lets all pass changes no bit: lines, random numbers and sums are the same.
TEST(BoundaryTest, PassingStraightIsIndexMatchedBitForBit) {
  const Scene scene(knot_on_ground(paper_sun_sky()));
  const Mesh mesh = make_shape("knot");
  for (const Tracer tracer : kTracers) {
    RenderRequest request = request_for(tracer, {8, 0.9, 0.4}, 64);
    request.derivatives.push_back({Parameter::kReflectance, 0});
    request.derivatives.push_back({Parameter::kLightScale, 0});
    if (tracer == Tracer::kWavefront) {
      request.albedos = {0.5, 0.8};  // which the reference does not know
    }
    const Absorbing nothing(mesh, 0);
    const FilmSums plain = render_grad(scene, request);
    const FilmSums asked = render_grad(scene, request, with(nothing));
    EXPECT_EQ(plain.quantum, asked.quantum);
    EXPECT_EQ(plain.hits, asked.hits);
    EXPECT_EQ(plain.squares, asked.squares);
    ASSERT_EQ(plain.estimates.size(), asked.estimates.size());
    for (size_t k = 0; k < plain.estimates.size(); ++k) {
      EXPECT_EQ(plain.estimates[k].counts, asked.estimates[k].counts);
      EXPECT_EQ(plain.estimates[k].radiance, asked.estimates[k].radiance) << name_of(tracer);
      EXPECT_EQ(plain.estimates[k].derivatives, asked.estimates[k].derivatives);
      EXPECT_EQ(plain.estimates[k].at_albedos, asked.estimates[k].at_albedos);
    }
  }
}

// Without scattering, a chord d that enters and leaves has the transmittance
// (1 - f)^2 exp(-sigma_t d).
TEST(BoundaryTest, AbsorbsAtEveryCrossing) {
  const Scene scene(slab());
  const Mesh mesh = slab().object;
  for (const Tracer tracer : kTracers) {
    for (const float fraction : {0.1F, 0.6F}) {
      const Absorbing model(mesh, fraction);
      const FilmEstimate film =
          estimate_film(scene, request_for(tracer, {1, 0, 0.3}, 512), 32, 1, with(model));
      const double expected = std::pow(1 - double{fraction}, 2) * std::exp(-kChord);
      expect_equal(film.radiance, {expected, 0}, 8, name_of(tracer) + " transmittance");
      expect_resolution(film.radiance, expected, 0.01, "transmittance");
      expect_equal(film.derivatives[kSigmaT], {-kChord * expected, 0}, 8,
                   name_of(tracer) + " d transmittance / d sigma_t");
      expect_resolution(film.derivatives[kSigmaT], kChord * expected, 0.03, "d / d sigma_t");
    }
  }
}

// Where light is scattered, the walk and the shadow rays find it through the same boundary: what
// they find together is what the walk finds alone.
TEST(BoundaryTest, ShadowRaysSeeThroughAStraightBoundary) {
  const Scene scene(knot_on_ground(ConstantEnvironment{1}));
  const Mesh mesh = make_shape("knot");
  const Absorbing model(mesh, 0.3F);
  const auto rendered = [&](Tracer tracer, Switches::Techniques techniques) {
    RenderOptions options = with(model);
    options.switches.techniques = techniques;
    return estimate_film(scene, request_for(tracer, {5, 0.9, 0.3}, 128), 32,
                         tracer == Tracer::kWavefront ? 1 : 1000, options);
  };
  const FilmEstimate delta_bounce = rendered(Tracer::kReference, Switches::Techniques::kPhaseOnly);
  for (const Tracer tracer : kTracers) {
    for (const auto techniques : {Switches::Techniques::kBoth, Switches::Techniques::kLightsOnly}) {
      const FilmEstimate film = rendered(tracer, techniques);
      expect_equal(film.radiance, delta_bounce.radiance, 4, name_of(tracer));
      expect_resolution(film.radiance, delta_bounce.radiance.mean, 0.02, name_of(tracer));
    }
  }
}

// A boundary that bends by the angle 0 lets the image be, in expectation: flights are drawn anew
// at every crossing, and the walk finds alone what shadow rays found.
TEST(BoundaryTest, BendingByNothingIsIndexMatchedInExpectation) {
  const Scene scene(knot_on_ground(ConstantEnvironment{1}));
  const Mesh mesh = make_shape("knot");
  for (const Tracer tracer : kTracers) {
    RenderRequest request = request_for(tracer, {5, 0.9, 0.3}, 128);
    request.derivatives.push_back({Parameter::kReflectance, 0});
    const HalfMirror nothing(mesh, 0);
    const FilmEstimate plain = estimate_film(scene, request, 32);
    const FilmEstimate bent = estimate_film(scene, request, 32, 1000, with(nothing));
    expect_equal(bent.radiance, plain.radiance, 10, name_of(tracer) + " radiance");
    expect_resolution(bent.radiance, plain.radiance.mean, 0.02, "radiance");
    for (size_t i = 0; i < request.derivatives.size(); ++i) {
      expect_equal(bent.derivatives[i], plain.derivatives[i], 10,
                   name_of(tracer) + " d / d " + tracer::name_of(request.derivatives[i]));
    }
    EXPECT_EQ(bent.counters.leaks, 0U);
  }
}

// A slab between two mirrors of reflectance R, transmittance T and the dimming a = exp(-sigma_t d)
// between them, without scattering: what comes back and what comes through are geometric series,
// which together make
//   L = R + T^2 a / (1 - R a),    dL/dsigma_t = -d T^2 a / (1 - R a)^2.
TEST(BoundaryTest, ReflectsBetweenTwoMirrors) {
  const Scene scene(slab());
  const Mesh mesh = slab().object;
  for (const Tracer tracer : kTracers) {
    for (const double absorbed : {0.0, 0.2}) {
      const double reflected = 0.4, passed = 1 - reflected - absorbed;
      const HalfMirror model(mesh, static_cast<float>(reflected), static_cast<float>(absorbed));
      const FilmEstimate film =
          estimate_film(scene, request_for(tracer, {1, 0, 0}, 1024), 32, 1, with(model));
      const double a = std::exp(-kChord);
      const double expected = reflected + passed * passed * a / (1 - reflected * a);
      const double slope = -kChord * passed * passed * a / std::pow(1 - reflected * a, 2);
      expect_equal(film.radiance, {expected, 0}, 8, name_of(tracer) + " radiance");
      expect_resolution(film.radiance, expected, 0.01, "radiance");
      expect_equal(film.derivatives[kSigmaT], {slope, 0}, 8, name_of(tracer) + " d / d sigma_t");
      expect_resolution(film.derivatives[kSigmaT], slope, 0.05, "d / d sigma_t");
    }
  }
}

// Where nothing is lost, all has the light's radiance, however the boundary mirrors.
TEST(BoundaryTest, AMirroredObjectVanishesInAFurnace) {
  const Scene scene(studio("cube", {ConstantEnvironment{1}}));
  const Mesh mesh = make_shape("cube");
  for (const Tracer tracer : kTracers) {
    const HalfMirror model(mesh, 0.5F);
    const FilmEstimate film =
        estimate_film(scene, request_for(tracer, {3, 1, 0.5}, 128), 32, 1, with(model));
    EXPECT_NEAR(film.radiance.mean, 1, 4 * film.radiance.standard_error + 1e-6) << name_of(tracer);
    expect_resolution(film.radiance, 1, 0.02, "furnace");
    EXPECT_EQ(film.counters.leaks, 0U);
  }
}

}  // namespace
}  // namespace itn::testing
