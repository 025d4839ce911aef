#include "client/scene/scene_file.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <bit>
#include <cstdio>
#include <cstring>
#include <string>

#include "client/image/image.h"
#include "client/image/srgb.h"
#include "common/error.h"
#include "common/logging.h"
#include "common/scene/wire_array.h"
#include "tests/support/captured_log.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace std::string_literals;

using namespace testing;

constexpr const char* kObj =
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

template <typename T>
T element(const std::string& bytes, size_t i) {
  T value;
  std::memcpy(&value, bytes.data() + i * sizeof(T), sizeof(T));
  return value;
}

TEST(SceneFile, ReadsTextWithComments) {
  const TemporaryFolder folder;
  const v1::Scene scene = load_scene(folder.write("scene.txt", R"(
    # A ball under a clear sky.
    object { mesh { builtin: "sphere" normalize: true } }
    lights { sun_sky { turbidity: 4 } }
    camera { origin { y: 8.78 z: -32.8 } fov_degrees: 2.5 }
    film { width: 64 height: 32 channel: RED }
  )"));
  EXPECT_EQ(scene.object().mesh().builtin(), "sphere");
  EXPECT_TRUE(scene.object().mesh().normalize());
  EXPECT_EQ(scene.lights(0).sun_sky().turbidity(), 4);
  EXPECT_FALSE(scene.lights(0).sun_sky().has_ground_albedo());
  EXPECT_EQ(scene.camera().fov_degrees(), 2.5F);
  EXPECT_EQ(scene.film().width(), 64U);
  EXPECT_EQ(scene.film().channel(), v1::Film::RED);
}

TEST(SceneFile, PutsMeshesInThePlaceOfPathsBesideIt) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder.path() / "meshes");
  folder.write("meshes/t.obj", kObj);
  const v1::Scene scene = load_scene(folder.write("scene.txt", R"(
    object { mesh { path: "meshes/t.obj" transforms { translate { y: 1 } } } }
    other_objects { mesh { path: "meshes/t.obj" } }
    surfaces { mesh { path: "meshes/t.obj" } }
    surfaces { rectangle { half_u { x: 1 } half_v { z: 1 } } }
  )"));
  for (const v1::Mesh& mesh :
       {scene.object().mesh(), scene.other_objects(0).mesh(), scene.surfaces(0).mesh()}) {
    ASSERT_TRUE(mesh.has_triangles());
    EXPECT_EQ(mesh.triangles().positions().size(), 4U * 12);
    EXPECT_EQ(mesh.triangles().indices().size(), 4U * 12);
    EXPECT_LT(element<uint32_t>(mesh.triangles().indices(), 11), 4U);
  }
  EXPECT_EQ(scene.object().mesh().transforms_size(), 1);
  EXPECT_TRUE(scene.surfaces(1).has_rectangle());
}

TEST(SceneFile, SaysThatABraceIsNotClosed) {
  const TemporaryFolder folder;
  const std::string file = folder.write("scene.txt", "object { mesh { builtin: \"cube\" }\n");
  expect_error(ErrorKind::kInvalidInput,
               {"scene.txt:2:1: the file ends within a { that is not closed"},
               [&] { load_scene(file); });
}

TEST(SceneFile, RepairsMeshesWhereAsked) {
  const TemporaryFolder folder;
  const std::string obj(kObj);
  folder.write("open.obj", obj.substr(0, obj.rfind("f ")));  // without its last face
  const auto load = [&](const std::string& mesh) {
    return load_scene(folder.write("scene.txt", "object { mesh { " + mesh + " } }"));
  };
  expect_error(ErrorKind::kInvalidInput, {"open.obj is not closed", "repair: true"},
               [&] { load("path: \"open.obj\""); });
  set_up_logging();
  ::testing::internal::CaptureStderr();
  const v1::Scene closed = load("path: \"open.obj\" repair: true");
  EXPECT_THAT(::testing::internal::GetCapturedStderr(),
              ::testing::HasSubstr("open.obj is repaired: 1 hole filled (of 3 edges)"));
  EXPECT_EQ(closed.object().mesh().triangles().indices().size(), 4U * 12);
  EXPECT_FALSE(closed.object().mesh().repair());  // a worker need not know
  EXPECT_THROW(load("builtin: \"cube\" repair: true"), Error);
  // In centimetres.
  const v1::Scene large = load("path: \"open.obj\" repair: true unit: CM");
  const auto in_mm = from_bytes<float>(closed.object().mesh().triangles().positions()),
             from_cm = from_bytes<float>(large.object().mesh().triangles().positions());
  ASSERT_EQ(in_mm.size(), from_cm.size());
  for (size_t i = 0; i < in_mm.size(); ++i) EXPECT_EQ(from_cm[i], 10 * in_mm[i]);
  EXPECT_EQ(large.object().mesh().unit(), v1::MM);
  EXPECT_THROW(load("builtin: \"cube\" unit: CM"), Error);
  // What the scene says does not count if the unit is told.
  folder.write("scene.txt",
               "object { mesh { path: \"open.obj\" repair: true unit: M } } "
               "surfaces { mesh { builtin: \"cube\" } }");
  EXPECT_EQ(load_scene(folder.path() / "scene.txt", v1::CM).object().SerializeAsString(),
            large.object().SerializeAsString());
}

