#include "client/dataset/dataset.h"

#include <sys/stat.h>
#include <time.h>

#include <cmath>
#include <fstream>
#include <numeric>
#include <set>
#include <sstream>

#include <gmock/gmock.h>

#include "client/dataset/dataset_render.h"
#include "common/error.h"
#include "common/files/folder_lock.h"
#include "common/geometry/shapes.h"
#include "common/image/image.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

std::vector<Shape> few_shapes() {
  std::vector<Shape> shapes;
  for (const ShapeInfo& info : builtin_shapes().first(5)) {
    shapes.push_back(
        describe_shape(std::string(info.name), [name = info.name] { return make_shape(name); }));
  }
  return shapes;
}

v1::DatasetConfig small_config() {
  v1::DatasetConfig config = paper_config(16);
  config.set_spp(2);
  config.set_count(8);
  config.set_seed(3);
  return config;
}

void expect_error(ErrorKind kind, const std::string& message, const std::function<void()>& action) {
  try {
    action();
    ADD_FAILURE() << "no error; expected: " << message;
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind);
    EXPECT_THAT(error.what(), HasSubstr(message));
  }
}

// --- The plan ---

TEST(DatasetPlan, SplitsShareNoShapeAndNoIllumination) {
  v1::DatasetConfig config = small_config();
  config.set_count(200);
  const v1::Dataset manifest = plan_dataset(config, few_shapes()).manifest;
  std::set<std::string> shapes[2];
  std::set<float> azimuths[2];
  for (const v1::DatasetItem& item : manifest.items()) {
    const size_t split = item.split() == v1::SPLIT_TEST ? 1 : 0;
    shapes[split].insert(item.shape());
    azimuths[split].insert(item.sun_azimuth_degrees());
  }
  EXPECT_EQ(shapes[0].size() + shapes[1].size(), 5);
  EXPECT_EQ(azimuths[0].size(), 4);
  EXPECT_EQ(azimuths[1].size(), 6);
  for (const std::string& shape : shapes[1]) {
    EXPECT_FALSE(shapes[0].contains(shape));
  }
  for (const float azimuth : azimuths[1]) {
    EXPECT_FALSE(azimuths[0].contains(azimuth));
  }
}

TEST(DatasetPlan, CountsAndSeeds) {
  v1::DatasetConfig config = small_config();
  config.set_count(40);
  config.set_rotate(true);
  const v1::Dataset manifest = plan_dataset(config, few_shapes()).manifest;
  std::set<uint64_t> seeds;
  std::set<float> rotations;
  int test = 0;
  for (const v1::DatasetItem& item : manifest.items()) {
    seeds.insert(item.seed());
    rotations.insert(item.rotate_y_degrees());
    test += item.split() == v1::SPLIT_TEST ? 1 : 0;
  }
  EXPECT_EQ(manifest.items_size(), 40);
  EXPECT_EQ(test, 10);
  EXPECT_EQ(seeds.size(), 40);
  EXPECT_EQ(rotations.size(), 40);
}

TEST(DatasetPlan, StratifiedMaterialsFillEveryStratumOnce) {
  v1::DatasetConfig config = small_config();
  config.set_count(80);
  const v1::Dataset manifest = plan_dataset(config, few_shapes()).manifest;
  std::set<int> sigma_t, albedo, g;
  for (const v1::DatasetItem& item : manifest.items()) {
    if (item.split() == v1::SPLIT_TRAIN) {
      const auto stratum = [](double value, double min, double max) {
        return static_cast<int>(60 * (value - min) / (max - min));
      };
      sigma_t.insert(stratum(std::log(item.material().sigma_t()), std::log(30), std::log(276)));
      albedo.insert(stratum(item.material().albedo(), 0.39, 0.95));
      g.insert(stratum(item.material().g(), 0, 0.8));
    }
  }
  EXPECT_EQ(sigma_t.size(), 60);
  EXPECT_EQ(albedo.size(), 60);
  EXPECT_EQ(g.size(), 60);
}

