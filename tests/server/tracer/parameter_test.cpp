#include "server/tracer/parameters/parameter.h"

#include <gtest/gtest.h>

#include "common/error.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

TEST(ParameterTest, NamesAreReadAsTheyArePrinted) {
  std::vector<Parameter> all = medium_parameters();
  for (const uint32_t index : {0U, 1U, 10U, 4294967295U}) {
    all.push_back({Parameter::kReflectance, index});
    all.push_back({Parameter::kReflectance, index, 2});
    all.push_back({Parameter::kLightScale, index});
    all.push_back({Parameter::kLightPlace, index, 1});
  }
  for (const Parameter& parameter : all) {
    EXPECT_EQ(parameter_named(name_of(parameter)), parameter) << name_of(parameter);
  }
  EXPECT_EQ(name_of({Parameter::kReflectance, 2}), "surface[2].reflectance");
  EXPECT_EQ(name_of({Parameter::kReflectance, 2, 1}), "surface[2].checkerboard.even");
  EXPECT_EQ(name_of({Parameter::kLightScale, 0}), "light[0].scale");
  EXPECT_EQ(name_of(parameter_named("scattered[12].scale")), "scattered[12].scale");
  EXPECT_EQ(name_of({Parameter::kLightPlace, 3, 1}), "light[3].directional.direction.y");
  EXPECT_EQ(name_of(parameter_named("light[1].panel.center.z")), "light[1].panel.center.z");
  EXPECT_EQ(parameter_named("two_term.weight"), (Parameter{Parameter::kPhase, 0, 3}));
}

TEST(ParameterTest, RefusesOtherNames) {
  for (const char* name :
       {"", "sigma", "SIGMA_T", "surface", "surface[].reflectance", "surface[-1].reflectance",
        "surface[+1].reflectance", "surface[01].reflectance", "surface[1 ].reflectance",
        "surface[4294967296].reflectance", "surface[0].scale", "light[0].reflectance",
        "light[0].scale ", "light[0]", "scattered[01].scale", "scattered[0]"}) {
    try {
      parameter_named(name);
      ADD_FAILURE() << name;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInvalidInput);
      EXPECT_NE(std::string(error.what()).find("surface[K].reflectance"), std::string::npos);
    }
  }
}

// One light of every kind, and one that does not shine.
std::vector<LightDescription> every_light() {
  EnvironmentMapLight map{.width = 8, .height = 4, .rgb = {}};
  for (int i = 0; i < 3 * map.width * map.height; ++i) {
    map.rgb.push_back(static_cast<float>(i * 7 % 11) / 5);
  }
  return {paper_sun_sky(),  ConstantLight{0.3}, DirectionalLight{{0.3, 1, -0.2}, 2}, map,
          ConstantLight{0}, ConstantLight{0.5}, PointLight{{0.5, 2, 1}, 1e-6}};
}

std::vector<Parameter> all_scales(size_t lights) {
  std::vector<Parameter> scales;
  for (uint32_t k = 0; k < lights; ++k) scales.push_back({Parameter::kLightScale, k});
  return scales;
}

// Radiance is linear in the lights: pixel by pixel the derivatives in their scales add up to it,
// and asking for them changes nothing.
TEST(ParameterTest, TheLightsAddUpToTheImage) {
  const auto lights = every_light();
  const Scene scene(studio("mug", lights, 0.5F, 12));
  for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
    RenderRequest request{.material = {30, 0.8, 0.3}, .sample_count = 16, .seed = 3};
    request.tracer = tracer;
    const FilmSums plain = render_grad(scene, request);
    request.derivatives = all_scales(lights.size());
    const FilmSums sums = render_grad(scene, request);
    EXPECT_EQ(sums.estimates[0].radiance, plain.estimates[0].radiance);
    const RenderedImages images = means(sums);
    const auto& image = images.estimates[0];
    std::vector<double> totals(lights.size());
    for (size_t p = 0; p < image.radiance.size(); ++p) {
      double sum = 0;
      for (size_t k = 0; k < lights.size(); ++k) {
        sum += image.derivatives[k][p];
        totals[k] += image.derivatives[k][p];
      }
      EXPECT_NEAR(sum, image.radiance[p], 2e-5 * (image.radiance[p] + 1)) << "pixel " << p;
    }
    for (size_t k = 0; k < lights.size(); ++k) EXPECT_EQ(totals[k] > 0, k != 4) << "light " << k;
  }
}