TEST(SceneFile, PutsPixelsInThePlaceOfPanoramas) {
  const TemporaryFolder folder;
  Image gray{.width = 2, .height = 1, .channels = {{"Y", {0.5F, 7}}}, .attributes = {}};
  write_exr(folder.path() / "gray.exr", gray);
  Image coloured = gray;
  coloured.channels = {{"R", {1, 2}}, {"G", {3, 4}}, {"B", {5, 6}}, {"A", {9, 9}}};
  write_exr(folder.path() / "coloured.exr", coloured);
  const v1::Scene scene = load_scene(folder.write("scene.txt", R"(
    lights { environment_map { path: "gray.exr" scale: 2 } }
    lights { environment_map { path: "coloured.exr" } }
  )"));
  const auto rgb = [&](int light) {
    const v1::Pixels& pixels = scene.lights(light).environment_map().pixels();
    EXPECT_EQ(pixels.width(), 2U);
    EXPECT_EQ(pixels.height(), 1U);
    std::vector<float> values;
    for (size_t i = 0; i < pixels.rgb().size() / sizeof(float); ++i) {
      values.push_back(element<float>(pixels.rgb(), i));
    }
    return values;
  };
  EXPECT_EQ(rgb(0), (std::vector<float>{0.5F, 0.5F, 0.5F, 7, 7, 7}));
  EXPECT_EQ(rgb(1), (std::vector<float>{1, 3, 5, 2, 4, 6}));
  EXPECT_EQ(scene.lights(0).environment_map().scale(), 2);
}

TEST(SceneFile, PutsPixelsInThePlaceOfImages) {
  const TemporaryFolder folder;
  const std::vector<unsigned char> colours{0, 128, 255, 255, 0, 0};
  write_png(folder.path() / "board.png", 2, 1, colours);
  write_exr(folder.path() / "gray.exr",
            {.width = 1, .height = 1, .channels = {{"Y", {0.25F}}}, .attributes = {}});
  const v1::Scene scene = load_scene(folder.write("scene.txt", R"(
    surfaces { rectangle { } image { path: "board.png" } }
    surfaces { rectangle { } image { path: "gray.exr" scale: 0.5 } }
  )"));
  const v1::Pixels& board = scene.surfaces(0).image().pixels();
  EXPECT_EQ(board.width(), 2U);
  EXPECT_EQ(board.height(), 1U);
  const auto middle = static_cast<float>(linear_of_srgb(128 / 255.0));
  EXPECT_EQ(from_bytes<float>(board.rgb()), (std::vector<float>{0, middle, 1, 1, 0, 0}));
  EXPECT_EQ(from_bytes<float>(scene.surfaces(1).image().pixels().rgb()),
            (std::vector<float>{0.25F, 0.25F, 0.25F}));
}

TEST(SceneFile, ReadsStandardInput) {
  const TemporaryFolder folder;
  const int saved = ::dup(STDIN_FILENO);
  const auto file = folder.write("scene.txt", "film { width: 64 }");
  ASSERT_NE(std::freopen(file.c_str(), "r", stdin), nullptr);
  const v1::Scene scene = load_scene("-");
  ::dup2(saved, STDIN_FILENO);
  ::close(saved);
  EXPECT_EQ(scene.film().width(), 64U);
}

// --- Bad scene files: a row each ---

struct BadScene {
  const char* name;
  const char* text;
  ErrorKind kind;
  std::vector<std::string> message;
};

const std::vector<BadScene> kBadScenes{
    {"unknown_field",
     "film { width: 64 }\ncamera {\n  focus: 3\n}\n",
     ErrorKind::kInvalidInput,
     {"scene.txt:3:", "focus", "itn.v1.Camera"}},
    {"unknown_enum",
     "film { channel: INFRARED }",
     ErrorKind::kInvalidInput,
     {"scene.txt:1:", "INFRARED"}},
    {"wrong_type", "film {\n  width: \"wide\"\n}", ErrorKind::kInvalidInput, {"scene.txt:2:10: "}},
    {"negative_width", "film { width: -1 }", ErrorKind::kInvalidInput, {"scene.txt:1:15: "}},
    {"unclosed", "film { width: 1", ErrorKind::kInvalidInput, {"scene.txt:1:"}},
    {"twice",
     "film { width: 1 }\nfilm { width: 2 }",
     ErrorKind::kInvalidInput,
     {"scene.txt:2:", "film"}},
    {"two_sources",
     "object { mesh { builtin: \"cube\"\n path: \"a.ply\" } }",
     ErrorKind::kInvalidInput,
     {"scene.txt:2:", "path"}},
    {"unknown_shape",
     "object { mesh { builtin: \"teapot\" } }",
     ErrorKind::kInvalidInput,
     {"teapot", "sphere, cube"}},
    {"empty", "", ErrorKind::kInvalidInput, {"scene.txt: the scene file is empty"}},
    {"comments_alone", "# nothing\n", ErrorKind::kInvalidInput, {"the scene file is empty"}},
    {"missing_mesh", "object { mesh { path: \"gone.ply\" } }", ErrorKind::kIo, {"gone.ply"}},
    {"missing_panorama",
     "lights { environment_map { path: \"gone.exr\" } }",
     ErrorKind::kIo,
     {"gone.exr"}},
    {"cut_image",
     "surfaces { rectangle { } image { path: \"cut.png\" } }",
     ErrorKind::kDataLoss,
     {"cut.png: cannot read it"}},
    {"text_for_an_image",
     "surfaces { rectangle { } image { path: \"scene.txt\" } }",
     ErrorKind::kInvalidInput,
     {"scene.txt is no image; images of surfaces are PNG or OpenEXR"}},
    {"panorama_without_colour",
     "lights { environment_map { path: \"depth.exr\" } }",
     ErrorKind::kInvalidInput,
     {"depth.exr has the channels Z, confidence", "R, G and B, or Y"}},
    {"panorama_with_nan",
     "lights { environment_map { path: \"nan.exr\" } }",
     ErrorKind::kInvalidInput,
     {"nan.exr", "channel Y", "x = 1, y = 0"}},
};

// OpenEXR and Radiance HDR; of another shape with a word, below zero with another.
TEST(SceneFile, ReadsPanoramas) {
  const TemporaryFolder folder;
  std::string hdr = "#?RADIANCE\nEXPOSURE=2\n\n-Y 1 +X 2\n";
  for (int i = 0; i < 2; ++i) hdr += {static_cast<char>(64), 0, 0, static_cast<char>(129)};
  folder.write("a.hdr", hdr);
  write_exr(folder.path() / "square.exr",
            {.width = 2, .height = 2, .channels = {{"Y", {-1e-3F, 1, 1, -1}}}, .attributes = {}});
  const auto pixels = [&](const std::string& file) {
    const v1::Scene scene = load_scene(
        folder.write("scene.txt", "lights { environment_map { path: \"" + file + "\" } }"));
    return from_bytes<float>(scene.lights(0).environment_map().pixels().rgb());
  };
  EXPECT_FLOAT_EQ(pixels("a.hdr")[0], 64.5F / 256);
  testing::CapturedLog log;
  EXPECT_EQ(pixels("square.exr")[0], 0);
  EXPECT_EQ(pixels("square.exr")[9], -1) << "refused where the scene is built";
  EXPECT_THAT(log.text(), ::testing::AllOf(::testing::HasSubstr("mirror ball"),
                                           ::testing::HasSubstr("1 values are below 0")));
}

class BadSceneTest : public ::testing::TestWithParam<BadScene> {};

TEST_P(BadSceneTest, IsRefused) {
  const TemporaryFolder folder;
  write_exr(
      folder.path() / "depth.exr",
      {.width = 1, .height = 1, .channels = {{"Z", {1}}, {"confidence", {1}}}, .attributes = {}});
  write_exr(folder.path() / "nan.exr",
            {.width = 2, .height = 1, .channels = {{"Y", {1, NAN}}}, .attributes = {}});
  const std::vector<unsigned char> black(300, 0);
  folder.write("cut.png", encode_png(10, 10, black).substr(0, 50));
  const auto path = folder.write("scene.txt", GetParam().text);
  expect_error(GetParam().kind, GetParam().message, [&] { load_scene(path); });
}

INSTANTIATE_TEST_SUITE_P(Table, BadSceneTest, ::testing::ValuesIn(kBadScenes),
                         [](const auto& row) { return std::string(row.param.name); });

// Before the file of each is read.
TEST(SceneFile, MayNotNameFilesWithoutEnd) {
  const TemporaryFolder folder;
  std::string lights, surfaces;
  for (int i = 0; i <= 64; ++i) lights += "lights { environment_map { path: \"none.exr\" } }\n";
  for (int i = 0; i <= 1024; ++i) surfaces += "surfaces { mesh { path: \"none.ply\" } }\n";
  expect_error(ErrorKind::kInvalidInput, {"the number of lights is 65; it must be in [0, 64]"},
               [&] { load_scene(folder.write("lights", lights)); });
  expect_error(ErrorKind::kInvalidInput,
               {"the number of surfaces is 1025; it must be in [0, 1024]"},
               [&] { load_scene(folder.write("surfaces", surfaces)); });
}

TEST(SceneFile, DoesNotWaitForAFifo) {
  const TemporaryFolder folder;
  ASSERT_EQ(::mkfifo(folder.path("fifo").c_str(), 0600), 0);
  expect_error(ErrorKind::kIo, {"the scene", "fifo", "it is a FIFO"},
               [&] { load_scene(folder.path("fifo")); });
  ASSERT_EQ(::mkfifo(folder.path("env.exr").c_str(), 0600), 0);
  const auto scene = folder.write("s", "lights { environment_map { path: \"env.exr\" } }");
  expect_error(ErrorKind::kIo, {"the image", "env.exr", "it is a FIFO"},
               [&] { load_scene(scene); });
}

TEST(SceneFile, DoesNotReadWithoutEnd) {
  expect_error(ErrorKind::kIo, {"/dev/zero", "it is a device"}, [] { load_scene("/dev/zero"); });
}

// A scene file is the user's own: it may name files anywhere.
TEST(SceneFile, TakesPathsThatLeaveItsFolder) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder.path() / "scenes");
  const auto mesh = folder.write("t.obj", kObj);
  for (const std::string& path : {std::string("../t.obj"), mesh.string()}) {
    const auto scene =
        folder.write("scenes/scene.txt", "object { mesh { path: \"" + path + "\" } }");
    EXPECT_TRUE(load_scene(scene).object().mesh().has_triangles()) << path;
  }
}

