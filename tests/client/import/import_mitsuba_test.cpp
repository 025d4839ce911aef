#include "client/import/import_mitsuba.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "client/scene/text_proto.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using testing::expect_error;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

class ImportMitsuba : public ::testing::Test {
 protected:
  ImportedScene import(const std::string& body, const char* version = "3.0.0") const {
    const auto file = folder_.write(
        "scene.xml", "<scene version=\"" + std::string(version) + "\">" + body + "</scene>");
    ImportOptions options = options_;
    options.output_folder = folder_.path();
    return import_mitsuba(file, options);
  }
  void refuses(const std::string& body, const std::vector<std::string>& parts,
               ErrorKind kind = ErrorKind::kInvalidInput) const {
    expect_error(kind, parts, [&] { import(body + kSensor); });
  }

  static constexpr const char* kSensor =
      "<sensor type=\"perspective\"><float name=\"fov\" value=\"30\"/></sensor>";
  testing::TemporaryFolder folder_;
  ImportOptions options_;
};

template <typename Message>
Message from_text(const std::string& text) {
  Message message;
  parse_text_proto(text, "expected", message);
  return message;
}
// Text holds six digits or so of what floats hold.
void expect_near(const v1::Vec3& a, double x, double y, double z) {
  EXPECT_NEAR(a.x(), x, 1e-5);
  EXPECT_NEAR(a.y(), y, 1e-5);
  EXPECT_NEAR(a.z(), z, 1e-5);
}