TEST(DatasetPlan, GridIsThePapers) {
  v1::DatasetConfig config = small_config();
  config.set_sampling(v1::DatasetConfig::GRID);
  config.set_count(0);
  const std::vector<std::string> test{few_shapes()[0].name};
  const v1::Dataset manifest = plan_dataset(config, few_shapes(), test).manifest;
  // 300 materials; 4 shapes x 4 azimuths to train, 1 x 6 to test.
  EXPECT_EQ(manifest.items_size(), 300 * (4 * 4 + 1 * 6));
}

TEST(DatasetPlan, IsAFunctionOfItsConfiguration) {
  const v1::DatasetConfig config = small_config();
  const std::string once = to_text(plan_dataset(config, few_shapes()).manifest);
  EXPECT_EQ(to_text(plan_dataset(config, few_shapes()).manifest), once);
  v1::DatasetConfig other = config;
  other.set_seed(4);
  EXPECT_NE(to_text(plan_dataset(other, few_shapes()).manifest), once);
}

TEST(DatasetPlan, SaysWhatIsWrong) {
  struct Row {
    const char* message;
    std::function<void(v1::DatasetConfig&, std::vector<Shape>&, std::vector<std::string>&)> spoil;
  };
  const Row rows[] = {
      {"sun azimuth 390 is in both splits",
       [](auto& config, auto&, auto&) { config.set_test_azimuths_degrees(0, 390); }},
      {"test fraction is 1", [](auto& config, auto&, auto&) { config.set_test_fraction(1); }},
      {"range of albedo is [0.39, 1.2]",
       [](auto& config, auto&, auto&) {
         config.mutable_materials()->mutable_albedo()->set_max(1.2);
       }},
      {"range of g is [0.8, 0]; its minimum must not exceed its maximum",
       [](auto& config, auto&, auto&) {
         config.mutable_materials()->mutable_g()->set_min(0.8);
         config.mutable_materials()->mutable_g()->set_max(0);
       }},
      {"leave one split without an image", [](auto& config, auto&, auto&) { config.set_count(1); }},
      {"spp must be 1", [](auto& config, auto&, auto&) { config.set_spp(0); }},
      {"there are 1 shapes", [](auto&, auto& shapes, auto&) { shapes.resize(1); }},
      {"two shapes are called",
       [](auto&, auto& shapes, auto&) { shapes[1].name = shapes[0].name; }},
      {"no shape \"teapot\"", [](auto&, auto&, auto& test) { test = {"teapot"}; }},
      {"no shape is left to train with",
       [](auto&, auto& shapes, auto& test) {
         for (const Shape& shape : shapes) {
           test.push_back(shape.name);
         }
       }},
  };
  for (const Row& row : rows) {
    v1::DatasetConfig config = small_config();
    std::vector<Shape> shapes = few_shapes();
    std::vector<std::string> test;
    row.spoil(config, shapes, test);
    expect_error(ErrorKind::kInvalidInput, row.message,
                 [&] { plan_dataset(config, shapes, test); });
  }
}

// --- On disk ---

class DatasetFolder : public testing::Test {
 protected:
  DatasetFolder() { fs::remove_all(folder_); }
  ~DatasetFolder() override { fs::remove_all(folder_); }

  DatasetProgress render(const DatasetPlan& plan, size_t stop_after = SIZE_MAX) const {
    RenderPool pool({});
    std::stop_source stop;
    return render_dataset(
        plan, folder_, pool,
        [&](const DatasetProgress& p) {
          if (p.done - p.kept >= stop_after) {
            stop.request_stop();
          }
        },
        stop.get_token());
  }

  std::map<std::string, std::string> files() const {
    std::map<std::string, std::string> result;
    for (const auto& entry : fs::recursive_directory_iterator(folder_)) {
      if (entry.is_regular_file()) {
        std::ostringstream content;
        content << std::ifstream(entry.path(), std::ios::binary).rdbuf();
        result[fs::relative(entry.path(), folder_)] = content.str();
      }
    }
    return result;
  }

