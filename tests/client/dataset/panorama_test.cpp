#include "client/dataset/panorama.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <numeric>
#include <set>

#include "client/dataset/distribution.h"
#include "client/dataset/item_scene.h"
#include "client/dataset/panorama_set.h"
#include "client/image/image.h"
#include "client/render_pool/render_pool.h"
#include "common/random.h"
#include "common/scene/scene_bytes.h"
#include "common/scene/wire_array.h"
#include "tests/client/dataset/dataset_support.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kPi = std::numbers::pi;

// Noise, and a bright spot.
Image image_of(int width, int height, uint64_t seed) {
  Image image;
  image.width = width;
  image.height = height;
  SplitMix random(seed);
  for (const char* channel : {"R", "G", "B"}) {
    std::vector<float>& plane = image.channels[channel];
    for (int i = 0; i < width * height; ++i) plane.push_back(static_cast<float>(random.uniform()));
    plane[random.below(static_cast<uint64_t>(width * height) / 2)] = 50;
  }
  return image;
}

v1::Pixels pixels_of(const Image& image) {
  std::vector<float> rgb;
  for (size_t i = 0; i < image.channels.at("R").size(); ++i) {
    for (const char* channel : {"R", "G", "B"}) rgb.push_back(image.channels.at(channel)[i]);
  }
  v1::Pixels pixels;
  pixels.set_width(static_cast<uint32_t>(image.width));
  pixels.set_height(static_cast<uint32_t>(image.height));
  pixels.set_rgb(to_bytes(rgb));
  return pixels;
}

// Integrated over all directions.
double power_of(const v1::Pixels& pixels) {
  const std::vector<float> rgb = from_bytes<float>(pixels.rgb());
  double sum = 0;
  for (size_t i = 0; i < rgb.size(); ++i) {
    const auto row = static_cast<uint32_t>(i / 3 / pixels.width());
    sum += double{rgb[i]} * panorama_row(row, pixels.width(), pixels.height()).solid_angle;
  }
  return sum / 3;
}

TEST(Panorama, TheSameRadianceFromEverywhereIsPi) {
  const std::vector<float> ones(size_t{3} * 14 * 7, 1);
  const v1::Pixels pixels = panorama_of(14, 7, ones);
  EXPECT_NEAR(irradiance_from_above(pixels), kPi, 1e-6);
  EXPECT_NEAR(power_of(pixels), 4 * kPi, 1e-6);
}

TEST(Panorama, AveragingDownKeepsThePower) {
  for (const auto& [width, height] :
       {std::pair{600, 300}, std::pair{512, 256}, std::pair{258, 129}}) {
    const v1::Pixels all = pixels_of(image_of(width, height, 1));
    const v1::Pixels few = averaged_down(all, 256, 128);
    EXPECT_EQ(few.width(), 256);
    EXPECT_EQ(few.height(), 128);
    EXPECT_NEAR(power_of(few) / power_of(all), 1, 1e-6);
    EXPECT_NEAR(irradiance_from_above(few) / irradiance_from_above(all), 1, 2e-3);
  }
  const v1::Pixels small = pixels_of(image_of(40, 20, 1));
  EXPECT_EQ(averaged_down(small, 256, 128).rgb(), small.rgb());
}

// --- Folders ---

class Panoramas : public ::testing::Test {
 protected:
  void write(const std::string& name, const Image& image) const {
    write_exr(folder_.path(name), image);
  }
  void write_some(int count) const {
    for (int i = 0; i < count; ++i) {
      write("room" + std::to_string(i) + ".exr", image_of(64, 32, static_cast<uint64_t>(i)));
    }
  }

  testing::TemporaryFolder folder_;
};

TEST_F(Panoramas, AreLoadedWithAnIrradianceOfOne) {
  write_some(2);
  Image gray = image_of(64, 32, 9);
  gray.channels = {{"Y", gray.channels.at("R")}};
  write("gray.EXR", gray);
  const PanoramaSet set = load_panorama_set(folder_.path());
  EXPECT_TRUE(set.refused.empty());
  ASSERT_EQ(set.panoramas.size(), 3);
  EXPECT_EQ(set.panoramas[0].name, "gray");
  for (const Panorama& panorama : set.panoramas) {
    v1::Pixels pixels;
    ASSERT_TRUE(pixels.ParseFromString(panorama.to_file()));
    EXPECT_NEAR(irradiance_from_above(pixels), 1, 1e-5);
    EXPECT_EQ(to_hex(sha256(panorama.to_file())), panorama.sha256);
  }
}

