#include "server/scene_compiler/scene_builder.h"

#include "server/scene_compiler/request_builder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <ostream>
#include <string>
#include <variant>
#include <vector>

#include "common/error.h"
#include "common/geometry/shapes.h"
#include "common/scene/field_check.h"
#include "common/scene/wire_array.h"
#include "server/tracer/render.h"
#include "tests/support/expect_error.h"
#include "tests/support/process.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using namespace testing;
using ::testing::HasSubstr;

// ---- Refusals --------------------------------------------------------------------------------

struct BadScene {
  const char* name;
  std::function<void(v1::Scene&)> spoil;
  const char* message;  // a piece of it
  ErrorKind kind = ErrorKind::kInvalidInput;
};

v1::Mesh& mesh(v1::Scene& scene) {
  return *scene.mutable_object()->mutable_mesh();
}

v1::SunSky& sun_sky(v1::Scene& scene) {
  return *scene.mutable_lights(1)->mutable_sun_sky();
}

v1::ImageReflectance& image(v1::Scene& scene) {
  scene.mutable_surfaces(0)->clear_reflectance();
  return *scene.mutable_surfaces(0)->mutable_image();
}

v1::Pixels& pixels(v1::Scene& scene, uint32_t width, uint32_t height, size_t floats) {
  v1::Pixels& p = *scene.mutable_lights(0)->mutable_environment_map()->mutable_pixels();
  p.set_width(width);
  p.set_height(height);
  p.set_rgb(std::string(floats * 4, '\0'));
  return p;
}