TEST_F(ImportMitsuba, ReadsTheObjectAndItsMedium) {
  options_.mm_per_scene_unit = 10;
  const ImportedScene imported = import(std::string(R"(
      <default name="depth" value="4"/>
      <medium type="homogeneous" id="wax">
        <rgb name="albedo" value="0.9, 0.8, 0.7"/><float name="sigma_t" value="$depth"/>
        <float name="scale" value="5"/>
        <phase type="hg"><float name="g" value="0.3"/></phase>
      </medium>
      <shape type="ply">
        <string name="filename" value="meshes/thing.ply"/>
        <transform name="to_world"><scale value="2"/><translate x="1" y="0.5"/></transform>
        <bsdf type="roughdielectric">
          <string name="distribution" value="ggx"/><float name="alpha" value="0.2"/>
          <string name="int_ior" value="water"/><float name="ext_ior" value="1"/>
        </bsdf>
        <boolean name="face_normals" value="true"/>
        <ref id="wax" name="interior"/>
      </shape>
      <emitter type="constant"/>)") + kSensor);
  EXPECT_EQ(to_text_proto(imported.scene.object()), to_text_proto(from_text<v1::Object>(R"(
      mesh {
        path: "meshes/thing.ply"
        transforms {
          matrix { m: 20 m: 0 m: 0 m: 10 m: 0 m: 20 m: 0 m: 5 m: 0 m: 0 m: 20 m: 0 m: 0 m: 0 m: 0 m: 1 }
        }
        repair: true
      }
      rough_dielectric { index: 1.333 roughness: 0.2 single_scattering: true })")));
  ASSERT_TRUE(imported.medium);
  EXPECT_NEAR((*imported.medium)[1].sigma_t, 2, 1e-12);  // 20 in a scene unit, which is 10 mm
  EXPECT_NEAR((*imported.medium)[2].albedo, 0.7, 1e-12);
  EXPECT_NEAR((*imported.medium)[0].g, 0.3, 1e-12);
  EXPECT_EQ(imported.scene.lights(0).constant().radiance(), 1);
  EXPECT_THAT(imported.not_carried_over, IsEmpty());
}

// The first shape with a medium is the object; others are beside it, of one kind of boundary.
TEST_F(ImportMitsuba, ReadsOtherObjects) {
  const auto shape = [](const char* id, const char* bsdf, const char* medium) {
    return fmt::format(R"(<shape type="cube" id="{}"><bsdf type="{}"/>
        <medium type="homogeneous" name="interior">{}</medium></shape>)",
                       id, bsdf, medium);
  };
  const char* const red = R"(<rgb name="albedo" value="0.9, 0.5, 0.5"/>)";
  const ImportedScene imported =
      import(shape("a", "null", "") + shape("b", "dielectric", red) +
             shape("c", "roughdielectric", "") + shape("d", "null", "") + kSensor);
  EXPECT_EQ(imported.scene.object().dielectric().index(), 1);
  ASSERT_EQ(imported.scene.other_objects_size(), 2);
  const v1::Object &b = imported.scene.other_objects(0), &d = imported.scene.other_objects(1);
  EXPECT_NEAR(b.dielectric().index(), 1.5046, 1e-3);
  ASSERT_EQ(b.material_size(), 3);
  EXPECT_EQ(b.material(0).sigma_t(), 1);
  EXPECT_EQ(b.material(0).albedo(), 0.9);
  EXPECT_EQ(b.material(2).albedo(), 0.5);
  EXPECT_EQ(d.dielectric().index(), 1);
  ASSERT_EQ(d.material_size(), 1);
  EXPECT_EQ(d.material(0).albedo(), 0.75);
  EXPECT_THAT(imported.not_carried_over, Contains(HasSubstr("are of one kind")));
}

// A mirror image faces where its normal points, lamps as objects.
TEST_F(ImportMitsuba, ReadsMirrorImages) {
  const auto lamp = [&](const char* first) {
    return import(fmt::format(R"(<shape type="rectangle"><transform name="to_world">{}
        <rotate x="1" angle="90"/><translate y="3"/></transform>
        <emitter type="area"><float name="radiance" value="10"/></emitter></shape>)",
                              first) +
                  kSensor)
        .scene.lights(0)
        .panel();
  };
  const auto down = [](const v1::PanelLight& panel) {
    return panel.half_u().x() * panel.half_v().z() - panel.half_u().z() * panel.half_v().x();
  };
  EXPECT_NEAR(down(lamp("")), down(lamp("<scale x=\"-1\"/>")), 1e-6);
  EXPECT_NEAR(down(lamp("")), down(lamp("<scale y=\"-1\"/>")), 1e-6);
  EXPECT_NEAR(down(lamp("")), -down(lamp("<rotate x=\"1\" angle=\"180\"/>")), 1e-6);
  const ImportedScene cube = import(std::string(R"(<shape type="cube">
      <transform name="to_world"><scale x="-1"/></transform><bsdf type="null"/>
      <medium type="homogeneous" name="interior"/></shape>)") +
                                    kSensor);
  EXPECT_EQ(cube.scene.object().mesh().transforms(0).matrix().m(0), -2);
}

// References before definitions, $names from outside, spectra, blends of two phase functions.
TEST_F(ImportMitsuba, ReadsWhatMitsubaReads) {
  options_.definitions = {{"t", "3"}};
  const ImportedScene imported = import(std::string(R"(
      <shape type="cube"><ref id="clear"/><ref name="interior" id="wax"/></shape>
      <bsdf type="null" id="clear"/>
      <default name="t" value="1"/>
      <medium type="homogeneous" id="wax"><float name="sigma_t" value="$t"/>
        <spectrum name="albedo" value="400:0.5, 700:0.9"/>
        <phase type="blendphase"><float name="weight" value="0.25"/>
          <phase type="hg"><float name="g" value="0.9"/></phase>
          <phase type="isotropic"/></phase></medium>
      <emitter type="constant"/>)") + kSensor);
  ASSERT_TRUE(imported.medium);
  const auto& [r, g, b] = *imported.medium;
  EXPECT_EQ(r.sigma_t, 3);
  // By CIE's tables (colour-science 0.4).
  EXPECT_NEAR(r.albedo, 0.8109, 1e-3);
  EXPECT_NEAR(g.albedo, 0.6923, 1e-3);
  EXPECT_NEAR(b.albedo, 0.5474, 1e-3);
  EXPECT_EQ(imported.phase, "two_term { g_1: 0.9 g_2: 0 weight: 0.75 }");
  EXPECT_THAT(imported.not_carried_over, ElementsAre(HasSubstr("albedo: R, G and B of its")));
  options_.definitions = {{"nothing", "3"}};
  expect_error(ErrorKind::kInvalidInput, {"nothing has $nothing"}, [&] { import(kSensor); });
}

// Nothing is dropped in silence, however deep; nothing of a file breaks a line.
TEST_F(ImportMitsuba, SaysWhatIsLost) {
  const auto lost = [&](const std::string& body) {
    return import(body + kSensor).not_carried_over;
  };
  EXPECT_THAT(lost(R"(<integrator type="volpath"><boolean name="hide_emitters" value="true"/>
                      </integrator>)"),
              Contains(HasSubstr("hide_emitters")));
  EXPECT_THAT(lost(R"(<medium type="homogeneous" id="fog"/>
                      <shape type="rectangle"><ref name="exterior" id="fog"/></shape>)"),
              Contains(HasSubstr("is around objects")));
  EXPECT_THAT(lost(R"(<shape type="rectangle"><emitter type="area">
                      <texture name="radiance" type="checkerboard"/></emitter></shape>)"),
              Contains(HasSubstr("does not shine")));
  EXPECT_THAT(import(R"(<medium type="homogeneous" id="fog"/><sensor type="perspective">
                        <float name="fov" value="9"/><ref id="fog"/></sensor>)")
                  .not_carried_over,
              Contains(HasSubstr("<medium type=\"homogeneous\">: was not")));
  EXPECT_THAT(lost(R"(<shape type="cube"><medium type="homogeneous" name="interior"/></shape>)"),
              Contains(HasSubstr("has no bsdf, and is opaque in Mitsuba")));
  static constexpr char solid[] = R"(<shape type="sphere"><bsdf type="dielectric">{}</bsdf>
      <medium type="homogeneous" name="interior"/></shape>)";
  EXPECT_THAT(
      lost(fmt::format(solid, "") + fmt::format(solid, "<float name=\"ext_ior\" value=\"1.5\"/>")),
      Contains(HasSubstr("solids inside of solids have no counterpart")));
  EXPECT_THAT(lost(R"(<shape type="rectangle"><transform name="to_wrld"><scale value="2"/>
                      </transform></shape>)"),
              Contains(HasSubstr("transform \"to_wrld\" was not carried over")));
  EXPECT_THAT(import(std::string(R"(<shape type="cube"><bsdf type="null"/>
                     <medium type="homogeneous" name="interior"/></shape>)") +
                         kSensor,
                     "0.6.0")
                  .not_carried_over,
              Contains(HasSubstr("takes skin1")));
  EXPECT_THAT(lost(R"(<shape type="sphere"><emitter type="area"/><transform name="to_world">
                      <scale x="2"/></transform></shape>)"),
              Contains(HasSubstr("an ellipsoid; it is a sphere of its volume")));
  // The camera looks along +z from the origin.
  EXPECT_THAT(lost(R"(<shape type="rectangle"><bsdf type="diffuse"/><transform name="to_world">
                      <translate z="2"/></transform></shape>)"),
              Contains(HasSubstr("its back, which the camera sees, reflects here")));
  EXPECT_THAT(lost(R"(<shape type="rectangle"><bsdf type="diffuse"/><transform name="to_world">
                      <translate z="-2"/></transform></shape>)"),
              Not(Contains(HasSubstr("its back"))));
  EXPECT_THAT(lost(R"(<shape type="rectangle"><bsdf type="twosided"><bsdf type="diffuse"/></bsdf>
                      <transform name="to_world"><translate z="2"/></transform></shape>)"),
              Not(Contains(HasSubstr("its back"))));
  EXPECT_THAT(lost(R"(<integrator type="path"><boolean name="hide_emitters" value="True"/>
                      </integrator>)"),
              Contains(HasSubstr("hide_emitters")));
  EXPECT_THAT(lost(R"(<shape type="rectangle"><bsdf type="twosided"><bsdf type="diffuse">
                      <texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/>
                      <string name="filter_type" value="nearest"/></texture></bsdf></bsdf></shape>)"),
              Contains(HasSubstr("filter_type: pixels are interpolated")));
  EXPECT_THAT(import(R"(<sensor type="perspective"><float name="fov" value="9"/>
                        <float name="near_clip" value="4.9"/></sensor>)")
                  .not_carried_over,
              Contains(HasSubstr("near_clip was not carried over")));
  EXPECT_THAT(lost("<integrator type=\"direct\"/>"), Contains(HasSubstr("direct light alone")));
  EXPECT_THAT(lost("<integrator type=\"path\"/>"), Contains(HasSubstr("passes by all media")));
  EXPECT_THAT(lost("<integrator type=\"volpath\"/>"), Not(Contains(HasSubstr("integrator"))));
  EXPECT_THAT(import(R"(<sensor type="perspective"><float name="fov" value="9"/>
                        <transform name="to_world"><scale value="3"/></transform></sensor>)")
                  .not_carried_over,
              Contains(HasSubstr("its transform scales")));
  const ImportedScene sampled = import(R"(<sensor type="perspective"><float name="fov" value="9"/>
                <sampler type="independent"><integer name="sample_count" value="2000000"/></sampler>
                </sensor>)");
  EXPECT_EQ(sampled.samples, 1048576U);
  EXPECT_THAT(sampled.not_carried_over,
              Contains(HasSubstr("sample_count 2000000: it is 1048576 here")));
  EXPECT_THAT(lost("<emitter type=\"sky\"/>"),
              Contains(HasSubstr("it was turned so that its sky")));
  EXPECT_THAT(import(kSensor, "").not_carried_over, Contains(HasSubstr("has no version")));
  EXPECT_THAT(lost("<shape type=\"x&#10;lights { constant {} }\"/>"),
              Contains(HasSubstr("x\\x0alights")));
}

// Mitsuba 3 takes a vector at right angles to the view for it.
TEST_F(ImportMitsuba, TakesUpOfItsOwnWhereThereIsNone) {
  const ImportedScene imported =
      import(R"(<sensor type="perspective"><float name="fov" value="9"/><transform name="to_world">
                <lookat origin="0,1,-5" target="0,0,0"/></transform></sensor>)");
  expect_near(imported.scene.camera().up(), 1, 0, 0);
}

// An area light that shapes refer to is no light by itself.
TEST_F(ImportMitsuba, ReadsAreaLightsThatAreReferredTo) {
  const ImportedScene imported = import(std::string(R"(<emitter type="area" id="e"/>
      <shape type="rectangle"><ref id="e"/></shape>)") +
                                        kSensor);
  EXPECT_EQ(imported.scene.lights_size(), 1);
  EXPECT_THAT(imported.not_carried_over, Not(Contains(HasSubstr("does not shine"))));
}

// Parts of parts of parts, each twice, are visited once.
TEST_F(ImportMitsuba, TakesLittleTimeForFewBytes) {
  std::string body = "<bsdf type=\"diffuse\" id=\"b0\"/>";
  for (int n = 1; n < 60; ++n) {
    body += fmt::format(R"(<bsdf type="twosided" id="b{}"><ref id="b{}"/><ref id="b{}"/></bsdf>)",
                        n, n - 1, n - 1);
  }
  import(body + "<shape type=\"cube\"><ref id=\"b59\"/></shape>" + kSensor);
}

// With the names and the coefficients that 0.6 has.
TEST_F(ImportMitsuba, ReadsOldNames) {
  const ImportedScene imported = import(R"(
      <shape type="cube">
        <transform name="toWorld"><matrix value="0 0 1 0  0 1 0 1  -1 0 0 0  0 0 0 1"/></transform>
        <bsdf type="null"/>
        <medium type="homogeneous" name="interior">
          <spectrum name="sigmaS" value="3"/><spectrum name="sigmaA" value="1"/>
        </medium>
      </shape>
      <emitter type="sunsky">
        <vector name="sunDirection" x="1" y="1" z="0"/><float name="sunRadiusScale" value="20"/>
      </emitter>
      <sensor type="perspective">
        <string name="focalLength" value="60mm"/>
        <transform name="toWorld"><lookat origin="0, 1, 5" target="0, 1, 0" up="0, 1, 0"/></transform>
        <sampler type="ldsampler"><integer name="sampleCount" value="32"/></sampler>
        <film type="hdrfilm">
          <integer name="width" value="300"/><integer name="height" value="200"/>
          <integer name="cropOffsetX" value="75"/><integer name="cropWidth" value="150"/>
          <integer name="cropHeight" value="50"/>
        </film>
      </sensor>)",
                                        "0.5.0");
  const v1::Scene& scene = imported.scene;
  EXPECT_EQ(scene.object().mesh().builtin(), "cube");
  // The matrix has 2 mm, around (0, 1, 0), turned by a quarter.
  const auto& m = scene.object().mesh().transforms(0).matrix().m();
  EXPECT_THAT(std::vector<float>(m.begin(), m.end()),
              ElementsAre(0, 0, 2, 0, 0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 0, 1));
  ASSERT_TRUE(imported.medium);
  EXPECT_EQ((*imported.medium)[0], (Material{4, 0.75, 0}));
  const v1::SunSky& sky = scene.lights(0).sun_sky();
  EXPECT_NEAR(sky.sun_elevation_degrees(), 45, 1e-4);
  EXPECT_NEAR(sky.sun_azimuth_degrees(), 90, 1e-4);
  EXPECT_NEAR(sky.sun_angular_radius_degrees(), 5.33, 1e-4);
  EXPECT_NEAR(sky.sky_scale(), 1 / 106.85698, 1e-7);
  const v1::Camera& camera = scene.camera();
  expect_near(camera.origin(), 0, 1, 5);
  expect_near(camera.target(), 0, 1, 4);
  EXPECT_NEAR(std::tan(camera.fov_degrees() / 360 * M_PI),
              std::hypot(36, 24) / 120 * 3 / std::sqrt(13), 1e-6);
  EXPECT_EQ(to_text_proto(camera.crop()), "left: 0.25\ntop: 0\nright: 0.75\nbottom: 0.25\n");
  EXPECT_EQ(scene.film().width(), 150);
  EXPECT_EQ(scene.film().height(), 50);
  EXPECT_EQ(imported.samples, 32);
  EXPECT_THAT(imported.not_carried_over, ElementsAre(HasSubstr("its sun: of another model")));
}

