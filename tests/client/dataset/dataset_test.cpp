#include "client/dataset/dataset.h"

#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <numeric>
#include <set>
#include <sstream>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "client/dataset/distribution.h"
#include "client/dataset/noise.h"
#include "client/files/folder_lock.h"
#include "client/image/attributes.h"
#include "client/image/image.h"
#include "client/render_pool/render_pool.h"
#include "common/scene/wire_array.h"
#include "tests/client/dataset/dataset_support.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

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
  EXPECT_EQ(image.spp, 2);
  EXPECT_EQ(image.standard_error, file.channel("stderr.Y"));
  EXPECT_EQ(image.relative_noise,
            relative_noise(image.radiance, file.channel("stderr.Y"), image.mask));
  EXPECT_GT(image.relative_noise, 0.02);
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

TEST_F(DatasetFolder, HoldsDerivativeImagesOfTwoHalvesOfTheSamples) {
  v1::DatasetConfig config = small_config();
  config.set_spp(5);  // three and two
  config.set_derivatives(true);
  render(plan_dataset(config, few_shapes()));
  DatasetReader reader(folder_);
  const v1::DatasetItem& item = *reader.items(v1::SPLIT_TEST)[0];
  RenderPool pool({});
  RenderJob job = render_job(reader.scene(item), item, 5);
  job.request.set_estimates(2);
  for (const v1::Parameter p : {v1::SIGMA_T, v1::ALBEDO, v1::G}) job.request.add_derivatives(p);
  const v1::RenderGradReply reply = pool.submit(job).get();
  const DerivativeImages derivatives = reader.derivatives(item);
  for (int k = 0; k < 2; ++k) {
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(derivatives.at(static_cast<size_t>(k)).at(static_cast<size_t>(i)),
                from_bytes<float>(reply.estimates(k).derivatives(i)));
    }
  }
  // The image is the mean of all samples.
  const DatasetImage image = reader.image(item);
  const auto three = from_bytes<float>(reply.estimates(0).radiance());
  const auto two = from_bytes<float>(reply.estimates(1).radiance());
  for (size_t p = 0; p < three.size(); ++p) {
    ASSERT_NEAR(image.radiance[p], (3 * three[p] + 2 * two[p]) / 5, 1e-5F * image.radiance[p]);
  }
}

// One render for three colours, or one for each: both show what renders of single colours show.
TEST_F(DatasetFolder, ShowsMediaInColour) {
  v1::DatasetConfig config = small_config();
  config.set_count(16);
  config.clear_spp();
  config.mutable_noise()->set_target(0.08);
  v1::MaterialChoice& materials = *config.mutable_materials();
  *materials.mutable_albedo() = uniform(0.9, 0.98);
  *materials.mutable_g() = uniform(0, 0.8);
  auto& ratios = *materials.mutable_colours()->mutable_scattering()->mutable_one_of();
  for (const double ratio : {1.1, 5.0}) ratios.add_value(ratio);
  materials.mutable_colours()->set_gray(0);
  config.mutable_ground()->set_coloured(0.5);
  *config.mutable_ground()->mutable_reflectance() = uniform(0, 0.9);
  set_defaults(config);
  render(plan_dataset(config, few_shapes()));
  DatasetReader reader(folder_);
  RenderPool pool({});
  std::map<std::pair<size_t, bool>, int> renders;  // how many, and whether the ground is coloured
  std::vector<double> z;
  for (const v1::DatasetItem& item : reader.manifest().items()) {
    ++renders[{ItemRenders(reader, item).count(), item.has_ground_color()}];
    const std::vector<DatasetImage> channels = reader.channels(item);
    ASSERT_EQ(channels.size(), 3);
    for (size_t c = 0; c < channels.size(); ++c) {
      const auto colour = static_cast<v1::Film::Channel>(v1::Film::RED + c);
      v1::DatasetItem one = item;
      *one.mutable_material() = item.colours(static_cast<int>(c));
      one.clear_colours();
      one.set_seed(item.seed() + 1 + c);
      const v1::RenderGradReply reply =
          pool.submit(render_job(reader.scene(item, colour), one, 128)).get();
      const auto again = from_bytes<float>(reply.estimates(0).radiance());
      const auto error = from_bytes<float>(reply.standard_error());
      double difference = 0, variance = 0;
      for (size_t p = 0; p < again.size(); ++p) {
        difference += channels[c].radiance[p] - again[p];
        variance += std::pow(channels[c].standard_error[p], 2) + std::pow(error[p], 2);
      }
      z.push_back(difference / std::sqrt(variance));
    }
    EXPECT_GT(channels[0].relative_noise, 0.01);
    EXPECT_LT(channels[0].relative_noise, 0.12);
    EXPECT_NE(channels[0].radiance, channels[2].radiance);
    expect_error(ErrorKind::kInvalidInput, "is in colour", [&] { reader.image(item); });
  }
  // Both ways have been gone.
  for (const bool coloured : {false, true}) {
    EXPECT_GE((renders[{1, coloured}]), 1);
    EXPECT_GE((renders[{3, coloured}]), 1);
  }
  // The standard error is an upper bound. 4.1: once in 24,000 for a normal number.
  for (const double one : z) EXPECT_LT(std::abs(one), 4.1);
}