TEST(SceneFile, MissingFileIsAnIoError) {
  expect_error(ErrorKind::kIo, {"cannot read the scene", "gone.txt"},
               [] { load_scene("gone.txt"); });
}

// --- Bytes and digests ---

// FIPS 180-4 examples.
TEST(SceneBytes, Sha256) {
  EXPECT_EQ(to_hex(sha256("")), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(to_hex(sha256("abc")),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(SceneBytes, SerializeKeepsTheSceneAndItsDigest) {
  v1::Scene scene;
  scene.mutable_object()->mutable_mesh()->set_builtin("cube");
  scene.mutable_film()->set_width(12);
  const auto serialized = serialize(scene);
  v1::Scene read;
  ASSERT_TRUE(read.ParseFromString(serialized->bytes));
  EXPECT_EQ(read.object().mesh().builtin(), "cube");
  EXPECT_EQ(read.film().width(), 12U);
  EXPECT_EQ(serialized->digest, sha256(serialized->bytes));
  EXPECT_EQ(serialized->bytes, serialize(v1::Scene(scene))->bytes);
  scene.mutable_film()->set_width(13);
  EXPECT_NE(serialized->digest, serialize(scene)->digest);
}

TEST(SceneBytes, ArraysAreLittleEndian) {
  v1::Mesh mesh;
  set_triangles(mesh, {{{1, 0, -2}}, {{0x01020304, 0, 5}}});
  EXPECT_EQ(mesh.triangles().positions(), "\0\0\x80\x3f\0\0\0\0\0\0\0\xc0"s);
  EXPECT_EQ(mesh.triangles().indices(), "\x04\x03\x02\x01\0\0\0\0\x05\0\0\0"s);
}

}  // namespace
}  // namespace itn
