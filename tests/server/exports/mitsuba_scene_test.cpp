#include "server/exports/mitsuba_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "server/renderer.h"
#include "tests/support/expect_error.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

MitsubaFiles files_of(const v1::Scene& scene, std::vector<Material> materials = {{8, 0.9, 0.3}},
                      const std::optional<v1::PhaseFunction>& phase = {}) {
  const std::vector<std::vector<Material>> media{std::move(materials)};
  return to_mitsuba(scene, media, phase, "cube");
}

v1::Scene under(const std::string& lights) {
  v1::Scene scene = testing::cube_scene();
  scene.clear_lights();
  scene.MergeFrom(testing::parse_text<v1::Scene>(lights));
  return scene;
}

// Irradiance on a surface that faces up, of the rows of a panorama of Mitsuba's: the first stands
// at v = 0, the last at v = 1.
double from_above(const MitsubaFiles::Picture& picture, size_t channel) {
  double sum = 0;
  for (int row = 0; row < picture.height; ++row) {
    const double step = std::numbers::pi / (picture.height - 1);
    const auto angle = [&](double at) { return std::clamp(at * step, 0.0, std::numbers::pi / 2); };
    const auto integral = [&](double at) { return std::pow(std::sin(angle(at)), 2) / 2; };
    const double weight = integral(row + 0.5) - integral(row - 0.5);
    for (int x = 0; x < picture.width; ++x) {
      const size_t pixel = static_cast<size_t>(row) * picture.width + x;
      sum += picture.rgb[3 * pixel + channel] * weight * 2 * std::numbers::pi / picture.width;
    }
  }
  return sum;
}

TEST(MitsubaScene, HasAllThatIsInTheScene) {
  const MitsubaFiles files = files_of(testing::cube_scene());
  EXPECT_THAT(files.xml, HasSubstr(R"(<integrator type="volpath">)"));
  EXPECT_THAT(files.xml, HasSubstr(R"(<float name="fov" value="22" />)"));
  EXPECT_THAT(files.xml, HasSubstr(R"(<float name="sigma_t" value="8" />)"));
  EXPECT_THAT(files.xml, HasSubstr(R"(<bsdf type="null" />)"));
  EXPECT_THAT(files.xml, HasSubstr(R"(<float name="reflectance" value="0.5" />)"));
  EXPECT_THAT(files.xml, HasSubstr(R"(<emitter type="constant">)"));
  EXPECT_THAT(files.xml, HasSubstr(R"(<emitter type="directional">)"));
  EXPECT_THAT(files.xml, Not(HasSubstr("medium type=\"homogeneous\" id")));
  ASSERT_EQ(files.shapes.size(), 1U);
  EXPECT_EQ(files.shapes[0].file, "cube_object.ply");
  EXPECT_EQ(files.shapes[0].mesh.triangles.size(), 12U);
  EXPECT_THAT(files.shapes[0].corner_normals, IsEmpty());
  EXPECT_THAT(files.pictures, IsEmpty());
  EXPECT_THAT(files.not_carried_over, ElementsAre(HasSubstr("an object touches it")));
}