  fs::path folder_ =
      fs::path(testing::TempDir()) /
      (std::string("dataset-") + testing::UnitTest::GetInstance()->current_test_info()->name());
  DatasetPlan plan_ = plan_dataset(small_config(), few_shapes());
};

TEST_F(DatasetFolder, ReadsBackWithTruthAndScene) {
  EXPECT_EQ(render(plan_).done, 8);
  DatasetReader reader(folder_);
  EXPECT_EQ(to_text(reader.manifest()), to_text(plan_.manifest));
  EXPECT_EQ(reader.items(v1::SPLIT_TRAIN).size(), 6);
  const v1::DatasetItem& item = *reader.items(v1::SPLIT_TEST)[0];
  const DatasetImage image = reader.image(item);
  EXPECT_EQ(image.radiance.size(), 256);
  EXPECT_GT(*std::ranges::max_element(image.mask), 0.5F);
  const Image file = read_exr(folder_ / item.file());
  EXPECT_EQ(file.attributes.at("itn.sigma_t"), Attribute(item.material().sigma_t()));
  EXPECT_EQ(file.attributes.at("itn.shape"), Attribute(item.shape()));
  EXPECT_EQ(file.attributes.at("itn.spp"), Attribute(2));
  // The scene renders to the same image.
  RenderPool pool({});
  RenderJob job{reader.scene(item), {}};
  *job.request.mutable_material() = item.material();
  job.request.set_spp(2);
  job.request.set_seed(item.seed());
  job.request.set_pixels(v1::OBJECT_PIXELS);
  const v1::RenderGradReply reply = pool.submit(job).get();
  std::vector<float> again(256);
  std::memcpy(again.data(), reply.estimates(0).radiance().data(), 1024);
  EXPECT_EQ(again, image.radiance);
}

TEST_F(DatasetFolder, ContinuesWhereItWasStopped) {
  render(plan_);
  const auto whole = files();
  fs::remove_all(folder_);
  expect_error(ErrorKind::kCancelled, "interrupted", [&] { render(plan_, 3); });
  // As if it had been killed while it wrote a file.
  std::ofstream(folder_ / "images" / "000004.exr.1.tmp") << "half";
  const DatasetProgress progress = render(plan_);
  EXPECT_EQ(progress.kept, 3);
  EXPECT_EQ(progress.done, 8);
  EXPECT_EQ(files(), whole);
  EXPECT_EQ(render(plan_).kept, 8);
}

// Materials of a grid that differ in the albedo alone come from one walk, whichever is missing.
TEST_F(DatasetFolder, AlbedosOfAGridShareTheirWalk) {
  v1::DatasetConfig config = small_config();
  config.set_sampling(v1::DatasetConfig::GRID);
  config.set_count(0);
  config.set_rotate(false);
  for (auto* grid :
       {config.mutable_grid_sigma_t(), config.mutable_grid_albedo(), config.mutable_grid_g()}) {
    grid->Clear();
  }
  config.add_grid_sigma_t(60);
  config.add_grid_g(0.2);
  for (const double albedo : {0.4, 0.95, 0.8}) config.add_grid_albedo(albedo);
  std::vector<Shape> shapes = few_shapes();
  shapes.resize(2);
  const std::vector<std::string> test{shapes[0].name};
  const DatasetPlan plan = plan_dataset(config, shapes, test);
  const DatasetProgress progress = render(plan);
  EXPECT_EQ(progress.done, static_cast<size_t>(plan.manifest.items_size()));
  // Object pixels times spp, once for three images.
  EXPECT_LT(progress.paths, uint64_t{256} * config.spp() * progress.done / 3);
  const auto whole = files();
  DatasetReader reader(folder_);
  const auto mean = [&](const v1::DatasetItem& item) {
    const DatasetImage image = reader.image(item);
    return std::accumulate(image.radiance.begin(), image.radiance.end(), 0.0);
  };
  const auto& items = plan.manifest.items();
  EXPECT_LT(mean(items[0]), mean(items[2]));
  EXPECT_LT(mean(items[2]), mean(items[1]));
  fs::remove(folder_ / items[2].file());
  EXPECT_EQ(render(plan).kept, progress.done - 1);
  EXPECT_EQ(files(), whole);
}