TEST_F(Panoramas, ThatCannotBeUsedAreNamed) {
  expect_error(ErrorKind::kInvalidInput, folder_.path().string() + " holds no EXR file",
               [&] { load_panorama_set(folder_.path()); });
  expect_error(ErrorKind::kIo, "cannot read " + folder_.path("gone"),
               [&] { load_panorama_set(folder_.path("gone")); });
  folder_.write("1text.exr", "not an EXR");
  write("2square.exr", image_of(32, 32, 1));
  Image negative = image_of(64, 32, 1);
  negative.channels["G"][64 * 3 + 7] = -1e6F;
  write("3negative.exr", negative);
  Image black = image_of(64, 32, 1);
  for (auto& [name, plane] : black.channels) std::fill_n(plane.begin(), plane.size() / 2, 0.0F);
  write("4black.exr", black);
  expect_error(ErrorKind::kInvalidInput, "no panorama in " + folder_.path().string(),
               [&] { load_panorama_set(folder_.path()); });
  write_some(1);
  const PanoramaSet set = load_panorama_set(folder_.path());
  EXPECT_EQ(set.panoramas.size(), 1);
  EXPECT_THAT(set.refused,
              ElementsAre(HasSubstr("1text.exr"),
                          AllOf(HasSubstr("2square.exr has 32 x 32 pixels"), HasSubstr("twice")),
                          HasSubstr("3negative.exr: pixel (7, 3) is -1000000;"),
                          HasSubstr("4black.exr is black above the horizon")));
}

TEST_F(Panoramas, TheTestSeesNoneOfTheTraining) {
  const auto split_of = [](size_t count) {
    v1::DatasetConfig config = preset_config("outdoor");
    std::vector<Panorama> panoramas;
    for (size_t i = 0; i < count; ++i) panoramas.push_back({std::to_string(i), "", {}});
    return split_panoramas(config, panoramas);
  };
  const NameSplit ten = split_of(10);
  EXPECT_EQ(ten.test.size(), 3);
  EXPECT_EQ(ten.validation.size(), 1);
  EXPECT_EQ(ten.train.size(), 6);
  std::set<std::string> all(ten.train.begin(), ten.train.end());
  all.insert(ten.validation.begin(), ten.validation.end());
  all.insert(ten.test.begin(), ten.test.end());
  EXPECT_EQ(all.size(), 10);
  const NameSplit three = split_of(3);
  EXPECT_EQ(three.test.size() * three.validation.size() * three.train.size(), 1);
  const NameSplit two = split_of(2);
  EXPECT_NE(two.names_or_training(v1::SPLIT_TEST), two.names_or_training(v1::SPLIT_TRAIN));
  EXPECT_EQ(two.names_or_training(v1::SPLIT_VALIDATION), two.names_or_training(v1::SPLIT_TRAIN));
  EXPECT_EQ(split_of(1).names_or_training(v1::SPLIT_TEST),
            split_of(1).names_or_training(v1::SPLIT_TRAIN));
  std::vector<Panorama> twins(2, {"a", "", {}});
  expect_error(ErrorKind::kInvalidInput, "two panoramas are called \"a\"",
               [&] { split_panoramas(preset_config("outdoor"), twins); });
}

// --- Datasets ---

class PanoramaDataset : public DatasetFolder {
 protected:
  PanoramaDataset() {
    for (int i = 0; i < 4; ++i) {
      write_exr(panoramas_.path("room" + std::to_string(i) + ".exr"),
                image_of(64, 32, static_cast<uint64_t>(i)));
    }
    config_ = small_config();
    config_.mutable_lights()->Clear();
    v1::PanoramaChoice& choice = *config_.add_lights()->mutable_panoramas();
    choice.set_folder(panoramas_.path().string());
    *choice.mutable_irradiance() = log_uniform(50, 200);
    set_defaults(config_);
  }

  DatasetPlan planned() const {
    return plan_dataset(config_, few_shapes(), panorama_set(config_).panoramas);
  }

  testing::TemporaryFolder panoramas_;
  v1::DatasetConfig config_;
};

TEST_F(PanoramaDataset, StandsAlone) {
  render(planned());
  const auto whole = files();
  EXPECT_EQ(whole.count("panoramas/room3.map"), 1);
  EXPECT_EQ(render(planned()).kept, 8);  // the same command continues
  for (const auto& entry : fs::directory_iterator(panoramas_.path())) fs::remove(entry);
  DatasetReader reader(folder_);
  EXPECT_EQ(reader.manifest().config().lights(0).panoramas().folder(), "");
  EXPECT_EQ(reader.manifest().panoramas_size(), 4);
  std::map<v1::Split, std::set<std::string>> seen;
  std::set<float> azimuths, irradiances;
  for (const v1::DatasetItem& item : reader.manifest().items()) {
    const v1::Panorama& panorama = item.light().panorama();
    seen[item.split()].insert(panorama.name());
    azimuths.insert(panorama.azimuth_degrees());
    irradiances.insert(panorama.irradiance());
    const v1::Scene scene = [&] {
      v1::Scene parsed;
      parsed.ParseFromString(reader.scene(item)->bytes);
      return parsed;
    }();
    const v1::EnvironmentMap& map = scene.lights(0).environment_map();
    EXPECT_NEAR(irradiance_from_above(map.pixels()) * static_cast<double>(map.scale()),
                panorama.irradiance(), 1e-4 * static_cast<double>(panorama.irradiance()));
    EXPECT_EQ(map.rotate_y_degrees(), panorama.azimuth_degrees());
  }
  for (const std::string& name : seen[v1::SPLIT_TEST]) {
    EXPECT_FALSE(seen[v1::SPLIT_TRAIN].contains(name)) << name;
  }
  EXPECT_EQ(azimuths.size(), 8);
  EXPECT_EQ(irradiances.size(), 8);
  // Images that were lost are rendered again, others added.
  fs::remove(folder_ / "images" / "000002.exr");
  EXPECT_EQ(render({reader.manifest(), {}}).kept, 7);
  EXPECT_EQ(files(), whole);
  EXPECT_EQ(render(extended(reader.manifest(), 11)).kept, 8);
}

