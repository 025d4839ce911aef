#include "server/renderer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/error.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;

std::string error_of(const auto& run) {
  try {
    run();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInvalidInput);
    return error.what();
  }
  return "no error";
}

TEST(Renderer, ChecksScenes) {
  v1::Scene scene = testing::cube_scene();
  EXPECT_NO_THROW(check_scene(scene));
  scene.mutable_film()->set_width(0);
  EXPECT_THAT(error_of([&] { check_scene(scene); }), HasSubstr("scene.film.width is 0"));
}

TEST(Renderer, KnowsParametersByName) {
  EXPECT_THAT(derivative_names(), Contains("sigma_a"));
  EXPECT_THAT(derivative_names(), Contains("light[K].scale"));
  for (const char* name : {"sigma_t", "sigma_s_reduced", "two_term.weight"}) {
    EXPECT_TRUE(is_of_medium(name)) << name;
  }
  EXPECT_FALSE(is_of_medium("rough_dielectric.index"));
  EXPECT_THAT(error_of([] { is_of_medium("ior"); }), HasSubstr("ior is not a parameter"));
  EXPECT_TRUE(shares_paths("sigma_a"));
  EXPECT_FALSE(shares_paths("light[0].scale"));
}

TEST(Renderer, SaysTheNumbersOfAScene) {
  v1::Scene scene = testing::cube_scene();
  v1::RoughDielectric& rough = *scene.mutable_object()->mutable_rough_dielectric();
  rough.set_index(1.25F);
  const SceneNumbers numbers(scene);
  const SceneNumber index = numbers.number("rough_dielectric.index");
  EXPECT_EQ(index.value, 1.25);
  EXPECT_LT(index.low, index.value);
  EXPECT_GT(index.high, index.value);
  EXPECT_EQ(numbers.number("light[0].scale").value, 1);
  EXPECT_THAT(error_of([&] { numbers.number("sigma_a"); }), HasSubstr("it is of the medium"));
  EXPECT_THAT(error_of([&] { numbers.number("surface[7].reflectance"); }), HasSubstr("surfaces"));
}

TEST(Renderer, FillsInDefaultsOfASurface) {
  v1::Object object;
  EXPECT_FALSE(surface_of_medium("object", object));
  object.mutable_dielectric()->set_index(1.25F);
  EXPECT_EQ(surface_of_medium("object", object)->index, 1.25);
  EXPECT_EQ(surface_of_medium("object", object)->roughness, 0);
  object.mutable_rough_dielectric()->set_roughness(0.5F);
  EXPECT_EQ(surface_of_medium("object", object)->index, 1.5);  // as scene.proto says
  EXPECT_EQ(surface_of_medium("object", object)->roughness, 0.5);
  object.mutable_rough_dielectric()->set_index(3);
  EXPECT_THAT(error_of([&] { surface_of_medium("object", object); }),
              HasSubstr("object.rough_dielectric.index is 3"));
}

TEST(Renderer, ScalesTheLightOfTheSky) {
  v1::SunSky light;
  const double once = irradiance_from_above(light, v1::Film::LUMINANCE);
  light.set_sun_scale(2);
  light.set_sky_scale(2);
  EXPECT_NEAR(irradiance_from_above(light, v1::Film::LUMINANCE), 2 * once, 1e-9 * once);
  EXPECT_GT(once, 0);
}

}  // namespace
}  // namespace itn