TEST_F(ImportMitsuba, IsInColourAsTheFilmIs) {
  const std::string lamp = R"(
      <shape type="rectangle"><emitter type="area"><rgb name="radiance" value="1, 2, 3"/></emitter></shape>)";
  EXPECT_TRUE(import(lamp + kSensor).in_colour);
  EXPECT_FALSE(import(kSensor).in_colour);
  EXPECT_FALSE(import(lamp + R"(<sensor type="perspective"><float name="fov" value="20"/>
      <film type="hdrfilm"><string name="pixel_format" value="luminance"/></film></sensor>)")
                   .in_colour);
  options_.channel = v1::Film::RED;
  EXPECT_FALSE(import(lamp + kSensor).in_colour);
}

TEST_F(ImportMitsuba, PutsTexturesWhereTheirTransformDoes) {
  const ImportedScene imported = import(std::string(R"(
      <shape type="rectangle"><bsdf type="diffuse">
        <texture type="checkerboard" name="reflectance"><transform name="to_uv">
          <matrix value="0 2 0 0.5  -4 0 0 1  0 0 1 0  0 0 0 1"/></transform></texture></bsdf></shape>)") +
                                        kSensor);
  // The texture's first coordinate goes along y, its second one against x: it is (0, 0) at u = 1/4
  // and v = -1/4.
  const v1::Checkerboard& board = imported.scene.surfaces(0).checkerboard();
  expect_near(board.corner(), -0.5, -1.5, 0);
  expect_near(board.edge_u(), 0, 0.5, 0);
  expect_near(board.edge_v(), -0.25, 0, 0);
  testing::expect_error(ErrorKind::kInvalidInput, {"to_uv", "flat"}, [&] {
    import(std::string(R"(
      <shape type="rectangle"><bsdf type="diffuse">
        <texture type="checkerboard" name="reflectance"><transform name="to_uv">
          <matrix value="1 1 0 0  1 1 0 0  0 0 1 0  0 0 0 1"/></transform></texture></bsdf></shape>)") +
           kSensor);
  });
}