TEST_F(PanoramaDataset, OfOtherPanoramasIsAnother) {
  render(planned());
  write_exr(panoramas_.path("room2.exr"), image_of(64, 32, 77));
  expect_error(ErrorKind::kInvalidInput, "panoramas[2].sha256", [&] { render(planned()); });
}

TEST_F(PanoramaDataset, NamesAPanoramaThatIsDamaged) {
  render(planned());
  DatasetReader reader(folder_);
  const v1::DatasetItem& item = reader.manifest().items(0);
  const fs::path file = folder_ / "panoramas" / (item.light().panorama().name() + ".map");
  std::ofstream(file, std::ios::app) << "more";
  expect_error(ErrorKind::kDataLoss, file.string() + " is not the panorama",
               [&] { reader.scene(item); });
  render(planned());
  EXPECT_NO_THROW(reader.scene(item));
}

// A panorama that is turned lights what stands still as one that stands still lights what is turned
// the other way, with the camera.
TEST_F(PanoramaDataset, TurningTheLightIsTurningTheRestTheOtherWay) {
  const PanoramaSet set = panorama_set(config_);
  v1::Pixels pixels;
  ASSERT_TRUE(pixels.ParseFromString(set.panoramas[0].to_file()));
  v1::DatasetItem item = planned().manifest.items(0);
  item.clear_ground_reflectance();
  item.clear_rotation();
  constexpr double kDegrees = 70;
  v1::Mesh mesh;
  set_triangles(mesh, make_shape("figure"));
  item.mutable_light()->mutable_panorama()->set_azimuth_degrees(kDegrees);
  const v1::Scene turned_light = scene_of(item, mesh.triangles(), 32, &pixels);
  item.mutable_light()->mutable_panorama()->set_azimuth_degrees(0);
  const v1::Scene still = scene_of(item, mesh.triangles(), 32, &pixels);
  v1::Scene turned_rest = still;
  v1::Rotation& back =
      *turned_rest.mutable_object()->mutable_mesh()->add_transforms()->mutable_rotate();
  back.mutable_axis()->set_y(1);
  back.set_angle_degrees(-kDegrees);
  const double c = std::cos(kDegrees * kPi / 180), s = std::sin(kDegrees * kPi / 180);
  for (v1::Vec3* point : {turned_rest.mutable_camera()->mutable_origin(),
                          turned_rest.mutable_camera()->mutable_target()}) {
    const double x = point->x(), z = point->z();
    point->set_x(static_cast<float>(c * x - s * z));
    point->set_z(static_cast<float>(s * x + c * z));
  }
  RenderPool pool({});
  struct Sums {
    double radiance = 0, variance = 0;
  };
  const auto sums_of = [&](const v1::Scene& scene, uint64_t seed) {
    item.set_seed(seed);
    const v1::RenderGradReply reply = pool.submit(render_job(serialize(scene), item, 256)).get();
    // The left half of the image alone: light from the side makes it another than the whole.
    const auto radiance = from_bytes<float>(reply.estimates(0).radiance());
    const auto error = from_bytes<float>(reply.standard_error());
    Sums sums;
    for (size_t p = 0; p < radiance.size(); ++p) {
      if (p % 32 >= 16) continue;
      sums.radiance += double{radiance[p]};
      sums.variance += std::pow(double{error[p]}, 2);
    }
    return sums;
  };
  const Sums a = sums_of(turned_light, 1), b = sums_of(turned_rest, 2), other = sums_of(still, 3);
  const double noise = std::sqrt(a.variance + b.variance);
  EXPECT_NEAR(a.radiance, b.radiance, 4 * noise);
  EXPECT_GT(std::abs(other.radiance - a.radiance), 8 * noise) << "too noisy, or alike, to tell";
}

}  // namespace
}  // namespace itn