TEST(MitsubaScene, LeavesAirWhereObjectsStand) {
  v1::Scene scene = testing::cube_scene();
  scene.clear_surfaces();
  scene.MergeFrom(testing::parse_text<v1::Scene>(R"(
      surfaces { rectangle { half_u { x: 20 } half_v { z: -20 } } }
      surfaces { rectangle { center { x: 0.5 y: 0.5 } half_u { y: 3 } half_v { z: 3 } } }
      surfaces { rectangle { center { x: -0.5 y: 5 } half_u { y: 3 } half_v { z: 3 } } }
      surfaces { rectangle { center { x: 0.25 } half_u { y: 3 } half_v { z: 3 } } })"));
  const MitsubaFiles files = files_of(scene);
  EXPECT_THAT(files.not_carried_over,
              ElementsAre(HasSubstr("surface_0: an object touches it; it is moved 0.004 mm"),
                          HasSubstr("surface_1: an object touches it; it is moved 0.004 mm")));
  EXPECT_THAT(files.xml, HasSubstr("\"20, 0, -0, 0, 0, 0, 1, -0.004, 0, -20, 0, 0, 0, 0, 0, 1\""));
  EXPECT_THAT(files.xml, HasSubstr("\"0, 0, 1, 0.504, 3, 0, 0, 0.5,"));
  EXPECT_THAT(files.xml, HasSubstr("\"0, 0, 1, -0.5, 3, 0, 0, 5,"));
  EXPECT_THAT(files.xml, HasSubstr("\"0, 0, 1, 0.25, 3,"));
}

TEST(MitsubaScene, RefusesAMediumThatThereIsNot) {
  testing::expect_error(ErrorKind::kInvalidInput, {"albedo is 2"}, [] {
    files_of(testing::cube_scene(), {{1, 2, 0}});
  });
}

TEST(MitsubaScene, HasSunAndSkyAsAPanorama) {
  for (const double radius : {0.5, 5.0}) {
    v1::Scene scene = under("lights { sun_sky { sun_elevation_degrees: 50 turbidity: 4 } }");
    scene.mutable_lights(0)->mutable_sun_sky()->set_sun_angular_radius_degrees(
        static_cast<float>(radius));
    scene.mutable_film()->set_channel(v1::Film::RGB);
    const MitsubaFiles files = files_of(scene);
    ASSERT_EQ(files.pictures.size(), 1U);
    const MitsubaFiles::Picture& picture = files.pictures[0];
    EXPECT_EQ(picture.file, "cube_panorama.exr");
    EXPECT_EQ(picture.width, std::max(512, 2 * static_cast<int>(std::ceil(540 / radius))));
    for (size_t c = 0; c < 3; ++c) {
      const double expected = irradiance_from_above(
          scene.lights(0).sun_sky(), std::array{v1::Film::RED, v1::Film::GREEN, v1::Film::BLUE}[c]);
      EXPECT_NEAR(from_above(picture, c) / expected, 1, 0.004) << radius << ' ' << c;
    }
  }
}

TEST(MitsubaScene, PutsLightsThatAreFarAwayTogether) {
  v1::Scene scene = under(R"(
      lights { constant { radiance: 0.25 } color { red: 2 green: 1 blue: 1 } }
      lights { directional { direction { y: 1 } irradiance: 3 angular_radius_degrees: 6 } }
      lights { environment_map { pixels { width: 2 height: 1 } } })");
  scene.mutable_lights(2)->mutable_environment_map()->mutable_pixels()->set_rgb(
      to_bytes(std::vector<float>{1, 1, 1, 1, 1, 1}));
  const MitsubaFiles files = files_of(scene);
  EXPECT_THAT(files.xml, Not(HasSubstr("directional")));
  ASSERT_EQ(files.pictures.size(), 1U);
  EXPECT_NEAR(from_above(files.pictures[0], 0), 3 + 1.25 * std::numbers::pi, 0.02);
}

TEST(MitsubaScene, KeepsAPanoramaExactly) {
  v1::Scene scene = under(R"(
      lights { environment_map { pixels { width: 2 height: 2 } scale: 2 rotate_y_degrees: 30 } })");
  scene.mutable_lights(0)->mutable_environment_map()->mutable_pixels()->set_rgb(
      to_bytes(std::vector<float>{1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4}));
  const MitsubaFiles files = files_of(scene);
  ASSERT_EQ(files.pictures.size(), 1U);
  std::vector<float> red;
  for (size_t i = 0; i < files.pictures[0].rgb.size(); i += 3) {
    red.push_back(files.pictures[0].rgb[i]);
  }
  // Rows at v = 0, 1/4, 1/2, 3/4 and 1; ours are at 1/4 and 3/4.
  EXPECT_THAT(red, ElementsAre(2, 4, 2, 4, 4, 6, 6, 8, 6, 8));
  EXPECT_THAT(files.xml, HasSubstr(R"(<rotate y="1" angle="30" />)"));
}

TEST(MitsubaScene, HasNoMoreRowsThanAreReadBack) {
  constexpr int kHeight = 5000;
  v1::Scene scene = under("lights { environment_map { pixels { width: 1 height: 5000 } } }");
  std::vector<float> rgb;
  for (int i = 0; i < kHeight; ++i) rgb.insert(rgb.end(), 3, static_cast<float>(i));
  scene.mutable_lights(0)->mutable_environment_map()->mutable_pixels()->set_rgb(to_bytes(rgb));
  const MitsubaFiles files = files_of(scene);
  ASSERT_EQ(files.pictures.size(), 1U);
  EXPECT_EQ(files.pictures[0].height, kHeight + 1);
  EXPECT_EQ(files.pictures[0].rgb[0], 0);
  EXPECT_EQ(files.pictures[0].rgb[3 * 10], 9.5F);
  EXPECT_EQ(files.pictures[0].rgb[3 * kHeight], kHeight - 1);
}

TEST(MitsubaScene, IsInColourOrGrayAsTheFilmSees) {
  v1::Scene scene = under(R"(
      lights { panel { center { y: 5 } half_u { x: 1 } half_v { z: 1 } radiance: 2 }
               color { red: 1 green: 0 blue: 0.5 } })");
  scene.mutable_surfaces(0)->mutable_color()->set_red(0.9F);
  EXPECT_THAT(files_of(scene).xml, HasSubstr(R"(<float name="radiance" value="2" />)"));
  scene.mutable_film()->set_channel(v1::Film::BLUE);
  EXPECT_THAT(files_of(scene).xml, HasSubstr(R"(<float name="radiance" value="4.020909" />)"));
  scene.mutable_film()->set_channel(v1::Film::RGB);
  const std::string xml = files_of(scene, {{4, 0.9, 0.3}, {2, 0.8, 0.3}, {1, 0.5, 0.3}}).xml;
  EXPECT_THAT(xml, HasSubstr(R"(<rgb name="radiance" value="8.041818, 0, 4.020909" />)"));
  EXPECT_THAT(xml, HasSubstr(R"(<rgb name="reflectance" value="0.9, 0.5, 0.5" />)"));
  EXPECT_THAT(xml, HasSubstr(R"(<rgb name="sigma_t" value="1, 0.5, 0.25" />)"));
  EXPECT_THAT(xml, HasSubstr(R"(<float name="scale" value="4" />)"));
  EXPECT_THAT(xml, HasSubstr(R"(<integrator type="volpathmis">)"));
}

TEST(MitsubaScene, HasSmoothNormals) {
  v1::Scene scene = testing::cube_scene();
  scene.mutable_object()->mutable_mesh()->set_builtin("sphere");
  scene.mutable_object()->mutable_rough_dielectric()->set_single_scattering(true);
  scene.mutable_object()->set_smooth_angle_degrees(40);
  auto& rotate = *scene.mutable_object()->mutable_mesh()->add_transforms()->mutable_rotate();
  rotate.mutable_axis()->set_x(1);
  rotate.set_angle_degrees(90);
  const MitsubaFiles files = files_of(scene);
  const MitsubaFiles::Shape& sphere = files.shapes[0];
  ASSERT_EQ(sphere.corner_normals.size(), sphere.mesh.triangles.size());
  const Vec3f middle{0, 0, 0.5F};
  for (size_t t = 0; t < sphere.corner_normals.size(); t += 100) {
    for (size_t k = 0; k < 3; ++k) {
      const Vec3f from_middle = sphere.mesh.vertices[sphere.mesh.triangles[t][k]] - middle;
      EXPECT_GT(dot(normalize(from_middle), sphere.corner_normals[t][k]), 0.999F);
    }
  }
  EXPECT_THAT(files.xml, HasSubstr(R"(<boolean name="face_normals" value="false" />)"));
  EXPECT_THAT(files.not_carried_over, IsEmpty());
}

TEST(MitsubaScene, SeesWhatIsNearAndFar) {
  v1::Scene scene = testing::cube_scene();
  EXPECT_THAT(files_of(scene).xml, HasSubstr(R"(<float name="near_clip" value="0.00412)"));
  EXPECT_THAT(files_of(scene).xml, Not(HasSubstr("far_clip")));
  scene.mutable_camera()->mutable_origin()->set_z(-4e4F);
  EXPECT_THAT(files_of(scene).xml, Not(HasSubstr("near_clip")));
  EXPECT_THAT(files_of(scene).xml, HasSubstr(R"(<float name="far_clip" value="80040)"));
}

TEST(MitsubaScene, SaysWhatHasNoCounterpart) {
  v1::Scene scene = under(R"(
      lights { spot { position { y: 5 } intensity: 2 } } camera { k_1: 0.01 })");
  scene.mutable_object()->mutable_rough_dielectric();
  auto& board = *scene.mutable_surfaces(0);
  board.mutable_rectangle()->mutable_half_v()->set_x(3);  // no right angle
  board.mutable_checkerboard();
  const auto phase = testing::parse_text<v1::PhaseFunction>("von_mises_fisher { kappa: 2 }");
  EXPECT_THAT(files_of(scene, {{8, 0.9, 0}}, phase).not_carried_over,
              ElementsAre(HasSubstr("touches"), HasSubstr("lens"), HasSubstr("microfacet"),
                          HasSubstr("phase function"), HasSubstr("surface_0: its pattern"),
                          HasSubstr("lights[0]")));
}

TEST(MitsubaScene, IsMovedToTheOriginWhereItsObjectIsFarAway) {
  v1::Scene scene = testing::cube_scene();
  scene.clear_surfaces();
  scene.MergeFrom(testing::parse_text<v1::Scene>(R"(
      object { mesh { transforms { translate { x: 100 y: -0.5 } } } }
      surfaces { rectangle { center { x: 100 y: -2 } half_u { x: 8 } half_v { z: -8 } }
                 checkerboard { corner { x: 100 y: -2 } edge_u { x: 8 } edge_v { z: -8 } } }
      lights { point { position { x: 101 y: 5 } } }
      camera { origin { x: 100 } target { x: 100 } })"));
  const MitsubaFiles files = files_of(scene);
  EXPECT_THAT(files.not_carried_over, IsEmpty());
  for (const Vec3f v : files.shapes[0].mesh.vertices) EXPECT_LE(std::abs(v.x), 0.5F);
  EXPECT_THAT(files.xml, HasSubstr("What was at 100, 0, 0 is the origin."));
  EXPECT_THAT(files.xml, HasSubstr("origin=\"0, 1.5, -4\" target=\"0, 0.5, 0\""));
  EXPECT_THAT(files.xml, HasSubstr(R"(<point name="position" x="1" y="5" z="0" />)"));
  EXPECT_THAT(files.xml, HasSubstr("\"8, 0, -0, 0, 0, 0, 1, -2, 0, -8, 0, 0, 0, 0, 0, 1\""));
  EXPECT_THAT(files.xml, HasSubstr("\"1, 0, 0, -0.5, 0, 1, 0, -0.5, 0, 0, 1, 0, 0, 0, 0, 1\""));
}

TEST(MitsubaScene, SaysThatItsMediumIsDense) {
  EXPECT_THAT(files_of(testing::cube_scene(), {{100, 0.9, 0}}).not_carried_over,
              ElementsAre(HasSubstr("touches")));
  EXPECT_THAT(
      files_of(testing::cube_scene(), {{1000, 0.9, 0}}).not_carried_over,
      ElementsAre(HasSubstr("touches"), HasSubstr("start 0.00018 mm off surfaces, 0.18 of")));
}

TEST(MitsubaScene, SaysWhereItLeavesNoAir) {
  v1::Scene scene = testing::cube_scene();
  scene.clear_surfaces();
  scene.mutable_object()->mutable_dielectric();
  scene.mutable_lights(1)->Clear();
  scene.MergeFrom(testing::parse_text<v1::Scene>(R"(
      other_objects { mesh { builtin: "cube" transforms { translate { y: -1 } } }
                      dielectric {} material { sigma_t: 1 } }
      surfaces { rectangle { half_u { x: 20 } half_v { z: -20 } } }
      surfaces { mesh { builtin: "cube" transforms { translate { x: 1 } } } })"));
  scene.mutable_lights(1)->MergeFrom(testing::parse_text<v1::Light>(R"(
      panel { center { y: 1 } half_u { x: 0.2 } half_v { z: 0.2 } })"));
  const std::vector<std::vector<Material>> media{{{8, 0.9, 0}}, {{1, 0, 0}}};
  const MitsubaFiles files = to_mitsuba(scene, media, {}, "cube");
  EXPECT_THAT(files.not_carried_over,
              ElementsAre(HasSubstr("surface_0: where an object touches it"),
                          HasSubstr("surface_1: where an object touches it"),
                          HasSubstr("lights[1]: an object touches it; it is moved 0.004 mm"),
                          HasSubstr("other_objects[0]: where an object touches it")));
  EXPECT_THAT(files.xml, HasSubstr("1.004"));
}

TEST(MitsubaScene, RefusesWhatCannotBeRendered) {
  v1::Scene scene = testing::cube_scene();
  scene.mutable_lights(0)->mutable_constant()->set_radiance(-1);
  testing::expect_error(ErrorKind::kInvalidInput, {"radiance"}, [&] { files_of(scene); });
  scene = testing::cube_scene();
  scene.mutable_object()->mutable_mesh()->mutable_triangles()->mutable_indices()->resize(12 * 11);
  testing::expect_error(ErrorKind::kInvalidInput, {"open"}, [&] { files_of(scene); });
  scene = testing::cube_scene();
  scene.mutable_lights(0)->mutable_constant()->set_radiance(0);
  scene.mutable_lights(1)->mutable_directional()->set_irradiance(0);
  testing::expect_error(ErrorKind::kInvalidInput, {"nothing shines"}, [&] { files_of(scene); });
}

}  // namespace
}  // namespace itn