const float kNan = std::numeric_limits<float>::quiet_NaN();
const BadScene kBadScenes[] = {
    {"NoObject", [](auto& s) { s.clear_object(); }, "scene.object is missing"},
    {"NoMesh", [](auto& s) { s.mutable_object()->clear_mesh(); }, "scene.object.mesh is missing"},
    {"NoMeshSource", [](auto& s) { mesh(s).clear_source(); }, "one of triangles, path and builtin"},
    {"NoLights", [](auto& s) { s.clear_lights(); }, "scene.lights: at least one"},
    {"TooManyLights",
     [](auto& s) {
       while (s.lights_size() < 65) s.add_lights();
     },
     "[1, 64]"},
    {"NoCamera", [](auto& s) { s.clear_camera(); }, "scene.camera is missing"},
    {"NoFilm", [](auto& s) { s.clear_film(); }, "scene.film is missing"},
    {"UnknownBoundary", [](auto& s) { s.mutable_object()->set_boundary(v1::Object::Boundary(7)); },
     "scene.object.boundary has the unknown value 7"},
    {"UnknownChannel", [](auto& s) { s.mutable_film()->set_channel(v1::Film::Channel(9)); },
     "scene.film.channel has the unknown value 9"},
    {"UnknownField",
     [](auto& s) {
       auto* camera = s.mutable_camera();
       camera->GetReflection()->MutableUnknownFields(camera)->AddVarint(77, 1);
     },
     "scene.camera has a field with the unknown number 77"},
    {"MeshUnit", [](auto& s) { mesh(s).set_unit(v1::CM); }, "millimetres alone"},
    {"MeshRepair", [](auto& s) { mesh(s).set_repair(true); }, "a worker repairs nothing"},
    {"MeshPath", [](auto& s) { mesh(s).set_path("/etc/passwd"); }, "a worker opens no files"},
    {"OnlyRepeatedVertices",
     [](auto& s) {
       mesh(s).set_normalize(true);
       mesh(s).mutable_triangles()->set_positions(to_bytes<Vec3f>({{0, 0, 0}, {1, 0, 0}}));
       mesh(s).mutable_triangles()->set_indices(to_bytes<uint32_t>({0, 1, 0, 1, 1, 0}));
     },
     "scene.object.mesh.triangles has only triangles that repeat a vertex"},
    {"UnknownShape", [](auto& s) { mesh(s).set_builtin("teapot-of-utah"); }, "teapot-of-utah"},
    {"NoPositions", [](auto& s) { mesh(s).mutable_triangles()->clear_positions(); },
     "scene.object.mesh.triangles.positions is missing"},
    {"OddPositions", [](auto& s) { mesh(s).mutable_triangles()->mutable_positions()->pop_back(); },
     "it must be a multiple of 12"},
    {"CornerNormalsOfOtherTriangles",
     [](auto& s) {
       mesh(s).mutable_triangles()->set_corner_normals(to_bytes(std::vector<float>(9, 1)));
     },
     "scene.object.mesh.triangles.corner_normals is of 1 triangles; the mesh has 12"},
    {"CornerNormalOfLengthZero",
     [](auto& s) {
       mesh(s).mutable_triangles()->set_corner_normals(to_bytes(std::vector<float>(108)));
     },
     "scene.object.mesh.triangles.corner_normals has a normal (0, 0, 0)"},
    {"CornerNormalsOfASurface",
     [](auto& s) {
       *s.add_surfaces()->mutable_mesh() = mesh(s);
       s.mutable_surfaces(s.surfaces_size() - 1)
           ->mutable_mesh()
           ->mutable_triangles()
           ->set_corner_normals(to_bytes(std::vector<float>(108, 1)));
     },
     "only scene.object may have them"},
    {"OddIndices", [](auto& s) { mesh(s).mutable_triangles()->mutable_indices()->pop_back(); },
     "it must be a multiple of 12"},
    {"IndexOutOfRange",
     [](auto& s) { (*mesh(s).mutable_triangles()->mutable_indices())[0] = char(200); },
     "scene.object.mesh.triangles"},
    {"PositionNan",
     [](auto& s) {
       mesh(s).mutable_triangles()->mutable_positions()->replace(0, 4, to_bytes<float>({kNan}));
     },
     "scene.object.mesh.triangles"},
    {"NoTransformKind", [](auto& s) { mesh(s).add_transforms(); },
     "scene.object.mesh.transforms[0]: one of translate, rotate, scale and matrix"},
    {"TranslateInfinite",
     [](auto& s) { mesh(s).add_transforms()->mutable_translate()->set_y(INFINITY); },
     "scene.object.mesh.transforms[0].translate.y is inf; it must be finite"},
    {"TranslateFar", [](auto& s) { mesh(s).add_transforms()->mutable_translate()->set_y(1e7F); },
     "after its transforms"},
    {"RotateAboutNothing", [](auto& s) { mesh(s).add_transforms()->mutable_rotate(); },
     "transforms[0].rotate.axis is (0, 0, 0)"},
    {"ScaleZero",
     [](auto& s) {
       *mesh(s).add_transforms()->mutable_scale() = parse_text<v1::Vec3>("x: 1 y: 1");
     },
     "no factor may be 0"},
    {"ShortMatrix", [](auto& s) { mesh(s).add_transforms()->mutable_matrix()->add_m(1); },
     "has 1 numbers; it must have 16"},
    {"MatrixLastRow",
     [](auto& s) {
       auto& matrix = *mesh(s).add_transforms()->mutable_matrix();
       for (int i = 0; i < 16; ++i) matrix.add_m(1);
     },
     "must be 0 0 0 1"},
    {"NoSurfaceShape", [](auto& s) { s.add_surfaces(); }, "scene.surfaces[1]: one of rectangle"},
    {"Reflectance", [](auto& s) { s.mutable_surfaces(0)->set_reflectance(1.5F); },
     "scene.surfaces[0].reflectance is 1.5; it must be in [0, 1]"},
    {"ReflectanceNan", [](auto& s) { s.mutable_surfaces(0)->set_reflectance(kNan); },
     "scene.surfaces[0].reflectance is nan"},
    {"Board",
     [](auto& s) {
       s.mutable_surfaces(0)->set_reflectance(0.5F);
       s.mutable_surfaces(0)->mutable_checkerboard()->set_odd(0.5F);
     },
     "scene.surfaces[0] has reflectance and checkerboard; it must have one of them"},
    {"BoardOdd",
     [](auto& s) {
       s.mutable_surfaces(0)->clear_reflectance();
       s.mutable_surfaces(0)->mutable_checkerboard()->set_odd(2);
     },
     "scene.surfaces[0].checkerboard.odd is 2; it must be in [0, 1]"},
    {"Index", [](auto& s) { s.mutable_object()->mutable_dielectric()->set_index(3); },
     "scene.object.dielectric.index is 3; it must be in [1, 2.5]"},
    {"Roughness", [](auto& s) { s.mutable_object()->mutable_rough_dielectric()->set_roughness(0); },
     "scene.object.rough_dielectric.roughness is 0; it must be in [0.001, 1]"},
    {"AsItWasWritten",
     [](auto& s) { s.mutable_object()->mutable_rough_dielectric()->set_index(1.05F); },
     "scene.object.rough_dielectric.index is 1.05; it must be in [1.1, 2.5]"},
    {"SmoothAngle", [](auto& s) { s.mutable_object()->set_smooth_angle_degrees(181); },
     "scene.object.smooth_angle_degrees is 181; it must be in [0, 180]"},
    {"SmoothAngleOfASurface", [](auto& s) { s.mutable_surfaces(0)->set_smooth_angle_degrees(-1); },
     "scene.surfaces[0].smooth_angle_degrees is -1; it must be in [0, 180]"},
    {"FlatRectangle",
     [](auto& s) {
       auto* r = s.mutable_surfaces(0)->mutable_rectangle();
       *r->mutable_half_v() = r->half_u();
     },
     "must not be parallel"},
    {"NoLightKind", [](auto& s) { s.add_lights(); }, "scene.lights[2]: one of sun_sky"},
    {"Turbidity", [](auto& s) { sun_sky(s).set_turbidity(12); },
     "scene.lights[1].sun_sky.turbidity is 12; it must be in [1, 10]"},
    {"GroundAlbedo", [](auto& s) { sun_sky(s).set_ground_albedo(-1); }, "ground_albedo is -1"},
    {"SunElevation", [](auto& s) { sun_sky(s).set_sun_elevation_degrees(91); }, "[0, 90]"},
    {"SunRadius", [](auto& s) { sun_sky(s).set_sun_angular_radius_degrees(50); }, "[0.1, 45]"},
    {"SunScale", [](auto& s) { sun_sky(s).set_sun_scale(-1); }, "sun_scale is -1"},
    {"SkyScale", [](auto& s) { sun_sky(s).set_sky_scale(2e6F); }, "sky_scale is 2000000"},
    {"ImagePath", [](auto& s) { image(s).set_path("a.png"); },
     "scene.surfaces[0].image.path is set"},
    {"ImageOfNothing", [](auto& s) { image(s); },
     "scene.surfaces[0].image: one of pixels and path"},
    {"ImageTooBright",
     [](auto& s) {
       v1::Pixels& p = *image(s).mutable_pixels();
       p.set_width(1);
       p.set_height(1);
       p.set_rgb(to_bytes<float>({0.5F, 0.5F, 1.5F}));
     },
     "image.pixels.rgb is 1.5 at x = 0, y = 0; it must be in [0, 1]"},
    {"MapPath", [](auto& s) { s.mutable_lights(0)->mutable_environment_map()->set_path("a.exr"); },
     "scene.lights[0].environment_map.path is set"},
    {"MapEmpty", [](auto& s) { pixels(s, 0, 1, 0); },
     "pixels.width is 0; it must be in [1, 16384]"},
    {"MapShort", [](auto& s) { pixels(s, 2, 2, 11); }, "rgb has 44 bytes; 2 x 2 pixels take 48"},
    {"MapNegative",
     [](auto& s) { pixels(s, 2, 1, 6).mutable_rgb()->replace(20, 4, to_bytes<float>({-1})); },
     "rgb is -1 at x = 1, y = 0"},
    {"MapTooBright",
     [](auto& s) {
       pixels(s, 2, 1, 6).mutable_rgb()->replace(20, 4, to_bytes<float>({1e8F}));
       s.mutable_lights(0)->mutable_environment_map()->set_scale(20);
     },
     "rgb is 100000000 at x = 1, y = 0; times the scale it must be in [0, 1e+09]"},
    {"Radiance", [](auto& s) { s.mutable_lights(0)->mutable_constant()->set_radiance(-1); },
     "scene.lights[0].constant.radiance is -1"},
    {"NoDirection", [](auto& s) { s.mutable_lights(1)->mutable_directional()->clear_direction(); },
     "directional.direction is (0, 0, 0)"},
    {"LampFarAway",
     [](auto& s) { s.add_lights()->mutable_point()->mutable_position()->set_y(2e6F); },
     "scene.lights[2].point.position"},
    {"Intensity", [](auto& s) { s.add_lights()->mutable_point()->set_intensity(-1); },
     "scene.lights[2].point.intensity is -1; it must be in [0, 1e+09]"},
    {"SphereOfNoSize", [](auto& s) { s.add_lights()->mutable_sphere()->set_radius(0); },
     "scene.lights[2].sphere.radius is 0; it must be in [1e-06, 1e+06]"},
    {"WideSpot", [](auto& s) { s.add_lights()->mutable_spot()->set_outer_angle_degrees(91); },
     "scene.lights[2].spot.outer_angle_degrees is 91; it must be in [0.1, 90]"},
    {"Panel", [](auto& s) { s.add_lights()->mutable_panel()->set_radiance(-1); },
     "scene.lights[2].panel.radiance is -1"},
    {"Fov", [](auto& s) { s.mutable_camera()->set_fov_degrees(179); },
     "scene.camera.fov_degrees is 179; it must be in (0, 179)"},
    {"PrincipalPointFarAway", [](auto& s) { s.mutable_camera()->set_principal_x(11); },
     "scene.camera.principal_x is 11; it must be in [-10, 10]"},
    {"CropFarAway", [](auto& s) { s.mutable_camera()->mutable_crop()->set_left(-11); },
     "scene.camera.crop.left is -11"},
    {"CameraOnTarget", [](auto& s) { *s.mutable_camera()->mutable_origin() = s.camera().target(); },
     "scene.camera.target is the origin"},
    {"UpAlongView",
     [](auto& s) { *s.mutable_camera()->mutable_up() = parse_text<v1::Vec3>("y: -1 z: 4"); },
     "scene.camera.up is parallel"},
    {"OtherWithoutMesh", [](auto& s) { s.add_other_objects(); },
     "scene.other_objects[0].mesh is missing"},
    {"OtherWithoutMaterial", [](auto& s) { *s.add_other_objects() = s.object(); },
     "scene.other_objects[0].material is missing"},
    {"OtherWithMedium",
     [](auto& s) {
       *s.add_other_objects() = s.object();
       s.mutable_other_objects(0)->mutable_medium()->set_name("marble");
     },
     "scene.other_objects[0] has a medium; a worker needs its material instead"},
    {"OtherColours",
     [](auto& s) {
       *s.add_other_objects() = s.object();
       for (int i = 0; i < 3; ++i) s.mutable_other_objects(0)->add_material()->set_sigma_t(1);
     },
     "scene.other_objects[0] has 3 materials; a worker needs one"},
    {"OtherMaterial",
     [](auto& s) {
       *s.add_other_objects() = s.object();
       s.mutable_other_objects(0)->add_material()->set_sigma_t(-1);
     },
     "scene.other_objects[0].material.sigma_t is -1"},
    {"OtherIndex",
     [](auto& s) {
       *s.add_other_objects() = s.object();
       s.mutable_other_objects(0)->add_material()->set_sigma_t(1);
       s.mutable_other_objects(0)->mutable_dielectric()->set_index(3);
     },
     "scene.other_objects[0].dielectric.index is 3; it must be in [1, 2.5]"},
    {"NoWidth", [](auto& s) { s.mutable_film()->set_width(0); }, "scene.film.width is 0"},
    {"WidthOverflow", [](auto& s) { s.mutable_film()->set_width(4'000'000'000U); }, "[1, 65536]"},
    {"BillionPixels",
     [](auto& s) { s.mutable_film()->set_width(40000), s.mutable_film()->set_height(25000); },
     "the number of pixels of scene.film is 1000000000; this worker accepts at most 16777216",
     ErrorKind::kLimit},
};

void PrintTo(const BadScene& row, std::ostream* out) {
  *out << row.name;
}

class RefusedScene : public ::testing::TestWithParam<BadScene> {};

TEST_P(RefusedScene, NamesTheFieldAndItsRange) {
  v1::Scene scene = cube_scene();
  GetParam().spoil(scene);
  try {
    build_scene(scene, RenderLimits());
    FAIL() << "accepted";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr(GetParam().message));
    EXPECT_EQ(error.kind(), GetParam().kind);
  }
}

INSTANTIATE_TEST_SUITE_P(Table, RefusedScene, ::testing::ValuesIn(kBadScenes),
                         [](const auto& row) { return row.param.name; });

TEST(SceneBuilder, CountsTheTrianglesOfAllMeshes) {
  v1::Scene scene = cube_scene();  // 12 of the cube, 2 of the ground
  RenderLimits limits;
  limits.max_triangles = 14;
  EXPECT_NO_THROW(build_scene(scene, limits));
  limits.max_triangles = 13;
  EXPECT_THROW(build_scene(scene, limits), Error);
}

// A few bytes each ask for a built-in shape, which takes a while to make.
TEST(SceneBuilder, MakesABuiltInShapeOnceHoweverOftenItIsThere) {
  double start = testing::own_cpu_seconds();
  const uint64_t triangles = make_shape("tree").triangles.size();
  const double one = testing::own_cpu_seconds() - start;
  v1::Scene scene = cube_scene();
  constexpr int kTrees = 64;
  for (int i = 0; i < kTrees; ++i) scene.add_surfaces()->mutable_mesh()->set_builtin("tree");
  RenderLimits limits;
  limits.max_triangles = 12 + 2 + kTrees * triangles;
  start = testing::own_cpu_seconds();
  EXPECT_EQ(build_scene(scene, limits).surfaces.back().mesh.triangles.size(), triangles);
  EXPECT_LT(testing::own_cpu_seconds() - start, kTrees / 4 * one) << "processor time, in s";
  --limits.max_triangles;
  EXPECT_THROW(build_scene(scene, limits), Error);
}

TEST(SceneBuilder, RefusesBytesThatAreNoScene) {
  EXPECT_THROW(parse_scene("\xff\xff\xff"), Error);
}

TEST(SceneBuilder, CountsObjectsAndMaterialsBeforeTheyAreParsed) {
  const auto expect_refused = [](const v1::Scene& scene, const char* message) {
    testing::expect_error(ErrorKind::kInvalidInput, {message},
                          [&] { parse_scene(scene.SerializeAsString()); });
  };
  v1::Scene scene = cube_scene();
  for (int i = 0; i < kMaxOtherObjects; ++i) scene.add_other_objects();
  for (int i = 0; i < kMaxMaterials; ++i) scene.mutable_other_objects(0)->add_material();
  EXPECT_NO_THROW(parse_scene(scene.SerializeAsString()));
  scene.mutable_other_objects(0)->add_material();
  expect_refused(scene, "scene.other_objects.material has more than 3 elements");
  scene.mutable_other_objects(0)->clear_material();
  scene.add_other_objects();
  expect_refused(scene, "scene.other_objects has more than 15 elements");
}

// ---- Conversions -----------------------------------------------------------------------------

// The object where it stands in the scene.
Mesh placed_object(const v1::Scene& scene) {
  tracer::SceneDescription description = build_scene(scene, RenderLimits());
  for (Vec3f& v : description.object.vertices) {
    v = static_cast<Vec3f>(description.pose.to_scene(static_cast<Vec3d>(v)));
  }
  return description.object;
}

Vec3f first_vertex_after(const std::string& transforms) {
  v1::Scene scene = cube_scene();
  scene.mutable_object()->mutable_mesh()->MergeFrom(parse_text<v1::Mesh>(transforms));
  return placed_object(scene).vertices.at(0);  // (-0.5, 0, -0.5) before
}

void expect_near(Vec3f a, Vec3f b) {
  EXPECT_NEAR(a.x, b.x, 1e-6);
  EXPECT_NEAR(a.y, b.y, 1e-6);
  EXPECT_NEAR(a.z, b.z, 1e-6);
}

TEST(SceneBuilder, AppliesTransformsInTheOrderWritten) {
  expect_near(first_vertex_after(
                  "transforms { translate { x: 1 } } transforms { scale { x: 2 y: 2 z: 2 } }"),
              {1, 0, -1});
  expect_near(first_vertex_after(
                  "transforms { scale { x: 2 y: 2 z: 2 } } transforms { translate { x: 1 } }"),
              {0, 0, -1});
}

TEST(SceneBuilder, RotatesCounterClockwiseSeenAgainstTheAxis) {
  // About y, from +z to +x: (x, z) = (-0.5, -0.5) goes to (-0.5, 0.5).
  expect_near(first_vertex_after("transforms { rotate { axis { y: 3 } angle_degrees: 90 } }"),
              {-0.5F, 0, 0.5F});
}

// Only what comes before the last rotations and translations is done to the mesh.
TEST(SceneBuilder, TheLastRotationsAndTranslationsAreThePose) {
  v1::Scene scene = cube_scene();
  scene.mutable_object()->mutable_mesh()->MergeFrom(parse_text<v1::Mesh>(R"(
      transforms { rotate { axis { y: 1 } angle_degrees: 90 } }
      transforms { scale { x: 2 y: 1 z: 1 } }
      transforms { rotate { axis { z: 1 } angle_degrees: 90 } }
      transforms { translate { x: 5 } })"));
  const tracer::SceneDescription description = build_scene(scene, RenderLimits());
  expect_near(description.object.vertices.at(0), {-1, 0, 0.5F});
  expect_near(static_cast<Vec3f>(description.pose.to_scene({1, 0, 0})), {5, 1, 0});
}

TEST(SceneBuilder, TakesMatricesRowByRow) {
  expect_near(
      first_vertex_after("transforms { matrix { m: [1,0,0,7, 0,1,0,8, 0,0,1,9, 0,0,0,1] } }"),
      {6.5F, 8, 8.5F});
}

TEST(SceneBuilder, NormalizesBeforeTheTransforms) {
  // A cube of 1 mm that was moved and scaled beforehand comes back; then it is moved by 1.
  v1::Scene scene = cube_scene();
  auto moved = placed_object(scene);
  std::vector<float> positions;
  for (const Vec3f v : moved.vertices) {
    for (const float c : {v.x * 4 + 1, v.y * 4 - 3, v.z * 4 + 2}) positions.push_back(c);
  }
  std::vector<uint32_t> indices;
  for (const auto& t : moved.triangles) indices.insert(indices.end(), t.begin(), t.end());
  auto& proto = *scene.mutable_object()->mutable_mesh();
  proto.mutable_triangles()->set_positions(to_bytes(positions));
  proto.mutable_triangles()->set_indices(to_bytes(indices));
  proto.set_normalize(true);
  proto.add_transforms()->mutable_translate()->set_x(1);
  const Bounds box = bounds(placed_object(scene));
  expect_near(box.min, {0.5F, 0, -0.5F});
  expect_near(box.max, {1.5F, 1, 0.5F});
}

// They stay normals of the surface however that is scaled; turns that come last are the pose.
TEST(SceneBuilder, CornerNormalsTakeTheTransforms) {
  v1::Scene scene = cube_scene();
  auto& proto = *scene.mutable_object()->mutable_mesh();
  const size_t triangles = placed_object(scene).triangles.size();
  std::vector<Vec3f> normals(3 * triangles, Vec3f{3, 3, 0});
  proto.mutable_triangles()->set_corner_normals(to_bytes(normals));
  auto& factors = *proto.add_transforms()->mutable_scale();
  factors.set_x(2);
  factors.set_y(1);
  factors.set_z(1);
  auto& turn = *proto.add_transforms()->mutable_rotate();
  turn.mutable_axis()->set_y(1);
  turn.set_angle_degrees(90);
  const auto built = build_scene(scene, RenderLimits()).corner_normals;
  ASSERT_EQ(built.size(), triangles);
  const float unit = std::sqrt(0.2F);
  for (const auto& corners : built) {
    for (const Vec3f n : corners) expect_near(n, {unit, 2 * unit, 0});
  }
}

// The mirror image of an object is one: its triangles face outwards.
TEST(SceneBuilder, TakesMirrorImages) {
  v1::Scene scene = cube_scene();
  auto& proto = *scene.mutable_object()->mutable_mesh();
  const Mesh mesh = placed_object(scene);
  auto& matrix = *proto.add_transforms()->mutable_matrix();
  for (const int m : {-2, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}) {
    matrix.add_m(static_cast<float>(m));
  }
  const Mesh mirrored = placed_object(scene);
  EXPECT_DOUBLE_EQ(signed_volume(mirrored), 2 * signed_volume(mesh));
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    const Vec3f v = mesh.vertices[i];
    expect_near(mirrored.vertices[i], {5 - 2 * v.x, v.y, v.z});
  }
  // Normals stay with their corners.
  const size_t triangles = mesh.triangles.size();
  std::vector<Vec3f> normals(3 * triangles);
  for (size_t i = 0; i < normals.size(); ++i) normals[i] = {1, static_cast<float>(i % 3), 0};
  proto.mutable_triangles()->set_corner_normals(to_bytes(normals));
  const auto corners = build_scene(scene, RenderLimits()).corner_normals[0];
  expect_near(corners[0], {-1, 0, 0});
  EXPECT_NEAR(corners[1].y / -corners[1].x, 4, 1e-5);  // the third; x is twice as far
  EXPECT_NEAR(corners[2].y / -corners[2].x, 2, 1e-5);
}

TEST(SceneBuilder, WeldsTriangleSoup) {
  v1::Scene scene = cube_scene();
  const Mesh mesh = placed_object(scene);
  std::vector<float> positions;
  std::vector<uint32_t> indices;
  for (const auto& triangle : mesh.triangles) {
    for (const uint32_t vertex : triangle) {
      const Vec3f v = mesh.vertices[vertex];
      indices.push_back(static_cast<uint32_t>(indices.size()));
      positions.insert(positions.end(), {v.x, v.y, v.z});
    }
  }
  auto& triangles = *scene.mutable_object()->mutable_mesh()->mutable_triangles();
  triangles.set_positions(to_bytes(positions));
  triangles.set_indices(to_bytes(indices));
  EXPECT_EQ(placed_object(scene).vertices.size(), 8U);
}

// ---- Sizes -------------------------------------------------------------------------------------

// The cube and all around it so many times as large.
v1::Scene scaled_scene(float factor) {
  v1::Scene scene = cube_scene();
  const auto scale = [&](v1::Vec3& v) {
    v.set_x(factor * v.x());
    v.set_y(factor * v.y());
    v.set_z(factor * v.z());
  };
  auto& by = *mesh(scene).add_transforms()->mutable_scale();
  by.set_x(factor);
  by.set_y(factor);
  by.set_z(factor);
  v1::Rectangle& ground = *scene.mutable_surfaces(0)->mutable_rectangle();
  scale(*ground.mutable_half_u());
  scale(*ground.mutable_half_v());
  scale(*scene.mutable_camera()->mutable_origin());
  scale(*scene.mutable_camera()->mutable_target());
  return scene;
}

tracer::RenderedImages render(const v1::Scene& scene, double sigma_t, tracer::Tracer tracer) {
  const tracer::Scene built(build_scene(scene, RenderLimits()));
  tracer::RenderRequest request{.material = {sigma_t, 0.9, 0.3}, .sample_count = 64};
  request.tracer = tracer;
  return tracer::means(tracer::render_grad(built, request));
}

// By powers of two nothing is rounded otherwise: the smallest and largest objects have the same
// image, but where a length is compared with a constant.
TEST(SceneSize, DoesNotMatter) {
  for (const auto tracer : {tracer::Tracer::kWavefront, tracer::Tracer::kReference}) {
    const auto expected = render(scaled_scene(1), 0.5, tracer).estimates.at(0).radiance;
    for (const int exponent : {-19, -10, 10, 15}) {
      const auto image =
          render(scaled_scene(std::ldexp(1.0F, exponent)), std::ldexp(0.5, -exponent), tracer)
              .estimates.at(0)
              .radiance;
      EXPECT_EQ(image, expected) << "2^" << exponent;
    }
  }
}

void expect_refused(const v1::Scene& scene, const char* message) {
  try {
    tracer::Scene built(build_scene(scene, RenderLimits()));
    FAIL() << "accepted";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr(message));
    EXPECT_EQ(error.kind(), ErrorKind::kInvalidInput);
  }
}

TEST(SceneSize, MustBeWhatFloatsResolve) {
  for (const float factor : {1e-45F, 3e-45F, 1e-44F, 1e-38F, 1e-20F, 9e-7F}) {
    expect_refused(scaled_scene(factor), "it must be 1e-06 mm at least");
  }
  // Far from the origin of its own coordinates, or from the camera.
  v1::Scene scene = cube_scene();
  for (v1::Transform* move : {mesh(scene).add_transforms(), mesh(scene).add_transforms()}) {
    move->mutable_translate()->set_x(2e5F);
    move = mesh(scene).add_transforms();
    move->mutable_scale()->set_x(1);
    move->mutable_scale()->set_y(1);
    move->mutable_scale()->set_z(1);
  }
  expect_refused(scene, "2e-05 of its largest coordinate");
  scene = cube_scene();
  scene.mutable_camera()->mutable_origin()->set_x(2e5F);
  expect_refused(scene, "2e-05 at least of the distance to the camera");
}

TEST(SceneBuilder, FillsInTheDocumentedDefaults) {
  v1::Scene scene = cube_scene();
  scene.clear_lights();
  scene.add_lights()->mutable_sun_sky();
  scene.mutable_camera()->clear_fov_degrees();
  const auto built = build_scene(scene, RenderLimits());
  const auto& sky = std::get<tracer::SunSkyLight>(built.lights.at(0));
  const double degree = std::numbers::pi / 180;
  EXPECT_DOUBLE_EQ(sky.turbidity, 3);
  EXPECT_DOUBLE_EQ(sky.ground_albedo, 0.15);
  EXPECT_DOUBLE_EQ(sky.sun_elevation, 60 * degree);
  EXPECT_DOUBLE_EQ(sky.sun_azimuth, 0);
  EXPECT_DOUBLE_EQ(sky.sun_angular_radius, 0.2665 * degree);
  EXPECT_DOUBLE_EQ(sky.sun_scale, 1);
  EXPECT_DOUBLE_EQ(sky.sky_scale, 1);
  EXPECT_DOUBLE_EQ(built.camera.fov, 40 * degree);
  EXPECT_EQ(built.camera.up, (Vec3d{0, 1, 0}));
  EXPECT_EQ(std::get<tracer::UniformReflectance>(built.surfaces.at(0).reflectance).value, 0.5F);
  EXPECT_EQ(built.film.channel, tracer::Channel::kLuminance);
}

// The names by which kinds know their fields.
struct FieldNames {
  std::vector<std::string> names;

  void number(const char* name, double, double, double) { names.emplace_back(name); }
  void slot(const char* name, double, double, double) { names.emplace_back(name); }
  void flag(const char* name, bool) { names.emplace_back(name); }
  void angle(const char* name, double, double = 0, double = 0) { names.emplace_back(name); }
  void direction(const char* name, const Vec3d&) { names.emplace_back(name); }
  void position(const char* name, const Vec3d&) { names.emplace_back(name); }
  void moving_direction(const char* name, const Vec3d&) { names.emplace_back(name); }
  void moving_position(const char* name, const Vec3d&) { names.emplace_back(name); }
  template <typename Map>
  void pixels(const char* name, const Map&) {
    names.insert(names.end(), {name, "path"});
  }
};

template <typename... Kinds>
std::map<std::string, std::vector<std::string>> fields_of(std::variant<Kinds...> /*type*/) {
  std::map<std::string, std::vector<std::string>> result;
  const auto note = [&]<typename Kind>(const Kind& kind) {
    FieldNames fields;
    Kind::fields(kind, fields);
    result[Kind::kName] = fields.names;
  };
  (note(Kinds()), ...);
  return result;
}

// The fields of the messages of a oneof are those of the kinds of the same names.
template <typename Variant>
void expect_all_are_read(const google::protobuf::OneofDescriptor& oneof) {
  const auto read = fields_of(Variant());
  for (int i = 0; i < oneof.field_count(); ++i) {
    std::vector<std::string> names;
    const auto& message = *oneof.field(i)->message_type();
    for (int k = 0; k < message.field_count(); ++k) names.push_back(message.field(k)->name());
    ASSERT_TRUE(read.contains(oneof.field(i)->name())) << oneof.field(i)->name();
    EXPECT_THAT(read.at(oneof.field(i)->name()), ::testing::UnorderedElementsAreArray(names));
  }
}

TEST(SceneBuilder, EveryFieldOfEveryKindIsRead) {
  expect_all_are_read<tracer::LightDescription>(*v1::Light::descriptor()->FindOneofByName("kind"));
  expect_all_are_read<tracer::Boundary>(*v1::Object::descriptor()->FindOneofByName("refraction"));
  expect_all_are_read<tracer::Reflectance>(*v1::Surface::descriptor()->FindOneofByName("pattern"));
  EXPECT_EQ(std::variant_size_v<tracer::LightDescription>,
            v1::Light::descriptor()->FindOneofByName("kind")->field_count());
}

// Derivatives are in its coordinates.
TEST(SceneBuilder, TheDirectionOfALightHasAnyLength) {
  v1::Scene scene = cube_scene();
  *scene.add_lights() = parse_text<v1::Light>("directional { direction { x: 3 y: 4 } }");
  const auto built = build_scene(scene, RenderLimits());
  EXPECT_EQ(std::get<tracer::DirectionalLight>(built.lights.back()).direction, (Vec3d{3, 4, 0}));
}

TEST(SceneBuilder, TakesColours) {
  v1::Scene scene = cube_scene();
  scene.mutable_surfaces(0)->clear_reflectance();
  scene.mutable_surfaces(0)->mutable_color()->set_red(0.9F);
  scene.mutable_lights(0)->mutable_color()->set_blue(0.25F);
  const auto built = build_scene(scene, RenderLimits());
  const auto& surface = std::get<tracer::ColorReflectance>(built.surfaces.at(0).reflectance);
  EXPECT_EQ((std::array{surface.red, surface.green, surface.blue}), (std::array{0.9F, 0.5F, 0.5F}));
  EXPECT_EQ(built.light_colours.at(0), (tracer::Rgb{1, 1, 0.25}));
  scene.mutable_lights(0)->mutable_color()->set_blue(-1);
  expect_error(ErrorKind::kInvalidInput, {"scene.lights[0].color.blue is -1"},
               [&] { build_scene(scene, RenderLimits()); });
  *scene.mutable_lights(0)->mutable_color() = parse_text<v1::LightColor>("red: 0 green: 0 blue: 0");
  expect_error(ErrorKind::kInvalidInput, {"scene.lights[0].color", "one of them must shine"},
               [&] { build_scene(scene, RenderLimits()); });
}

TEST(SceneBuilder, TakesABoundary) {
  v1::Scene scene = cube_scene();
  EXPECT_FALSE(stops_lines(build_scene(scene, RenderLimits()).boundary));
  scene.mutable_object()->mutable_dielectric();
  const auto boundary = [&] { return build_scene(scene, RenderLimits()).boundary; };
  EXPECT_EQ(std::get<tracer::Dielectric>(boundary()).index, 1.5F);
  scene.mutable_object()->mutable_dielectric()->set_index(1.33F);
  EXPECT_EQ(std::get<tracer::Dielectric>(boundary()).index, 1.33F);
  v1::RoughDielectric& rough = *scene.mutable_object()->mutable_rough_dielectric();
  EXPECT_FALSE(std::get<tracer::RoughDielectric>(boundary()).single_scattering);
  EXPECT_EQ(std::get<tracer::RoughDielectric>(boundary()).roughness, 0.25F);
  rough.set_roughness(0.5F);
  rough.set_single_scattering(true);
  EXPECT_TRUE(std::get<tracer::RoughDielectric>(boundary()).single_scattering);
  EXPECT_EQ(std::get<tracer::RoughDielectric>(boundary()).roughness, 0.5F);
  EXPECT_EQ(build_scene(scene, RenderLimits()).smooth_angle, 0);
  scene.mutable_object()->set_smooth_angle_degrees(90);
  EXPECT_DOUBLE_EQ(build_scene(scene, RenderLimits()).smooth_angle, std::numbers::pi / 2);
  scene.add_surfaces()->mutable_mesh()->set_builtin("cube");
  scene.mutable_surfaces()->rbegin()->set_smooth_angle_degrees(90);
  EXPECT_DOUBLE_EQ(build_scene(scene, RenderLimits()).surfaces.back().smooth_angle,
                   std::numbers::pi / 2);
}

TEST(SceneBuilder, TakesOtherObjects) {
  v1::Scene scene = cube_scene();
  scene.mutable_object()->mutable_dielectric();
  v1::Object& other = *scene.add_other_objects();
  other.mutable_mesh()->set_builtin("sphere");
  *other.mutable_mesh()->add_transforms()->mutable_translate() = parse_text<v1::Vec3>("x: 3");
  other.mutable_dielectric()->set_index(1.25F);
  other.set_smooth_angle_degrees(90);
  *other.add_material() = parse_text<v1::Material>("sigma_t: 3 albedo: 0.5 g: 0.25");
  const auto description = build_scene(scene, RenderLimits());
  ASSERT_EQ(description.other_objects.size(), 1U);
  const tracer::OtherObject& built = description.other_objects[0];
  EXPECT_EQ(built.material, (Material{3, 0.5, 0.25}));
  EXPECT_EQ(std::get<tracer::Dielectric>(built.boundary).index, 1.25F);
  EXPECT_DOUBLE_EQ(built.smooth_angle, std::numbers::pi / 2);
  EXPECT_NEAR(bounds(built.mesh).min.x, 2.5F, 1e-3F);
}

TEST(SceneBuilder, ZeroIsNotAbsent) {
  v1::Scene scene = cube_scene();
  scene.mutable_surfaces(0)->set_reflectance(0);
  auto& sky = *scene.mutable_lights(0)->mutable_sun_sky();
  sky.set_sun_scale(0);
  sky.set_sun_elevation_degrees(0);
  const auto built = build_scene(scene, RenderLimits());
  EXPECT_EQ(std::get<tracer::UniformReflectance>(built.surfaces.at(0).reflectance).value, 0);
  EXPECT_EQ(std::get<tracer::SunSkyLight>(built.lights.at(0)).sun_scale, 0);
  EXPECT_EQ(std::get<tracer::SunSkyLight>(built.lights.at(0)).sun_elevation, 0);
}

// ---- Requests --------------------------------------------------------------------------------

v1::RenderGradRequest request_of_any_scene() {
  v1::RenderGradRequest request = small_request();
  request.set_scene("any");
  return request;
}

TEST(RequestBuilder, TakesWhatTheRequestSays) {
  v1::RenderGradRequest request = request_of_any_scene();
  request.mutable_tile()->set_x(2);
  request.mutable_tile()->set_height(5);
  const tracer::RenderRequest built = build_request(request, RenderLimits()).asked;
  EXPECT_EQ(built.material, (Material{8, 0.9, 0.3}));
  EXPECT_EQ(built.sample_count, 8U);
  EXPECT_EQ(built.tile.value().x, 2U);
  EXPECT_EQ(built.tile.value().height, 5U);
  EXPECT_EQ(built.seed, 5U);
  EXPECT_EQ(built.estimates, 2U);
  EXPECT_EQ(built.derivatives, tracer::medium_parameters());
}

TEST(RequestBuilder, HasTheDocumentedDefaults) {
  v1::RenderGradRequest request = request_of_any_scene();
  request.clear_derivatives();
  request.clear_estimates();
  request.clear_seed();
  const tracer::RenderRequest built = build_request(request, RenderLimits()).asked;
  EXPECT_EQ(built.sample_count, 8U);
  EXPECT_FALSE(built.tile);
  EXPECT_EQ(built.seed, 0U);
  EXPECT_EQ(built.estimates, 1U);
  EXPECT_TRUE(built.derivatives.empty());
}

// Numbers come as floats.
TEST(RequestBuilder, TakesRangesToTheirEnds) {
  const auto check = [](const std::string& text) {
    v1::RenderGradRequest request = request_of_any_scene();
    request.clear_material();
    request.clear_derivatives();
    request.MergeFrom(parse_text<v1::RenderGradRequest>(text));
    validate(build_request(request, {}).asked);
  };
  for (const std::string text :
       {"material { sigma_t: 1e-6 albedo: 1 g: 0.99 } spp: 2",
        "material { sigma_t: 1 g: -0.99 } spp: 2",
        "material { sigma_t: 1 } spp: 2 phase { two_term { g_1: 0.99 g_2: -0.99 } }"}) {
    EXPECT_NO_THROW(check(text)) << text;
  }
  EXPECT_THROW(check("material { sigma_t: 1 g: 0.9901 } spp: 2"), Error);
  v1::Scene scene = scaled_scene(1e-6F);
  *scene.add_lights() = parse_text<v1::Light>("sphere { center { y: 3 } radius: 1e-6 }");
  EXPECT_NO_THROW(tracer::Scene(build_scene(scene, RenderLimits())));
}

TEST(RequestBuilder, TakesAPhaseFunction) {
  v1::RenderGradRequest request = request_of_any_scene();
  request.clear_derivatives();
  request.mutable_material()->clear_g();
  request.mutable_phase()->mutable_two_term()->set_weight(0.25F);
  request.add_scene_derivatives("two_term.weight");
  const tracer::RenderRequest built = build_request(request, RenderLimits()).asked;
  const auto phase = std::get<tracer::TwoTerm>(built.phase.value());
  EXPECT_EQ(phase.weight, 0.25F);
  EXPECT_EQ(phase.g_1, 0.8F);
  EXPECT_NEAR(built.material.g, 0.25 * 0.8 + 0.75 * -0.3, 1e-6);
  EXPECT_EQ(tracer::name_of(built.derivatives.at(0)), "two_term.weight");

  const auto refusal = [&](const auto& spoil) -> std::string {
    v1::RenderGradRequest bad = request;
    spoil(bad);
    try {
      build_request(bad, RenderLimits());
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal([](auto& r) { r.mutable_phase()->mutable_two_term()->set_g_2(1); }),
            "phase.two_term.g_2 is 1; it must be in [-0.99, 0.99]");
  EXPECT_EQ(refusal([](auto& r) { r.mutable_phase()->clear_two_term(); }),
            "phase: one of two_term and von_mises_fisher is missing; it is required");
  EXPECT_EQ(refusal([](auto& r) { r.mutable_material()->set_g(0.5); }),
            "material.g is 0.5 beside a phase; it must be absent");
  EXPECT_EQ(refusal([](auto& r) { r.add_derivatives(v1::G); }),
            "no derivative in g: there is two_term.g_1, two_term.g_2, two_term.weight");
}

TEST(ReplySize, IsBounded) {
  const v1::RenderGradRequest request = small_request();  // 2 estimates of 1 + 6 images, 2 others
  RenderLimits limits;
  limits.max_message_bytes = 16 * 10 * 10 * sizeof(float);
  EXPECT_NO_THROW(check_reply_size(10, 10, request, limits));
  EXPECT_THROW(check_reply_size(10, 11, request, limits), Error);
  v1::RenderGradRequest tile = request;
  tile.mutable_tile()->set_width(10);
  tile.mutable_tile()->set_height(10);
  EXPECT_NO_THROW(check_reply_size(1000, 1000, tile, limits));
}

}  // namespace
}  // namespace itn