TEST_F(ImportMitsuba, ReadsSurfacesAndLamps) {
  options_.mm_per_scene_unit = 10;
  const ImportedScene imported = import(std::string(R"(
      <bsdf type="twosided" id="board"><bsdf type="diffuse">
        <texture type="checkerboard" name="reflectance">
          <float name="color0" value="0.1"/><float name="color1" value="0.7"/>
          <transform name="to_uv"><scale x="4" y="2"/></transform>
        </texture></bsdf></bsdf>
      <shape type="rectangle"><ref id="board"/>
        <transform name="to_world"><rotate x="1" angle="-90"/></transform></shape>
      <shape type="rectangle">
        <bsdf type="diffuse"><texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/></texture></bsdf>
      </shape>
      <shape type="sphere"><point name="center" x="1" y="2" z="3"/><float name="radius" value="0.5"/>
        <emitter type="area"><float name="radiance" value="6"/></emitter></shape>
      <shape type="rectangle"><emitter type="area"><rgb name="radiance" value="1, 2, 3"/></emitter></shape>
      <shape type="disk"/>
      <shape type="rectangle">
        <bsdf type="diffuse"><rgb name="reflectance" value="0.9, 0.4, 0.1"/></bsdf></shape>
      <emitter type="point"><point name="position" value="0, 1, 0"/><float name="intensity" value="3"/></emitter>
      <emitter type="directional"><vector name="direction" value="0, -2, 0"/></emitter>)") +
                                        kSensor);
  const v1::Scene& scene = imported.scene;
  EXPECT_TRUE(imported.in_colour);
  ASSERT_EQ(scene.surfaces_size(), 3);
  EXPECT_EQ(scene.surfaces(2).color().green(), 0.4F);
  const v1::Checkerboard& board = scene.surfaces(0).checkerboard();
  expect_near(scene.surfaces(0).rectangle().half_v(), 0, 0, -10);
  expect_near(board.corner(), -10, 0, 10);
  expect_near(board.edge_u(), 2.5, 0, 0);  // half a period of 20 mm / 4
  expect_near(board.edge_v(), 0, 0, -5);
  EXPECT_FLOAT_EQ(board.even(), 0.1F);
  // The first row of the pixels is where v is 0: at the lower end of the rectangle.
  const v1::ImageReflectance& image = scene.surfaces(1).image();
  EXPECT_EQ(image.path(), "a.png");
  expect_near(image.corner(), -10, 10, 0);
  expect_near(image.edge_v(), 0, -20, 0);
  ASSERT_EQ(scene.lights_size(), 4);
  expect_near(scene.lights(0).sphere().center(), 10, 20, 30);
  EXPECT_FLOAT_EQ(scene.lights(0).sphere().radius(), 5);
  EXPECT_FLOAT_EQ(scene.lights(1).panel().radiance(), 0.2126F + 2 * 0.7152F + 3 * 0.0722F);
  EXPECT_EQ(scene.lights(1).color().blue(), 3);
  EXPECT_FLOAT_EQ(scene.lights(2).point().intensity(), 3e-4F);
  expect_near(scene.lights(3).directional().direction(), 0, 1, 0);
  EXPECT_THAT(imported.not_carried_over,
              ElementsAre(HasSubstr("<shape type=\"disk\">: has no counterpart"),
                          HasSubstr("no shape has a medium")));
  options_.channel = v1::Film::BLUE;
  EXPECT_EQ(
      import(
          std::string(
              "<emitter type=\"constant\"><rgb name=\"radiance\" value=\"1, 2, 3\"/></emitter>") +
          kSensor)
          .scene.lights(0)
          .constant()
          .radiance(),
      3);
}