TEST(ParameterTest, OrderAndCompanyDoNotMatter) {
  const Scene scene(studio("mug", every_light(), 0.5F, 8));
  RenderRequest request{.material = {30, 0.8, 0.3}, .sample_count = 16};
  request.derivatives = {{Parameter::kPhase},
                         {Parameter::kReflectance, 0},
                         {Parameter::kLightScale, 2},
                         {Parameter::kSigmaT}};
  const FilmSums four = render_grad(scene, request);
  request.derivatives = {{Parameter::kSigmaT}, {Parameter::kReflectance, 0}, {Parameter::kPhase}};
  const FilmSums three = render_grad(scene, request);
  EXPECT_EQ(three.estimates[0].radiance, four.estimates[0].radiance);
  EXPECT_EQ(three.estimates[0].derivatives[0], four.estimates[0].derivatives[3]);
  EXPECT_EQ(three.estimates[0].derivatives[1], four.estimates[0].derivatives[1]);
  EXPECT_EQ(three.estimates[0].derivatives[2], four.estimates[0].derivatives[0]);
}

TEST(ParameterTest, RefusesWhatTheSceneDoesNotHave) {
  const Scene scene(studio("cube", {ConstantLight{1}}, 0.5F));
  const auto refused = [&](std::vector<Parameter> derivatives) -> std::string {
    RenderRequest request{.material = {30, 0.8, 0.3}};
    request.derivatives = std::move(derivatives);
    try {
      render_grad(scene, request);
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInvalidInput);
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refused({{Parameter::kReflectance, 0}, {Parameter::kLightScale, 0}}), "");
  EXPECT_EQ(refused({{Parameter::kReflectance, 1}}),
            "no derivative in surface[1].reflectance: the scene has one surface, number 0");
  EXPECT_EQ(refused({{Parameter::kLightScale, 7}}),
            "no derivative in light[7].scale: the scene has one light, number 0");
  EXPECT_EQ(
      refused({parameter_named("light[0].sphere.center.x")}),
      "no derivative in light[0].sphere.center.x: there is none in what the scene has instead");
  EXPECT_EQ(refused({{Parameter::kPhase}, {Parameter::kPhase}}),
            "the derivative in g is asked for twice");
}

// A lamp is not moved where shadow rays to its outline do not find all that changes.
TEST(ParameterTest, RefusesToMoveWhatItCannot) {
  const auto refused = [](const LightDescription& light, const Boundary& boundary, Tracer tracer) {
    SceneDescription description = studio("cube", {ConstantLight{1}, light}, 0.5F);
    description.boundary = boundary;
    RenderRequest request{.material = {30, 0.8, 0.3}};
    request.derivatives = {parameter_named("light[1].directional.direction.x")};
    request.tracer = tracer;
    try {
      validate(request, Scene(std::move(description)));
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const std::string none = "no derivative in light[1].directional.direction.x: ";
  const DirectionalLight point{{0.3, 1, -0.2}, 2}, sun{{0.3, 1, -0.2}, 2, 0.1};
  const Tracer fast = Tracer::kWavefront;
  EXPECT_EQ(refused(sun, IndexMatched(), fast), "");
  EXPECT_EQ(refused(sun, RoughDielectric(), fast), "");
  EXPECT_EQ(refused(point, IndexMatched(), fast),
            none + "the light has no size; it may have an angular_radius_degrees");
  EXPECT_EQ(refused(sun, Dielectric(), fast),
            none +
                "the object's boundary is smooth; behind a rough one, or one that is "
                "index-matched, there is one");
  EXPECT_EQ(refused(sun, IndexMatched(), Tracer::kReference),
            none + "the reference tracer knows none");
}

}  // namespace
}  // namespace itn::testing