TEST_F(DatasetFolder, RendersADamagedImageAgain) {
  render(plan_);
  const auto whole = files();
  std::ofstream(folder_ / "images" / "000002.exr", std::ios::trunc) << "not an EXR";
  fs::copy_file(folder_ / "images" / "000001.exr", folder_ / "images" / "000003.exr",
                fs::copy_options::overwrite_existing);
  EXPECT_EQ(render(plan_).kept, 6);
  EXPECT_EQ(files(), whole);
}

TEST_F(DatasetFolder, RefusesAnotherConfiguration) {
  render(plan_);
  v1::DatasetConfig other = small_config();
  other.set_spp(3);
  expect_error(ErrorKind::kInvalidInput, "spp: 2 -> 3",
               [&] { render(plan_dataset(other, few_shapes())); });
}

TEST_F(DatasetFolder, RefusesAFolderOfSomethingElse) {
  fs::create_directories(folder_);
  std::ofstream(folder_ / "thesis.tex") << "precious";
  expect_error(ErrorKind::kInvalidInput, "not empty", [&] { render(plan_); });
}

TEST_F(DatasetFolder, SaysWhatIsWrongWithWhatItReads) {
  render(plan_);
  const auto item = [](const DatasetReader& reader) -> const v1::DatasetItem& {
    return reader.manifest().items(0);
  };
  {  // An image of another item.
    DatasetReader reader(folder_);
    fs::copy_file(folder_ / "images" / "000001.exr", folder_ / "images" / "000000.exr",
                  fs::copy_options::overwrite_existing);
    expect_error(ErrorKind::kInvalidInput, "not the image that the manifest describes",
                 [&] { reader.image(item(reader)); });
    fs::remove(folder_ / "images" / "000000.exr");
    expect_error(ErrorKind::kIo, "not complete", [&] { reader.image(item(reader)); });
  }
  {  // A shape that was changed.
    DatasetReader reader(folder_);
    for (const v1::DatasetShape& shape : reader.manifest().shapes()) {
      std::ofstream(folder_ / shape.file(), std::ios::app) << "x";
    }
    expect_error(ErrorKind::kDataLoss, "is not the shape", [&] { reader.scene(item(reader)); });
  }
  std::ofstream(folder_ / kManifestName, std::ios::app) << "\nflavour: 7\n";
  expect_error(ErrorKind::kInvalidInput, "flavour", [&] { DatasetReader reader(folder_); });
  fs::remove(folder_ / kManifestName);
  expect_error(ErrorKind::kIo, "cannot read", [&] { DatasetReader reader(folder_); });
}

// A manifest from a stranger names files; they stay in the folder.
TEST_F(DatasetFolder, ReadsAndWritesNothingOutsideOfItself) {
  render(plan_);
  const fs::path outside = fs::path(testing::TempDir()) / "outside-of-the-dataset";
  for (const char* name :
       {"/etc/hostname", "../outside.exr", "images/../../outside.exr", "", "."}) {
    v1::Dataset manifest = plan_.manifest;
    manifest.mutable_items(0)->set_file(name);
    std::ofstream(folder_ / kManifestName, std::ios::trunc) << to_text(manifest);
    expect_error(ErrorKind::kInvalidInput, "is not a file in the folder of the dataset",
                 [&] { DatasetReader reader(folder_); });
    manifest = plan_.manifest;
    manifest.mutable_shapes(0)->set_file(name);
    std::ofstream(folder_ / kManifestName, std::ios::trunc) << to_text(manifest);
    expect_error(ErrorKind::kInvalidInput, "is not a file in the folder of the dataset",
                 [&] { DatasetReader reader(folder_); });
  }
  std::ofstream(folder_ / kManifestName, std::ios::trunc) << to_text(plan_.manifest);
  const v1::DatasetItem& item = plan_.manifest.items(0);
  const fs::path image = folder_ / item.file();
  {  // By a link.
    fs::rename(image, outside);
    fs::create_symlink(outside, image);
    const auto before = fs::last_write_time(outside);
    DatasetReader reader(folder_);
    expect_error(ErrorKind::kInvalidInput, "not a regular file in the folder",
                 [&] { reader.image(reader.manifest().items(0)); });
    expect_error(ErrorKind::kInvalidInput, "not a regular file in the folder",
                 [&] { render(plan_); });
    EXPECT_EQ(fs::last_write_time(outside), before);
    fs::remove(image);
    fs::remove(outside);
  }
  ASSERT_EQ(mkfifo(image.c_str(), 0600), 0);  // to open it would wait for a writer
  DatasetReader reader(folder_);
  expect_error(ErrorKind::kInvalidInput, "not a regular file",
               [&] { reader.image(reader.manifest().items(0)); });
}