// The world is turned if the zenith of a sky is +z.
TEST_F(ImportMitsuba, PutsSkiesOverY) {
  const v1::Scene scene = import(R"(
      <emitter type="sky"><vector name="sun_direction" value="0, 1, 1"/></emitter>
      <sensor type="perspective"><float name="fov" value="30"/>
        <transform name="to_world"><lookat origin="0, -5, 1" target="0, 0, 1" up="0, 0, 1"/></transform>
      </sensor>)")
                              .scene;
  expect_near(scene.camera().origin(), 0, 1, 5);
  expect_near(scene.camera().up(), 0, 1, 0);
  EXPECT_NEAR(scene.lights(0).sun_sky().sun_elevation_degrees(), 45, 1e-4);
  EXPECT_NEAR(scene.lights(0).sun_sky().sun_azimuth_degrees(), 0, 1e-4);
  EXPECT_EQ(scene.lights(0).sun_sky().sun_scale(), 0);
  EXPECT_NEAR(import(std::string(R"(<emitter type="envmap"><string name="filename" value="sky.exr"/>
      <transform name="to_world"><rotate y="1" angle="50"/></transform></emitter>)") +
                     kSensor)
                  .scene.lights(0)
                  .environment_map()
                  .rotate_y_degrees(),
              50, 1e-4);
}