TEST_F(DatasetFolder, WithoutDerivativeImagesSaysHowToHaveThem) {
  render(plan_);
  DatasetReader reader(folder_);
  expect_error(ErrorKind::kInvalidInput, "itn dataset --derivatives",
               [&] { reader.derivatives(*reader.items(v1::SPLIT_TEST)[0]); });
}

TEST_F(DatasetFolder, ContinuesWhereItWasStopped) {
  render(plan_);
  const auto whole = files();
  fs::remove_all(folder_);
  expect_error(ErrorKind::kCancelled, "interrupted", [&] { render(plan_, 3); });
  // The folder looks as if it had been killed while it wrote a file.
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
  config.mutable_materials()->set_sampling(v1::MaterialChoice::GRID);
  config.set_count(0);
  *config.mutable_materials()->mutable_sigma_t() = fixed(60);
  *config.mutable_materials()->mutable_g() = fixed(0.2);
  auto& albedos = *config.mutable_materials()->mutable_albedo()->mutable_one_of();
  for (const double albedo : {0.4, 0.95, 0.8}) albedos.add_value(albedo);
  std::vector<Shape> shapes = few_shapes();
  shapes.resize(2);
  config.add_test_shapes(shapes[0].name);
  const DatasetPlan plan = plan_dataset(config, shapes);
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

TEST_F(DatasetFolder, IsGivenMoreImagesAndKeepsItsOwn) {
  render(plan_);
  const auto before = files();
  // From its folder alone, and planned anew.
  EXPECT_EQ(render(extended(read_manifest(folder_ / kManifestName), 11)).kept, 8);
  v1::DatasetConfig more = small_config();
  more.set_count(13);
  const DatasetProgress progress = render(plan_dataset(more, few_shapes()));
  EXPECT_EQ(progress.kept, 11);
  EXPECT_EQ(progress.done, 13);
  const auto after = files();
  for (const auto& [name, content] : before) {
    if (name != kManifestName) {
      EXPECT_EQ(after.at(name), content) << name;
    }
  }
  fs::remove_all(folder_);
  render(plan_dataset(more, few_shapes()));
  EXPECT_EQ(files(), after);  // as if it had been so large from the beginning
  expect_error(ErrorKind::kInvalidInput, "holds 13 images, and 8 are asked for",
               [&] { render(plan_); });
  EXPECT_EQ(files(), after);
}

TEST_F(DatasetFolder, ImagesOfANoiseTargetAreAsNoisyAsItSays) {
  v1::DatasetConfig config = small_config();
  config.set_resolution(32);
  config.clear_spp();
  config.mutable_noise()->set_target(0.04);
  set_defaults(config);
  config.set_count(24);
  render(plan_dataset(config, few_shapes()));
  DatasetReader reader(folder_);
  std::set<uint32_t> spp;
  for (const v1::DatasetItem& item : reader.manifest().items()) {
    const DatasetImage image = reader.image(item);
    spp.insert(image.spp);
    EXPECT_NEAR(std::log(image.relative_noise / 0.04), 0, 0.25) << item.file();
  }
  EXPECT_GT(spp.size(), 12);
  EXPECT_GT(*spp.rbegin(), 2 * *spp.begin());
  // A render of the item by what its header says is the same.
  const v1::DatasetItem& item = reader.manifest().items(0);
  const DatasetImage image = reader.image(item);
  RenderPool pool({});
  const auto reply = pool.submit(render_job(reader.scene(item), item, image.spp)).get();
  EXPECT_EQ(from_bytes<float>(reply.estimates(0).radiance()), image.radiance);
}

// The noise that the header of an image says is 0 or more; of nothing but noise it is infinite.
TEST_F(DatasetFolder, ReadsTheNoiseThatThereCanBe) {
  render(plan_);
  const DatasetReader reader(folder_);
  const v1::DatasetItem& item = reader.manifest().items(0);
  const auto say = [&](double noise) {
    Image image = read_exr(folder_ / item.file());
    image.attributes[attribute::kRelativeNoise] = noise;
    image.attributes[attribute::kContents] = contents_digest(image);
    write_exr(folder_ / item.file(), image);
  };
  for (const double noise : {0.0, 0.1, HUGE_VAL}) {
    say(noise);
    EXPECT_EQ(reader.image(item).relative_noise, noise);
  }
  for (const double noise : {-0.1, static_cast<double>(NAN)}) {
    say(noise);
    expect_error(ErrorKind::kInvalidInput, "it must be >= 0", [&] { reader.image(item); });
  }
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
  std::string text = files()[kManifestName] + "\nflavour: 7\n";
  std::ofstream(folder_ / kManifestName) << text;
  expect_error(ErrorKind::kDataLoss, "checksum of its first line",
               [&] { DatasetReader reader(folder_); });
  text.erase(0, text.find('\n') + 1);  // as by somebody who changed it
  std::ofstream(folder_ / kManifestName) << text;
  expect_error(ErrorKind::kInvalidInput, "flavour", [&] { DatasetReader reader(folder_); });
  fs::remove(folder_ / kManifestName);
  expect_error(ErrorKind::kIo, "cannot read", [&] { DatasetReader reader(folder_); });
}

// All that a dataset says, as text.
std::string contents(const std::filesystem::path& folder) {
  DatasetReader reader(folder);
  std::string all = reader.manifest().SerializeAsString();
  for (const v1::DatasetItem& item : reader.manifest().items()) {
    const DatasetImage image = reader.image(item);
    for (const auto& plane : {image.radiance, image.mask, image.standard_error}) {
      all += to_bytes(plane);
    }
    all += fmt::format(" {} {} ", image.relative_noise, image.spp) + reader.scene(item)->digest;
  }
  return all;
}

// Each of its files cut short at every length, and with each of its bytes changed: an error that
// names the file, or the same contents.
class DamagedDataset : public DatasetFolder {
 protected:
  DamagedDataset() {
    v1::DatasetConfig config = small_config();
    config.set_count(2);
    config.set_test_fraction(0.5);
    plan_ = plan_dataset(config, few_shapes());
    render(plan_);
    whole_ = contents(folder_);
  }

  // Damages every `stride`-th place.
  void damage(const std::string& name, size_t stride) const {
    const std::string bytes = files().at(name);
    for (size_t at = 0; at < bytes.size(); at += stride) {
      expect_error_or_the_same(name, bytes.substr(0, at), fmt::format("cut at {}", at));
      for (const int flip : {0x01, 0x10, 0xff}) {
        std::string damaged = bytes;
        damaged[at] = static_cast<char>(damaged[at] ^ flip);
        expect_error_or_the_same(name, damaged, fmt::format("byte {} ^ {}", at, flip));
      }
      if (HasFailure()) return;
    }
    std::printf("  %s: %d files were refused, %d said the same\n", name.c_str(), refused_, same_);
    EXPECT_GT(refused_, same_);
    EXPECT_GT(damaged_, refused_ / 2);
  }

 private:
  void expect_error_or_the_same(const std::string& name, const std::string& bytes,
                                const std::string& what) const {
    std::ofstream(folder_ / name, std::ios::binary | std::ios::trunc) << bytes;
    try {
      EXPECT_TRUE(contents(folder_) == whole_) << name << ", " << what << ": other contents";
      ++same_;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(name)) << what;
      EXPECT_TRUE(error.kind() == ErrorKind::kDataLoss || error.kind() == ErrorKind::kInvalidInput)
          << what << ": " << error.what();
      ++refused_;
      if (error.kind() == ErrorKind::kDataLoss) ++damaged_;
    }
  }

  std::string whole_;
  mutable int same_ = 0, refused_ = 0, damaged_ = 0;
};