TEST_F(DatasetFolder, ContinuesFromItsManifestAlone) {
  render(plan_);
  const auto whole = files();
  fs::remove(folder_ / plan_.manifest.items(3).file());
  EXPECT_EQ(render({read_manifest(folder_ / kManifestName), {}}).kept, 7);
  EXPECT_EQ(files(), whole);
}

TEST_F(DatasetFolder, IsRenderedByOneProcessAtATime) {
  render(plan_);
  std::ofstream(folder_ / "images" / "000004.exr.1.tmp") << "of the other process";
  const FolderLock lock(folder_, "another test");
  expect_error(ErrorKind::kIo, "is in use by process", [&] { render(plan_); });
  EXPECT_TRUE(fs::exists(folder_ / "images" / "000004.exr.1.tmp"));
}

// Meshes are in memory while they are needed, not for as long as the dataset is open.
TEST_F(DatasetFolder, LoadsEachMeshWhenItIsNeeded) {
  std::map<std::string, int> loads;
  std::vector<Shape> shapes;
  for (const ShapeInfo& info : builtin_shapes().first(5)) {
    shapes.push_back(describe_shape(std::string(info.name), [&loads, name = info.name] {
      ++loads[std::string(name)];
      return make_shape(name);
    }));
  }
  const DatasetPlan plan = plan_dataset(small_config(), shapes);
  for (const auto& [name, count] : loads) EXPECT_EQ(count, 1) << name;
  render(plan);
  for (const auto& [name, count] : loads) EXPECT_EQ(count, 2) << name;  // for its file
  render(plan);
  for (const auto& [name, count] : loads) EXPECT_EQ(count, 2) << name;
}

// --- Shapes ---

double thread_cpu_seconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// Those built in are few and small: they are kept as they were written, not built again.
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
  EXPECT_EQ(set.shapes[0].height, 1);
  EXPECT_THAT(set.refused, testing::ElementsAre(HasSubstr("open.obj")));
  const ShapeSet repaired = load_shape_set(folder_, true);  // a triangle alone bounds nothing
  EXPECT_EQ(repaired.shapes.size(), 1);
  EXPECT_THAT(repaired.refused, testing::ElementsAre(HasSubstr("cannot be repaired")));
  std::ofstream(folder_ / "open.obj") << std::string(tetrahedron).substr(0, 56);
  EXPECT_EQ(load_shape_set(folder_).shapes.size(), 1);
  EXPECT_EQ(load_shape_set(folder_, true).shapes.size(), 2);
  fs::remove(folder_ / "good.obj");
  expect_error(ErrorKind::kInvalidInput, "can be used", [&] { load_shape_set(folder_); });
  fs::remove(folder_ / "open.obj");
  expect_error(ErrorKind::kInvalidInput, "holds no PLY", [&] { load_shape_set(folder_); });
  expect_error(ErrorKind::kIo, "cannot read", [&] { load_shape_set(folder_ / "none"); });
}

}  // namespace
}  // namespace itn
