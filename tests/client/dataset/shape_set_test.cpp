#include "client/dataset/shape_set.h"

#include <time.h>

#include <fstream>

#include "common/scene/scene_bytes.h"
#include "tests/client/dataset/dataset_support.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

double thread_cpu_seconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// The built-in shapes are few and small: they are kept as they were written, not built again.
TEST(BuiltinShapeSet, IsBuiltOnce) {
  const double start = thread_cpu_seconds();
  const ShapeSet set = builtin_shape_set();
  const double described = thread_cpu_seconds();
  size_t bytes = 0;
  for (const Shape& shape : set.shapes) {
    const std::string file = shape.to_file();
    EXPECT_EQ(to_hex(sha256(file)), shape.sha256) << shape.name;
    bytes += file.size();
  }
  EXPECT_EQ(set.shapes.size(), builtin_shapes().size());
  EXPECT_LT(bytes, size_t{32} << 20);
  EXPECT_LT(thread_cpu_seconds() - described, 0.5 * (described - start));
}

// Which of the folders of a config it is that cannot be read.
TEST(ShapeSource, IsNamedWhenItsFolderCannotBeRead) {
  v1::ShapeSource source;
  source.mutable_folder()->set_path("/nowhere");
  expect_error(ErrorKind::kIo, "shapes.folder: cannot read /nowhere: No such file",
               [&] { shape_set(source); });
}

TEST(RandomShapeSet, IsTheBeginningOfALargerOneAndBuiltWhenItIsAskedFor) {
  const double start = thread_cpu_seconds();
  const ShapeSet many = random_shape_set(1000, 5);
  EXPECT_LT(thread_cpu_seconds() - start, 0.2);  // one takes about 0.05
  const ShapeSet few = random_shape_set(3, 5);
  for (const Shape& shape : few.shapes) {
    const auto same = std::ranges::find(many.shapes, shape.name, &Shape::name);
    ASSERT_NE(same, many.shapes.end()) << shape.name;
    EXPECT_EQ(same->to_file(), shape.to_file());
  }
  EXPECT_NE(few.shapes[0].to_file(), few.shapes[1].to_file());
}

TEST_F(DatasetFolder, IsOfRandomShapesThatTheManifestKnowsByTheirFiles) {
  v1::DatasetConfig config = preset_config("outdoor");
  config.set_resolution(16);
  config.clear_noise();
  config.set_spp(2);
  config.set_count(12);
  config.mutable_shapes()->mutable_random()->set_count(6);
  render(plan_dataset(config, shape_set(config.shapes()).shapes));
  const auto whole = files();
  const v1::Dataset manifest = read_manifest(folder_ / kManifestName);
  for (const v1::DatasetShape& shape : manifest.shapes()) {
    EXPECT_EQ(shape.sha256(), to_hex(sha256(whole.at(shape.file()))));
  }
  config.set_count(15);
  EXPECT_EQ(render(plan_dataset(config, shape_set(config.shapes()).shapes)).kept, 12);
}

TEST_F(DatasetFolder, LoadsWhatItCanOfAFolderOfMeshes) {
  fs::create_directories(folder_);
  const char* tetrahedron =
      "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
  std::ofstream(folder_ / "good.obj") << tetrahedron;
  std::ofstream(folder_ / "open.obj") << "v 0 0 0\nv 2 0 0\nv 0 2 0\nf 1 3 2\n";
  std::ofstream(folder_ / "notes.txt") << "not a mesh";
  const ShapeSet set = load_shape_set(folder_);
  ASSERT_EQ(set.shapes.size(), 1);
  EXPECT_EQ(set.shapes[0].name, "good");
  EXPECT_THAT(set.refused, ::testing::ElementsAre(HasSubstr("open.obj")));
  const ShapeSet repaired = load_shape_set(folder_, true);  // a triangle alone bounds nothing
  EXPECT_EQ(repaired.shapes.size(), 1);
  EXPECT_THAT(repaired.refused, ::testing::ElementsAre(HasSubstr("cannot be repaired")));
  std::ofstream(folder_ / "open.obj") << std::string(tetrahedron).substr(0, 56);
  EXPECT_EQ(load_shape_set(folder_).shapes.size(), 1);
  EXPECT_EQ(load_shape_set(folder_, true).shapes.size(), 2);
  // Mirrored and larger, so that its triangles turn round.
  std::ofstream(folder_ / "mirrored.obj")
      << "v 0 0 0\nv -3 0 0\nv 0 3 0\nv 0 0 3\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";
  EXPECT_THAT(load_shape_set(folder_).alike,
              ::testing::ElementsAre(AllOf(HasSubstr("mirrored.obj"), HasSubstr("shape of good"))));
  fs::remove(folder_ / "mirrored.obj");
  fs::remove(folder_ / "good.obj");
  expect_error(ErrorKind::kInvalidInput, "can be used", [&] { load_shape_set(folder_); });
  fs::remove(folder_ / "open.obj");
  expect_error(ErrorKind::kInvalidInput, "holds no PLY", [&] { load_shape_set(folder_); });
  expect_error(ErrorKind::kIo, "cannot read", [&] { load_shape_set(folder_ / "none"); });
}

}  // namespace
}  // namespace itn