TEST_F(DamagedDataset, ByItsManifest) {
  damage(kManifestName, 3);
}

TEST_F(DamagedDataset, ByAnImage) {
  damage(plan_.manifest.items(0).file(), 3);
}

TEST_F(DamagedDataset, ByAShape) {
  const auto shape = std::ranges::find(plan_.manifest.shapes(), plan_.manifest.items(0).shape(),
                                       &v1::DatasetShape::name);
  damage(shape->file(), 211);
}

// A manifest from a stranger names files; they stay in the folder.
TEST_F(DatasetFolder, ReadsAndWritesNothingOutsideOfItself) {
  render(plan_);
  const fs::path outside = fs::path(::testing::TempDir()) / "outside-of-the-dataset";
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

TEST_F(DatasetFolder, RefusesAResolutionThatNoDatasetHas) {
  render(plan_);
  for (const uint32_t resolution : {0U, 17U, 1U << 31, ~0U}) {
    v1::Dataset manifest = plan_.manifest;
    manifest.mutable_config()->set_resolution(resolution);
    std::ofstream(folder_ / kManifestName, std::ios::trunc) << to_text(manifest);
    expect_error(ErrorKind::kInvalidInput,
                 fmt::format("{}: the resolution is {}", kManifestName, resolution),
                 [&] { DatasetReader reader(folder_); });
  }
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
    Shape& shape =
        shapes.emplace_back(describe_shape(std::string(info.name), make_shape(info.name)));
    shape.to_file = [&loads, name = shape.name, to_file = shape.to_file] {
      ++loads[name];
      return to_file();
    };
  }
  const DatasetPlan plan = plan_dataset(small_config(), shapes);
  EXPECT_TRUE(loads.empty());
  render(plan);
  render(plan);
  EXPECT_EQ(loads.size(), 5U);
  for (const auto& [name, count] : loads) EXPECT_EQ(count, 1) << name;  // for its file
}

}  // namespace
}  // namespace itn