TEST_F(ImportMitsuba, IncludesFiles) {
  folder_.write("light.xml", R"(<scene version="3.0.0"><emitter type="constant"/></scene>)");
  EXPECT_EQ(import(std::string("<include filename=\"light.xml\"/>") + kSensor).scene.lights_size(),
            1);
  folder_.write("loop.xml", R"(<scene version="3.0.0"><include filename="loop.xml"/></scene>)");
  refuses("<include filename=\"loop.xml\"/>", {"loop.xml", "in one another"});
}

// All that nobody read.
TEST_F(ImportMitsuba, SaysWhatItLeaves) {
  const ImportedScene imported = import(std::string(R"(
      <integrator type="path"><integer name="max_depth" value="6"/></integrator>
      <shape type="cube" id="mirror"><bsdf type="conductor"><string name="material" value="Au"/></bsdf></shape>
      <shape type="sphere"><medium type="heterogeneous" name="interior"/></shape>
      <emitter type="projector"/>
      <emitter type="constant"><float name="sampling_weight" value="2"/></emitter>)") +
                                        kSensor);
  for (const char* const part :
       {"max_depth", "<bsdf type=\"conductor\">: is diffuse", "material was not carried over",
        "only a homogeneous medium", "<emitter type=\"projector\">: has no counterpart",
        "sampling_weight was not carried over"}) {
    EXPECT_THAT(imported.not_carried_over, Contains(HasSubstr(part)));
  }
  EXPECT_FALSE(imported.medium);
}

TEST_F(ImportMitsuba, RefusesWhatItCannotRead) {
  expect_error(ErrorKind::kInvalidInput, {"no <sensor>"}, [&] { import(""); });
  expect_error(ErrorKind::kIo, {"absent.xml"},
               [&] { import_mitsuba(folder_.path("absent.xml"), {}); });
  refuses("<shape", {"scene.xml:1:"});
  folder_.write("pawn.textproto", "lights { constant {} }");
  expect_error(ErrorKind::kInvalidInput, {"pawn.textproto is not in XML"},
               [&] { import_mitsuba(folder_.path("pawn.textproto"), {}); });
  refuses("<ref id=\"nothing\"/>", {"scene.xml:1: <ref", "nothing has this id"});
  refuses("<emitter type=\"constant\"><float name=\"radiance\" value=\"$l\"/></emitter>",
          {"scene.xml:1: <float>", "$l has no <default>", "-D l=VALUE"});
  refuses("<emitter type=\"constant\"><float name=\"radiance\" value=\"1e999\"/></emitter>",
          {"is not a number"});
  refuses("<emitter type=\"constant\"><rgb name=\"radiance\" value=\"1, 2\"/></emitter>",
          {"2 numbers; 1 or 3"});
  refuses("<emitter type=\"constant\"><spectrum name=\"radiance\" value=\"400:1, 700\"/></emitter>",
          {"pairs of a wavelength and a value"});
  refuses("<shape type=\"cube\"><transform name=\"to_world\"><scale x=\"0\"/></transform></shape>",
          {"makes it flat"});
  refuses("<bsdf type=\"twosided\" id=\"b\"><ref id=\"b\"/></bsdf>", {"refers to itself"});
  refuses(R"(<shape type="cube"><bsdf type="null"/><medium type="homogeneous" name="interior">
             <rgb name="sigma_t" value="1, 2, 0"/></medium></shape>)",
          {"scene.xml:1", "(B).sigma_t is 0"});
  refuses(R"(<shape type="cube"><bsdf type="null"/><medium type="homogeneous" name="interior">
             <float name="sigma_t" value="1"/><float name="sigma_s" value="2"/></medium></shape>)",
          {"one pair of them"});
  refuses("<emitter type=\"constant\"><spectrum name=\"radiance\" type=\"d65\"/></emitter>",
          {"<spectrum type=\"d65\"> is not understood"});
  std::string names = "<default name=\"n0\" value=\"1234567890\"/>";
  for (int n = 1; n < 10; ++n) {
    names += fmt::format("<default name=\"n{}\" value=\"", n);
    for (int k = 0; k < 10; ++k) names += fmt::format("$n{}", n - 1);
    names += "\"/>";
  }
  refuses(names, {"has more than 1048576 characters"});
  refuses("<shape type=\"cube\"><transform name=\"to_world\"><shear/></transform></shape>",
          {"<shear> is unknown"});
  refuses(
      "<shape type=\"cube\"><transform name=\"to_world\"><matrix value=\"1 2 "
      "3\"/></transform></shape>",
      {"a matrix of 3 numbers"});
  refuses("<shape type=\"obj\"/>", {"no filename"});
  refuses(
      "<emitter type=\"constant\"><float name=\"radiance\" value=\"1\"/>\n"
      "<float name=\"radiance\" value=\"2\"/></emitter>",
      {"scene.xml:2: <float>", "\"radiance\" is said twice"});
  refuses(R"(<shape type="cube"><transform name="to_world"/><transform name="toWorld"/></shape>)",
          {"\"to_world\" is said twice"});
  refuses(R"(<bsdf type="diffuse" id="b"/><bsdf type="null" id="b"/>)",
          {"the id \"b\" is another one's"});
  refuses(R"(<shape type="sphere"><float name="radius" value="-1"/></shape>)",
          {"radius is -1; it must be above 0"});
  refuses(R"(<shape type="sphere"><float name="radius" value="-1"/><emitter type="area"/></shape>)",
          {"radius is -1; it must be above 0"});
  refuses(R"(<shape type="rectangle"><boolean name="flip_normals" value="1"/>
             <emitter type="area"/></shape>)",
          {"flip_normals", "\"1\" is neither true nor false"});
  refuses("<include filename=\"absent.xml\"/>", {"scene.xml:1: <include>", "absent.xml"},
          ErrorKind::kIo);
  refuses(
      R"(<shape type="cube"><bsdf type="dielectric"><string name="int_ior" value="glass"/></bsdf>
             <medium type="homogeneous" name="interior"/></shape>)",
      {"int_ior: \"glass\" is unknown", "bk7"});
  refuses(R"(<shape type="cube"><bsdf type="null"/><medium type="homogeneous" name="interior">
             <volume type="gridvolume" name="albedo"/></medium></shape>)",
          {"albedo varies from place to place"});
  for (const char* const version : {"9", "3x", "-1", "new"}) {
    expect_error(ErrorKind::kInvalidInput, {"version \"" + std::string(version) + "\" is unknown"},
                 [&] { import(kSensor, version); });
  }
  const auto refuses_camera = [&](const std::string& body, const std::vector<std::string>& parts) {
    expect_error(ErrorKind::kInvalidInput, parts, [&] {
      import("<sensor type=\"perspective\"><float name=\"fov\" value=\"30\"/>" + body +
             "</sensor>");
    });
  };
  refuses_camera(R"(<string name="fov_axis" value="z"/>)",
                 {"fov_axis is \"z\"; it must be x, y, diagonal, smaller, larger"});
  for (const char* const crop :
       {R"(<integer name="crop_offset_x" value="-1"/><integer name="crop_width" value="9"/>)",
        R"(<integer name="crop_offset_y" value="570"/><integer name="crop_height" value="9"/>)"}) {
    refuses_camera("<film type=\"hdrfilm\">" + std::string(crop) + "</film>",
                   {"is not within 768 x 576"});
  }
  std::string deep;
  for (int i = 0; i < 10'000; ++i) deep += "<a>";
  for (int i = 0; i < 10'000; ++i) deep += "</a>";
  refuses(deep, {"in one another"});
}

}  // namespace
}  // namespace itn
