#include "client/dataset/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>
#include <numeric>
#include <set>

#include "client/dataset/dataset.h"
#include "client/dataset/distribution.h"
#include "client/dataset/item_scene.h"
#include "client/scene/text_proto.h"
#include "common/scene/material_proto.h"
#include "common/vec.h"
#include "server/scene_compiler/scene_builder.h"
#include "server/tracer/lights/sun_sky_irradiance.h"
#include "tests/client/dataset/dataset_support.h"

namespace itn {
namespace {

std::vector<Shape> nameless(size_t count) {
  std::vector<Shape> shapes;
  for (size_t i = 0; i < count; ++i) shapes.push_back({fmt::format("shape{:05}", i), "0", {}});
  return shapes;
}

std::vector<v1::DatasetItem> items_of(const v1::Dataset& manifest, v1::Split split) {
  std::vector<v1::DatasetItem> items;
  std::ranges::copy_if(manifest.items(), std::back_inserter(items),
                       [&](const v1::DatasetItem& item) { return item.split() == split; });
  return items;
}

float azimuth_of(const v1::DatasetItem& item) {
  return item.light().sun_sky().sun_azimuth_degrees();
}

// --- Splits ---

TEST(DatasetPlan, SplitsShareNoShapeAndNoIllumination) {
  v1::DatasetConfig config = small_config();
  config.set_count(200);
  config.set_validation_fraction(0.2);
  const v1::Dataset manifest = plan_dataset(config, nameless(10)).manifest;
  std::map<v1::Split, std::set<std::string>> shapes;
  std::map<v1::Split, std::set<float>> azimuths;
  for (const v1::DatasetItem& item : manifest.items()) {
    shapes[item.split()].insert(item.shape());
    azimuths[item.split()].insert(azimuth_of(item));
  }
  EXPECT_EQ(shapes[v1::SPLIT_TRAIN].size(), 5);
  EXPECT_EQ(shapes[v1::SPLIT_VALIDATION].size(), 2);
  EXPECT_EQ(shapes[v1::SPLIT_TEST].size(), 3);  // a quarter of ten, rounded
  std::set<std::string> all;
  for (const auto& [split, names] : shapes) all.insert(names.begin(), names.end());
  EXPECT_EQ(all.size(), 10);
  EXPECT_EQ(azimuths[v1::SPLIT_TRAIN], (std::set<float>{0, 30, 60, 90}));
  EXPECT_EQ(azimuths[v1::SPLIT_VALIDATION], azimuths[v1::SPLIT_TRAIN]);
  EXPECT_EQ(azimuths[v1::SPLIT_TEST], (std::set<float>{10, 20, 40, 50, 70, 80}));
  EXPECT_EQ(items_of(manifest, v1::SPLIT_TEST).size(), 50);
  EXPECT_EQ(items_of(manifest, v1::SPLIT_VALIDATION).size(), 40);
}

TEST(DatasetPlan, EverySplitHasItsShareOfEveryBeginning) {
  v1::DatasetConfig config = small_config();
  config.set_validation_fraction(0.1);
  const NameSplit shapes = split_shapes(config, nameless(20));
  std::map<v1::Split, int> counts;
  for (int i = 0; i < 1000; ++i) {
    ++counts[plan_item(config, shapes, static_cast<uint64_t>(i)).split()];
    EXPECT_NEAR(counts[v1::SPLIT_TEST], 0.25 * (i + 1), 1);
    EXPECT_NEAR(counts[v1::SPLIT_VALIDATION], 0.1 * (i + 1), 1.1);
  }
}

TEST(DatasetPlan, FewShapesAreOneForEachSplitAtLeast) {
  v1::DatasetConfig config = small_config();
  config.set_validation_fraction(0.01);
  config.set_test_fraction(0.9);
  const NameSplit three = split_shapes(config, nameless(3));
  EXPECT_EQ(three.train.size(), 1);
  EXPECT_EQ(three.validation.size(), 1);
  EXPECT_EQ(three.test.size(), 1);
  expect_error(ErrorKind::kInvalidInput, "with --validation-fraction 0 two are enough",
               [&] { split_shapes(config, nameless(2)); });
  config.set_validation_fraction(0);
  EXPECT_EQ(split_shapes(config, nameless(2)).test.size(), 1);
  config.add_test_shapes("shape00001");
  config.add_validation_shapes("shape00002");
  const NameSplit named = split_shapes(config, nameless(4));
  EXPECT_THAT(named.test, ::testing::ElementsAre("shape00001"));
  EXPECT_THAT(named.validation, ::testing::ElementsAre("shape00002"));
  EXPECT_THAT(named.train, ::testing::ElementsAre("shape00000", "shape00003"));
}

// --- Choices ---

// The square sum of a table of counts about what independence says, as a standard normal number:
// of about (rows - 1)(columns - 1) degrees of freedom, which are many or expected to be met by
// Wilson and Hilferty's cube root.
double chi_square_z(const std::vector<std::vector<double>>& table) {
  std::vector<double> rows(table.size()), columns(table[0].size());
  double total = 0;
  for (size_t i = 0; i < rows.size(); ++i) {
    for (size_t j = 0; j < columns.size(); ++j) {
      rows[i] += table[i][j];
      columns[j] += table[i][j];
      total += table[i][j];
    }
  }
  double sum = 0;
  for (size_t i = 0; i < rows.size(); ++i) {
    for (size_t j = 0; j < columns.size(); ++j) {
      const double expected = rows[i] * columns[j] / total;
      EXPECT_GT(expected, 0) << "row " << i << " or column " << j << " never happens";
      sum += std::pow(table[i][j] - expected, 2) / expected;
    }
  }
  const double freedom = static_cast<double>((rows.size() - 1) * (columns.size() - 1));
  const double variance = 2 / (9 * freedom);
  return (std::cbrt(sum / freedom) - (1 - variance)) / std::sqrt(variance);
}

using Numbers = std::map<std::string, std::function<double(const v1::DatasetItem&)>>;

// Everything that is drawn outdoors.
const Numbers& outdoor_numbers() {
  static const Numbers kNumbers = {
      {"shape", [](const auto& i) { return std::stod(i.shape().substr(5)); }},
      {"sigma_t", [](const auto& i) { return i.material().sigma_t(); }},
      {"albedo", [](const auto& i) { return i.material().albedo(); }},
      {"g", [](const auto& i) { return i.material().g(); }},
      {"rotation", [](const auto& i) { return i.rotation().angle_degrees(); }},
      {"pitch", [](const auto& i) { return i.camera().pitch_degrees(); }},
      {"distance", [](const auto& i) { return i.camera().distance(); }},
      {"size", [](const auto& i) { return i.camera().object_size(); }},
      {"x", [](const auto& i) { return i.camera().offset_x(); }},
      {"y", [](const auto& i) { return i.camera().offset_y(); }},
      {"azimuth", azimuth_of},
      {"elevation", [](const auto& i) { return i.light().sun_sky().sun_elevation_degrees(); }},
      {"turbidity", [](const auto& i) { return i.light().sun_sky().turbidity(); }},
      {"sun", [](const auto& i) { return i.light().sun_sky().sun_angular_radius_degrees(); }},
      {"reflectance", [](const auto& i) { return i.ground_reflectance(); }},
  };
  return kNumbers;
}

// Numbers of a thing with a surface, on squares, by a lamp.
const Numbers& glossy_numbers() {
  static const Numbers kNumbers = {
      {"shape", [](const auto& i) { return std::stod(i.shape().substr(5)); }},
      {"albedo", [](const auto& i) { return i.material().albedo(); }},
      {"pitch", [](const auto& i) { return i.camera().pitch_degrees(); }},
      {"index", [](const auto& i) { return i.boundary().index(); }},
      {"roughness", [](const auto& i) { return i.boundary().roughness(); }},
      {"even", [](const auto& i) { return i.ground_checkerboard().even(); }},
      {"odd", [](const auto& i) { return i.ground_checkerboard().odd(); }},
      {"square",
       [](const auto& i) {
         const v1::Vec3& edge = i.ground_checkerboard().edge_u();
         return std::hypot(edge.x(), edge.z());
       }},
      {"turn",
       [](const auto& i) {
         const v1::Vec3& edge = i.ground_checkerboard().edge_u();
         return std::atan2(edge.z(), edge.x());
       }},
      {"irradiance", [](const auto& i) { return i.light().lamp().irradiance(); }},
      {"lamp distance", [](const auto& i) { return i.light().lamp().distance(); }},
      {"azimuth", [](const auto& i) { return i.light().lamp().azimuth_degrees(); }},
      {"elevation", [](const auto& i) { return i.light().lamp().elevation_degrees(); }},
      {"ambient", [](const auto& i) { return i.light().lamp().ambient(); }},
  };
  return kNumbers;
}

// Numbers of a studio with two soft boxes.
const Numbers& studio_numbers() {
  static const Numbers kNumbers = [] {
    Numbers numbers = {
        {"shape", [](const auto& i) { return std::stod(i.shape().substr(5)); }},
        {"sigma_t", [](const auto& i) { return i.material().sigma_t(); }},
        {"pitch", [](const auto& i) { return i.camera().pitch_degrees(); }},
        {"irradiance", [](const auto& i) { return i.light().studio().irradiance(); }},
        {"walls", [](const auto& i) { return i.light().studio().walls(); }},
    };
    for (const int e : {0, 1}) {
      const auto add = [&](const std::string& name, float (v1::Emitter::*number)() const) {
        numbers[name + std::to_string(e)] = [=](const v1::DatasetItem& item) {
          return (item.light().studio().emitters(e).*number)();
        };
      };
      add("azimuth", &v1::Emitter::azimuth_degrees);
      add("elevation", &v1::Emitter::elevation_degrees);
      add("size", &v1::Emitter::size_degrees);
      add("aspect", &v1::Emitter::aspect);
      add("roll", &v1::Emitter::roll_degrees);
      add("edge", &v1::Emitter::edge);
      add("strength", &v1::Emitter::strength);
    }
    return numbers;
  }();
  return kNumbers;
}

// Each number as that of its rank among `bins` equally likely ones.
std::map<std::string, std::vector<size_t>> binned(const std::vector<v1::DatasetItem>& items,
                                                  size_t bins,
                                                  const Numbers& numbers = outdoor_numbers()) {
  std::map<std::string, std::vector<size_t>> result;
  for (const auto& [name, value] : numbers) {
    std::vector<double> values;
    for (const v1::DatasetItem& item : items) values.push_back(value(item));
    std::vector<double> sorted = values;
    std::ranges::sort(sorted);
    for (const double v : values) {
      const auto rank = std::ranges::lower_bound(sorted, v) - sorted.begin();
      result[name].push_back(static_cast<size_t>(rank) * bins / values.size());
    }
  }
  return result;
}

v1::DatasetConfig training_alone(const char* preset) {
  v1::DatasetConfig config = preset_config(preset);
  config.set_test_fraction(0);
  config.set_validation_fraction(0);
  config.mutable_pose()->Clear();
  config.mutable_pose()->set_turned(1);
  config.mutable_ground()->set_probability(1);
  return config;
}

// Not a power of two, not from the beginning.
std::vector<v1::DatasetItem> items_of(const v1::DatasetConfig& config) {
  const NameSplit shapes = split_shapes(config, nameless(64));
  std::vector<v1::DatasetItem> items;
  for (uint64_t i = 1000; i < 7000; ++i) items.push_back(plan_item(config, shapes, i));
  return items;
}

void expect_independent(const std::vector<v1::DatasetItem>& items, const Numbers& numbers) {
  const auto bins = binned(items, 8, numbers);
  size_t pairs = 0;
  for (const auto& [name, bin] : bins) {
    for (const auto& [other, other_bin] : bins) {
      if (!(name < other)) continue;
      std::vector table(8, std::vector<double>(8));
      for (size_t i = 0; i < items.size(); ++i) ++table[bin[i]][other_bin[i]];
      EXPECT_LT(chi_square_z(table), 4.5) << name << " and " << other;
      ++pairs;
    }
  }
  EXPECT_EQ(pairs, numbers.size() * (numbers.size() - 1) / 2);
}

// Taking shapes and azimuths in turn once gave 600 shapes the first 8 of 36 azimuths.
TEST(DatasetPlan, EveryAzimuthComesAboutEquallyOftenWithEveryShapeAndMaterial) {
  v1::DatasetConfig config = training_alone("outdoor");
  v1::SunSkyChoice& sun = *config.mutable_lights(0)->mutable_sun_sky();
  sun.mutable_azimuth_degrees()->mutable_one_of();
  for (int i = 0; i < 36; ++i) sun.mutable_azimuth_degrees()->mutable_one_of()->add_value(10 * i);
  const NameSplit shapes = split_shapes(config, nameless(600));
  std::vector<v1::DatasetItem> items;
  for (uint64_t i = 0; i < 4800; ++i) items.push_back(plan_item(config, shapes, i));
  std::map<float, int> azimuths;
  std::map<std::string, int> shape_counts;
  std::vector table(36, std::vector<double>(600));
  for (const v1::DatasetItem& item : items) {
    ++azimuths[azimuth_of(item)];
    ++shape_counts[item.shape()];
    ++table[static_cast<size_t>(azimuth_of(item) / 10)][std::stoul(item.shape().substr(5))];
  }
  ASSERT_EQ(azimuths.size(), 36);
  for (const auto& [azimuth, count] : azimuths) EXPECT_NEAR(count, 4800 / 36., 1) << azimuth;
  for (const auto& [shape, count] : shape_counts) EXPECT_EQ(count, 8) << shape;
  EXPECT_NEAR(chi_square_z(table), 0, 4);
  const auto bins = binned(items, 6);
  for (const auto& [name, bin] : bins) {
    if (name == "azimuth") continue;
    std::vector with(36, std::vector<double>(6));
    for (size_t i = 0; i < items.size(); ++i) {
      ++with[static_cast<size_t>(azimuth_of(items[i]) / 10)][bin[i]];
    }
    EXPECT_LT(chi_square_z(with), 4) << name;
  }
}

TEST(DatasetPlan, EveryChoiceIsIndependentOfEveryOther) {
  const v1::DatasetConfig config = training_alone("outdoor");
  expect_independent(items_of(config), outdoor_numbers());
}

TEST(DatasetPlan, EveryChoiceOfSurfaceLampAndCheckerboardIsIndependentOfEveryOther) {
  v1::DatasetConfig config = training_alone("glossy");
  config.clear_lights();
  v1::LampChoice& lamp = *config.add_lights()->mutable_lamp();
  *lamp.mutable_irradiance() = uniform(10, 100);
  *lamp.mutable_ambient() = uniform(0, 1);
  config.mutable_ground()->set_probability(1);
  config.mutable_ground()->set_checkered(1);
  set_defaults(config);
  expect_independent(items_of(config), glossy_numbers());
}

TEST(DatasetPlan, EveryChoiceOfAMottledGroundIsIndependentOfEveryOther) {
  v1::DatasetConfig config = training_alone("glossy");
  config.mutable_ground()->set_probability(1);
  config.mutable_ground()->set_checkered(0);
  config.mutable_ground()->set_mottled(1);
  set_defaults(config);
  expect_independent(
      items_of(config),
      {{"shape", [](const auto& i) { return std::stod(i.shape().substr(5)); }},
       {"pitch", [](const auto& i) { return i.camera().pitch_degrees(); }},
       {"seed", [](const auto& i) { return static_cast<double>(i.ground_texture().seed()); }},
       {"one end", [](const auto& i) { return i.ground_texture().reflectance(); }},
       {"the other", [](const auto& i) { return i.ground_texture().other_reflectance(); }},
       {"size", [](const auto& i) { return i.ground_texture().image_size(); }},
       {"turn", [](const auto& i) { return i.ground_texture().turn_degrees(); }},
       {"persistence", [](const auto& i) { return i.ground_texture().persistence(); }}});
}

// A surface that all have, or a pattern of some grounds, changes nothing else that is drawn.
TEST(DatasetPlan, SurfacesAndPatternsAreDrawnBesideTheRest) {
  const v1::DatasetConfig plain = training_alone("outdoor");
  v1::DatasetConfig config = plain;
  config.mutable_boundary()->set_probability(0.75);
  config.mutable_ground()->set_checkered(0.25);
  config.mutable_ground()->set_mottled(0.25);
  config.mutable_ground()->set_coloured(0.25);
  set_defaults(config);
  const NameSplit shapes = split_shapes(config, nameless(3));
  int boundaries = 0, grounds = 0, checkered = 0, textured = 0, coloured = 0;
  for (uint64_t i = 0; i < 6400; ++i) {
    v1::DatasetItem item = plan_item(config, shapes, i);
    boundaries += item.has_boundary() ? 1 : 0;
    EXPECT_EQ(item.smooth_angle_degrees(), item.has_boundary() ? 30 : 0);
    item.clear_boundary();
    item.clear_smooth_angle_degrees();
    if (item.has_ground_checkerboard()) {
      ++checkered;
      item.set_ground_reflectance(item.ground_checkerboard().even());
      item.clear_ground_checkerboard();
    }
    if (item.has_ground_texture()) {
      ++textured;
      item.set_ground_reflectance(item.ground_texture().reflectance());
      item.clear_ground_texture();
    }
    if (item.has_ground_color()) {
      ++coloured;
      item.set_ground_reflectance(item.ground_color().green());
      item.clear_ground_color();
    }
    grounds += item.has_ground_reflectance() ? 1 : 0;
    EXPECT_EQ(item.SerializeAsString(), plan_item(plain, shapes, i).SerializeAsString()) << i;
  }
  EXPECT_EQ(boundaries, 4800);
  EXPECT_NEAR(checkered, 0.25 * grounds, 4 * std::sqrt(0.1875 * grounds));
  EXPECT_NEAR(textured, 0.25 * grounds, 4 * std::sqrt(0.1875 * grounds));
  EXPECT_NEAR(coloured, 0.125 * grounds, 4 * std::sqrt(0.11 * grounds));
}

TEST(DatasetPlan, EveryColourOfAGroundIsIndependentOfEveryOther) {
  v1::DatasetConfig config = training_alone("outdoor");
  config.mutable_ground()->set_coloured(1);
  expect_independent(items_of(config),
                     {{"shape", [](const auto& i) { return std::stod(i.shape().substr(5)); }},
                      {"pitch", [](const auto& i) { return i.camera().pitch_degrees(); }},
                      {"red", [](const auto& i) { return i.ground_color().red(); }},
                      {"green", [](const auto& i) { return i.ground_color().green(); }},
                      {"blue", [](const auto& i) { return i.ground_color().blue(); }}});
}

// Views of an object show it, and everything else anew.
TEST(DatasetPlan, ViewsShareTheObjectAlone) {
  v1::DatasetConfig config = preset_config("real");
  config.set_views(4);
  validate(config);
  const NameSplit shapes = split_shapes(config, nameless(50));
  std::vector<v1::DatasetItem> items;
  for (uint64_t i = 0; i < 400; ++i) items.push_back(plan_item(config, shapes, i));
  std::set<std::string> objects;
  std::set<float> pitches;
  for (size_t i = 0; i < items.size(); ++i) {
    const auto object_of = [](const v1::DatasetItem& item) {
      v1::DatasetItem object;
      object.set_split(item.split());
      object.set_shape(item.shape());
      *object.mutable_colours() = item.colours();
      *object.mutable_boundary() = item.boundary();
      return object.SerializeAsString();
    };
    EXPECT_EQ(object_of(items[i]), object_of(items[i / 4 * 4]));
    objects.insert(object_of(items[i]));
    pitches.insert(items[i].camera().pitch_degrees());
  }
  EXPECT_EQ(objects.size(), 100);
  EXPECT_EQ(pitches.size(), 400);
  // One view is what there is without a word of it.
  config.set_views(1);
  const v1::DatasetItem one = plan_item(config, shapes, 7);
  config.clear_views();
  EXPECT_EQ(plan_item(config, shapes, 7).SerializeAsString(), one.SerializeAsString());
  expect_error(ErrorKind::kInvalidInput, {"of 2 objects, with a test fraction of 0.1, 0 are"}, [&] {
    config.set_views(4);
    config.set_count(8);
    plan_dataset(config, nameless(50));
  });
}

// Temperatures are drawn by themselves, and change nothing else of what is drawn.
TEST(DatasetPlan, EveryTemperatureIsIndependentOfEveryOther) {
  const auto items = [](const std::string& lights) {
    v1::DatasetConfig config;
    parse_text_proto("materials { colours {} } " + lights, "lights", config);
    set_defaults(config);
    config.set_test_fraction(0);
    config.set_validation_fraction(0);
    validate(config);
    return items_of(config);
  };
  const auto lamps = items(
      "lights { lamp { ambient { uniform { max: 1 } } temperature { uniform { min: 2700 max: 6500 "
      "} }"
      " ambient_temperature { log_uniform { min: 2700 max: 10000 } } } }");
  expect_independent(
      lamps, {{"distance", [](const auto& i) { return i.light().lamp().distance(); }},
              {"ambient", [](const auto& i) { return i.light().lamp().ambient(); }},
              {"lamp", [](const auto& i) { return i.light().lamp().temperature(); }},
              {"room", [](const auto& i) { return i.light().lamp().ambient_temperature(); }}});
  const auto gray = items("lights { lamp { ambient { uniform { max: 1 } } } }");
  const std::string two =
      "lights { studio { emitters { fixed: 2 } walls_temperature { uniform { min: 3000 max: 9000 } "
      "}"
      " emitter { temperature { log_uniform { min: 2700 max: 9000 } } } } }";
  expect_independent(
      items(two),
      {{"walls", [](const auto& i) { return i.light().studio().walls(); }},
       {"of walls", [](const auto& i) { return i.light().studio().walls_temperature(); }},
       {"strength", [](const auto& i) { return i.light().studio().emitters(0).strength(); }},
       {"first", [](const auto& i) { return i.light().studio().emitters(0).temperature(); }},
       {"second", [](const auto& i) { return i.light().studio().emitters(1).temperature(); }}});
  for (size_t i = 0; i < 100; ++i) {
    v1::DatasetItem item = lamps[i];
    item.mutable_light()->mutable_lamp()->clear_temperature();
    item.mutable_light()->mutable_lamp()->clear_ambient_temperature();
    EXPECT_EQ(item.SerializeAsString(), gray[i].SerializeAsString());
  }
}

TEST(DatasetPlan, EveryChoiceOfAStudioIsIndependentOfEveryOther) {
  v1::DatasetConfig config = training_alone("studio");
  v1::StudioChoice& studio = *config.mutable_lights(0)->mutable_studio();
  *studio.mutable_emitters() = fixed(2);
  *studio.mutable_irradiance() = uniform(10, 100);
  studio.mutable_emitter()->set_lamps(0);
  expect_independent(items_of(config), studio_numbers());
}

TEST(DatasetPlan, AStudioHasAnyNumberOfEmittersOfAnyKind) {
  const v1::DatasetConfig config = training_alone("studio");
  const NameSplit shapes = split_shapes(config, nameless(3));
  std::map<int, int> counts;
  int emitters = 0, lamps = 0;
  for (uint64_t i = 0; i < 5000; ++i) {
    const v1::Studio studio = plan_item(config, shapes, i).light().studio();
    ++counts[studio.emitters_size()];
    emitters += studio.emitters_size();
    lamps += static_cast<int>(std::ranges::count_if(studio.emitters(), &v1::Emitter::is_lamp));
  }
  ASSERT_EQ(counts.size(), 5);
  for (const auto& [count, images] : counts) EXPECT_EQ(images, 1000) << count;
  EXPECT_NEAR(lamps, 0.4 * emitters, 4 * std::sqrt(0.24 * emitters));
}

TEST(DatasetPlan, LightsComeAsOftenAsTheyWeigh) {
  const v1::DatasetConfig config = training_alone("any");
  const NameSplit shapes = split_shapes(config, nameless(3));
  std::map<v1::ItemLight::KindCase, int> counts;
  for (uint64_t i = 0; i < 5000; ++i) ++counts[plan_item(config, shapes, i).light().kind_case()];
  EXPECT_NEAR(counts[v1::ItemLight::kSunSky], 2000, 40);
  EXPECT_NEAR(counts[v1::ItemLight::kStudio], 2000, 40);
  EXPECT_NEAR(counts[v1::ItemLight::kFlash], 1000, 40);
}

// Sun and sky are brought to an irradiance, and nothing else is another for it.
TEST(DatasetPlan, SunAndSkyAreAsBrightAsAsked) {
  const v1::DatasetConfig config = training_alone("outdoor");
  const NameSplit shapes = split_shapes(config, nameless(3));
  v1::DatasetConfig known = config;
  *known.mutable_lights(0)->mutable_sun_sky()->mutable_irradiance() = log_uniform(50, 200);
  double sum = 0;
  constexpr uint64_t kItems = 128;
  for (uint64_t i = 0; i < kItems; ++i) {
    v1::DatasetItem item = plan_item(known, shapes, i);
    v1::SunSky& sun = *item.mutable_light()->mutable_sun_sky();
    v1::Light light;
    *light.mutable_sun_sky() = sun;
    const double irradiance = tracer::irradiance_from_above(
        std::get<tracer::SunSkyLight>(build_light("light", light)), tracer::Channel::kLuminance);
    EXPECT_GE(irradiance, 50 * (1 - 1e-6));
    EXPECT_LE(irradiance, 200 * (1 + 1e-6));
    EXPECT_EQ(sun.sun_scale(), sun.sky_scale());
    sum += std::log(irradiance / 100);
    sun.clear_sun_scale();
    sun.clear_sky_scale();
    EXPECT_EQ(item.SerializeAsString(), plan_item(config, shapes, i).SerializeAsString()) << i;
  }
  // Two stretches with one in each 64th of the range.
  EXPECT_NEAR(sum / kItems, 0, 0.01);
}

// Lamps that have a size do not stand in the picture, and the others are where they were.
TEST(DatasetPlan, LampsOfASizeAreDrawnOutOfThePicture) {
  v1::DatasetConfig config = training_alone("outdoor");
  config.clear_lights();
  config.add_lights()->mutable_lamp();
  set_defaults(config);
  const NameSplit shapes = split_shapes(config, nameless(3));
  v1::DatasetConfig of_a_size = config;
  *of_a_size.mutable_lights(0)->mutable_lamp()->mutable_radius() = uniform(0.05, 0.2);
  int moved = 0;
  for (uint64_t i = 0; i < 1000; ++i) {
    const v1::DatasetItem before = plan_item(config, shapes, i);
    v1::DatasetItem item = plan_item(of_a_size, shapes, i);
    const float radius = item.light().lamp().radius();
    EXPECT_TRUE(radius >= 0.05F && radius <= 0.2F) << radius;
    EXPECT_FALSE(may_be_seen(item.light().lamp(), item.camera())) << i;
    item.mutable_light()->mutable_lamp()->clear_radius();
    if (item.SerializeAsString() != before.SerializeAsString()) {
      ++moved;
      *item.mutable_light() = before.light();
      EXPECT_EQ(item.SerializeAsString(), before.SerializeAsString()) << i;
    }
  }
  EXPECT_TRUE(moved > 10 && moved < 200) << moved;
  v1::LampChoice& lamp = *of_a_size.mutable_lights(0)->mutable_lamp();
  *of_a_size.mutable_camera()->mutable_pitch_degrees() = fixed(20);
  *lamp.mutable_elevation_degrees() = fixed(20);
  *lamp.mutable_azimuth_degrees() = fixed(0);
  *lamp.mutable_distance() = fixed(2);
  expect_error(ErrorKind::kInvalidInput, "lights[0].lamp stands in the picture, 100 times of 100",
               [&] { plan_item(of_a_size, shapes, 0); });
}

// An image of one colour is a choice of its own: it changes how bright the sun is, so that its
// colour is as bright as asked, and nothing else.
TEST(DatasetPlan, ColoursAreAsOftenAndAsBrightAsAsked) {
  v1::DatasetConfig config = training_alone("outdoor");
  *config.mutable_lights(0)->mutable_sun_sky()->mutable_irradiance() = fixed(100);
  const NameSplit shapes = split_shapes(config, nameless(3));
  v1::DatasetConfig coloured = config;
  coloured.set_coloured(0.75);
  std::map<v1::Film::Channel, int> counts;
  for (uint64_t i = 0; i < 1600; ++i) {
    v1::DatasetItem item = plan_item(coloured, shapes, i);
    ++counts[item.channel()];
    v1::Light light;
    *light.mutable_sun_sky() = item.light().sun_sky();
    const double irradiance = tracer::irradiance_from_above(
        std::get<tracer::SunSkyLight>(build_light("light", light)), build_channel(item.channel()));
    EXPECT_NEAR(irradiance, 100, 1e-4);
    item.clear_channel();
    v1::DatasetItem before = plan_item(config, shapes, i);
    for (v1::DatasetItem* one : {&item, &before}) {
      one->mutable_light()->mutable_sun_sky()->clear_sun_scale();
      one->mutable_light()->mutable_sun_sky()->clear_sky_scale();
    }
    EXPECT_EQ(item.SerializeAsString(), before.SerializeAsString()) << i;
  }
  EXPECT_NEAR(counts[v1::Film::LUMINANCE], 400, 10);
  for (const auto colour : {v1::Film::RED, v1::Film::GREEN, v1::Film::BLUE}) {
    EXPECT_NEAR(counts[colour], 400, 40) << colour;
  }
}

// A light that is added changes nothing of the others.
TEST(DatasetPlan, PanoramasAreOneMoreLight) {
  v1::DatasetConfig config = training_alone("studio");
  const NameSplit shapes = split_shapes(config, nameless(3));
  const NameSplit panoramas{{"a", "b"}, {}, {}};
  v1::DatasetConfig more = config;
  more.add_lights()->mutable_panoramas();
  set_defaults(more);
  std::map<std::string, int> counts;
  for (uint64_t i = 0; i < 2000; ++i) {
    v1::DatasetItem item = plan_item(more, shapes, i, panoramas);
    const v1::DatasetItem before = plan_item(config, shapes, i);
    if (item.light().has_panorama()) {
      ++counts[item.light().panorama().name()];
      *item.mutable_light() = before.light();
    }
    EXPECT_EQ(item.SerializeAsString(), before.SerializeAsString()) << i;
  }
  EXPECT_NEAR(counts["a"], 500, 100);
  EXPECT_NEAR(counts["a"] + counts["b"], 1000, 20);
}

// In each of 64 equal parts of its range there is one of 64 materials, whichever 64 of the sequence
// they are that begin at a multiple of 64; of pairs likewise, one in each of 8 x 8.
TEST(DatasetPlan, StratifiedMaterialsFillEveryStratumOnce) {
  v1::DatasetConfig config = small_config();
  config.set_test_fraction(0.2);
  config.set_count(160);
  const std::vector<v1::DatasetItem> items =
      items_of(plan_dataset(config, nameless(5)).manifest, v1::SPLIT_TRAIN);
  ASSERT_EQ(items.size(), 128);
  for (size_t begin : {0, 64}) {
    std::set<int> sigma_t, albedo, g;
    std::set<std::pair<int, int>> pairs;
    for (size_t i = begin; i < begin + 64; ++i) {
      const v1::Material& material = items[i].material();
      const auto stratum = [](double value, double min, double max) {
        return static_cast<int>(64 * (value - min) / (max - min));
      };
      sigma_t.insert(stratum(std::log(material.sigma_t()), std::log(30), std::log(276)));
      albedo.insert(stratum(material.albedo(), 0.39, 0.95));
      g.insert(stratum(material.g(), 0, 0.8));
      pairs.insert({stratum(std::log(material.sigma_t()), std::log(30), std::log(276)) / 8,
                    stratum(material.albedo(), 0.39, 0.95) / 8});
    }
    EXPECT_EQ(sigma_t.size(), 64);
    EXPECT_EQ(albedo.size(), 64);
    EXPECT_EQ(g.size(), 64);
    EXPECT_EQ(pairs.size(), 64);
  }
}

TEST(DatasetPlan, PosesComeAsOftenAsTheyWeighAndEveryOrientationIsAsLikely) {
  v1::DatasetConfig config = training_alone("outdoor");
  config.mutable_pose()->set_upright(1);
  config.mutable_pose()->set_turned(2);
  config.mutable_pose()->set_any(5);
  const NameSplit shapes = split_shapes(config, nameless(2));
  int upright = 0, turned = 0;
  double up[3] = {}, up_squared[3] = {};
  int any = 0;
  for (uint64_t i = 0; i < 8000; ++i) {
    const v1::DatasetItem item = plan_item(config, shapes, i);
    if (!item.has_rotation()) {
      ++upright;
      continue;
    }
    const v1::Vec3& axis = item.rotation().axis();
    if (axis.x() == 0 && axis.z() == 0) {
      ++turned;
      continue;
    }
    ++any;
    // The direction of +y is as likely anywhere on the sphere.
    const double angle = item.rotation().angle_degrees() * std::numbers::pi / 180;
    const Vec3d k = normalize(Vec3d{axis.x(), axis.y(), axis.z()}), y{0, 1, 0};
    const Vec3d to = y * std::cos(angle) + cross(k, y) * std::sin(angle) +
                     k * (dot(k, y) * (1 - std::cos(angle)));
    const double components[] = {to.x, to.y, to.z};
    for (size_t c = 0; c < 3; ++c) {
      up[c] += components[c];
      up_squared[c] += components[c] * components[c];
    }
  }
  EXPECT_NEAR(upright, 1000, 30);
  EXPECT_NEAR(turned, 2000, 40);
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(up[c] / any, 0, 4 / std::sqrt(3.0 * any));
    EXPECT_NEAR(up_squared[c] / any, 1 / 3., 4 * std::sqrt(4 / 45. / any));
  }
}

// --- Datasets ---

TEST(DatasetPlan, CountsAndSeeds) {
  v1::DatasetConfig config = small_config();
  config.set_count(40);
  config.mutable_pose()->Clear();
  config.mutable_pose()->set_turned(1);
  const v1::Dataset manifest = plan_dataset(config, nameless(5)).manifest;
  std::set<uint64_t> seeds;
  std::set<float> rotations;
  for (const v1::DatasetItem& item : manifest.items()) {
    seeds.insert(item.seed());
    rotations.insert(item.rotation().angle_degrees());
  }
  EXPECT_EQ(manifest.items_size(), 40);
  EXPECT_EQ(items_of(manifest, v1::SPLIT_TEST).size(), 10);
  EXPECT_EQ(seeds.size(), 40);
  EXPECT_EQ(rotations.size(), 40);
}

TEST(DatasetPlan, GridIsThePapers) {
  v1::DatasetConfig config = small_config();
  config.set_count(0);
  v1::MaterialChoice& materials = *config.mutable_materials();
  materials.set_sampling(v1::MaterialChoice::GRID);
  const auto fill = [](v1::Distribution* distribution, int count) {
    auto& values = *distribution->mutable_one_of();
    for (int i = 1; i <= count; ++i) values.add_value(0.1 * i);
  };
  fill(materials.mutable_sigma_t(), 12);
  fill(materials.mutable_albedo(), 5);
  fill(materials.mutable_g(), 5);
  config.mutable_pose()->Clear();
  config.mutable_pose()->set_any(1);
  const v1::Dataset manifest = plan_dataset(config, nameless(5)).manifest;
  // 300 materials; 4 shapes x 4 azimuths to train, 1 x 6 to test. Those of a scene share it.
  EXPECT_EQ(manifest.items_size(), 300 * (4 * 4 + 1 * 6));
  std::set<std::string> scenes, materials_seen;
  for (v1::DatasetItem item : manifest.items()) {
    materials_seen.insert(item.material().SerializeAsString());
    item.clear_file();
    item.clear_material();
    item.clear_seed();
    scenes.insert(item.SerializeAsString());
  }
  EXPECT_EQ(scenes.size(), 4 * 4 + 1 * 6);
  EXPECT_EQ(materials_seen.size(), 300);
}

// --- Media in colour ---

v1::DatasetConfig colour_config(uint32_t count) {
  v1::DatasetConfig config;
  parse_text_proto(
      "materials { sigma_s_reduced { log_uniform { min: 5 max: 400 } }"
      "  albedo { complement_log_uniform { min: 0.3 max: 0.9999 } }"
      "  g { uniform { min: -0.1 max: 0.95 } } colours { gray: 0.25 measured: 0.25 } }",
      "test", config);
  config.set_count(count);
  set_defaults(config);
  return config;
}

std::vector<Material> colours_of(const v1::DatasetItem& item) {
  std::vector<Material> colours;
  for (const v1::Material& colour : item.colours()) colours.push_back(from_proto(colour));
  return colours;
}

TEST(DatasetPlan, ColoursAreDrawnAroundGreen) {
  constexpr int kItems = 4096;
  const v1::DatasetConfig config = colour_config(kItems);
  const v1::Dataset manifest = plan_dataset(config, nameless(5)).manifest;
  const v1::MaterialRange range = material_range(config);
  std::vector<double> reduced, red;
  int gray = 0;
  for (const v1::DatasetItem& item : manifest.items()) {
    EXPECT_EQ(item.channel(), v1::Film::RGB);
    EXPECT_FALSE(item.has_material());
    const std::vector<Material> colours = colours_of(item);
    ASSERT_EQ(colours.size(), 3);
    for (const Material& colour : colours) {
      EXPECT_NO_THROW(validate(colour));
      EXPECT_EQ(colour.g, colours[1].g);
      EXPECT_GE(colour.albedo, 0.3 - 1e-12);
      EXPECT_LE(colour.albedo, 0.9999 + 1e-12);
      EXPECT_GE(colour.sigma_t, range.sigma_t().min());
      EXPECT_LE(colour.sigma_t, range.sigma_t().max());
      const double ratio = colour.sigma_s() / colours[1].sigma_s();
      EXPECT_TRUE(ratio > 0.5 - 1e-6 && ratio < 2 + 1e-6) << ratio;
    }
    reduced.push_back(std::log(colours[1].sigma_s_reduced()));
    if (colours[0] == colours[1] && colours[2] == colours[1]) {
      ++gray;
    } else {
      red.push_back(std::log(colours[0].sigma_s() / colours[1].sigma_s()));
    }
  }
  // Three in four are around green or gray, and a third of those is gray.
  EXPECT_NEAR(gray, kItems / 4, kItems / 40);
  const auto mean = [](const std::vector<double>& values) {
    return std::reduce(values.begin(), values.end()) / static_cast<double>(values.size());
  };
  EXPECT_NEAR(mean(reduced), std::log(std::sqrt(5 * 400.0)), 0.02);
  // The logarithm of the ratio has a mean of 0, but for those that are measured; it has not one
  // value.
  EXPECT_NEAR(mean(red), 0, 0.1);
  EXPECT_GT(std::set<double>(red.begin(), red.end()).size(), red.size() / 2);
}

// Nine in ten of independent colours lie where nine in ten of one are, and no two of them go
// together.
TEST(DatasetPlan, IndependentColoursAreDrawnEachAsGreenIs) {
  constexpr int kItems = 4096;
  v1::DatasetConfig config;
  parse_text_proto(
      "materials { sigma_t { uniform { min: 1 max: 200 } } albedo { uniform { min: 0.3 max: 0.95 } "
      "}"
      "  g { uniform { min: 0 max: 0.9 } } colours { gray: 0 measured: 0 independent: 1 } }",
      "test", config);
  config.set_count(kItems);
  set_defaults(config);
  const v1::MaterialRange range = material_range(config);
  EXPECT_EQ(range.sigma_t().min(), 1);
  EXPECT_EQ(range.sigma_t().max(), 200);
  const v1::Dataset even = plan_dataset(config, nameless(5)).manifest;
  // By number of six: sigma_t and albedo of each colour, from 0 to 1.
  std::array<std::vector<double>, 6> numbers;
  for (const v1::DatasetItem& item : even.items()) {
    const std::vector<Material> colours = colours_of(item);
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_EQ(colours[c].g, colours[1].g);
      numbers[2 * c].push_back((colours[c].sigma_t - 1) / 199);
      numbers[2 * c + 1].push_back((colours[c].albedo - 0.3) / 0.65);
    }
  }
  const auto mean_product = [&](size_t a, size_t b) {
    double sum = 0;
    for (size_t i = 0; i < kItems; ++i) sum += (numbers[a][i] - 0.5) * (numbers[b][i] - 0.5);
    return sum / kItems;
  };
  for (size_t a = 0; a < numbers.size(); ++a) {
    const auto [low, high] = std::ranges::minmax(numbers[a]);
    EXPECT_GE(low, 0);
    EXPECT_LE(high, 1);
    // Five standard errors of independent numbers: a variance of 1/12, whose own is 1/180.
    EXPECT_NEAR(mean_product(a, a), 1.0 / 12, 5 / std::sqrt(180.0 * kItems));
    for (size_t b = 0; b < a; ++b) {
      EXPECT_NEAR(mean_product(a, b), 0, 5.0 / 12 / std::sqrt(kItems)) << a << " and " << b;
    }
  }
  // How dense media are may be said by sigma_s (1 - g), too.
  config.mutable_materials()->clear_sigma_t();
  *config.mutable_materials()->mutable_sigma_s_reduced() =
      colour_config(1).materials().sigma_s_reduced();
  const v1::Dataset reduced = plan_dataset(config, nameless(5)).manifest;
  for (const v1::DatasetItem& item : reduced.items()) {
    for (const Material& colour : colours_of(item)) {
      EXPECT_GT(colour.sigma_s_reduced(), 5 * (1 - 1e-9));
      EXPECT_LT(colour.sigma_s_reduced(), 400 * (1 + 1e-9));
    }
  }
}

TEST(DatasetPlan, MeasuredMediaKeepTheRatiosOfTheirColours) {
  v1::DatasetConfig config = colour_config(200);
  config.mutable_materials()->mutable_colours()->set_gray(0);
  config.mutable_materials()->mutable_colours()->set_measured(1);
  const v1::Dataset manifest = plan_dataset(config, nameless(5)).manifest;
  int milk = 0;
  for (const v1::DatasetItem& item : manifest.items()) {
    const std::vector<Material> c = colours_of(item);
    // Of skim milk: sigma_a .0014, .0025 and .0142, sigma_s (1 - g) .7, 1.22 and 1.9.
    const double red = c[0].sigma_s_reduced() / c[1].sigma_s_reduced();
    const double absorbed = c[1].sigma_a() / c[1].sigma_s_reduced();
    if (std::abs(red - 0.7 / 1.22) > 1e-6 || std::abs(absorbed - 0.0025 / 1.22) > 1e-6) continue;
    EXPECT_NEAR(c[2].sigma_s_reduced() / c[1].sigma_s_reduced(), 1.9 / 1.22, 1e-6);
    EXPECT_NEAR(c[2].sigma_a() / c[1].sigma_a(), 0.0142 / 0.0025, 1e-6);
    ++milk;
  }
  EXPECT_GE(milk, 1);
}

TEST(DatasetPlan, IsAFunctionOfItsConfiguration) {
  const v1::DatasetConfig config = small_config();
  const std::string once = to_text(plan_dataset(config, nameless(5)).manifest);
  EXPECT_EQ(to_text(plan_dataset(config, nameless(5)).manifest), once);
  v1::DatasetConfig other = config;
  other.set_seed(4);
  EXPECT_NE(to_text(plan_dataset(other, nameless(5)).manifest), once);
}

TEST(DatasetPlan, IsExtendedWithoutAChangeToWhatIsThere) {
  const std::vector<Panorama> panoramas = {{"a", "0", {}}, {"b", "0", {}}, {"c", "0", {}}};
  for (const char* preset : {"outdoor", "studio", "any"}) {
    v1::DatasetConfig config = preset_config(preset);
    config.add_lights()->mutable_panoramas();
    set_defaults(config);
    config.set_count(100);
    const v1::Dataset few = plan_dataset(config, nameless(30), panoramas).manifest;
    const v1::Dataset more = extended(few, 333).manifest;
    config.set_count(333);
    EXPECT_EQ(to_text(more), to_text(plan_dataset(config, nameless(30), panoramas).manifest));
    std::set<std::string> cameras, lights;
    for (int i = 0; i < more.items_size(); ++i) {
      if (i < 100) {
        EXPECT_EQ(more.items(i).DebugString(), few.items(i).DebugString());
      }
      EXPECT_TRUE(cameras.insert(more.items(i).camera().SerializeAsString()).second) << i;
      EXPECT_TRUE(lights.insert(more.items(i).light().SerializeAsString()).second) << i;
    }
    expect_error(ErrorKind::kInvalidInput, "333 images already, and 332 are asked for",
                 [&] { extended(more, 332); });
  }
}

TEST(DatasetPlan, SaysWhatIsWrong) {
  struct Row {
    const char* message;
    std::function<void(v1::DatasetConfig&, std::vector<Shape>&)> spoil;
  };
  const Row rows[] = {
      {"test fraction is 1", [](auto& config, auto&) { config.set_test_fraction(1); }},
      {"test fraction is 0", [](auto& config, auto&) { config.set_test_fraction(0); }},
      {"of 1 images, with a test fraction of 0.25, 0 are to test with",
       [](auto& config, auto&) { config.set_count(1); }},
      {"spp must be 1", [](auto& config, auto&) { config.set_spp(0); }},
      {"there are 1 shapes", [](auto&, auto& shapes) { shapes.resize(1); }},
      {"two shapes are called", [](auto&, auto& shapes) { shapes[1].name = shapes[0].name; }},
      {"no shape \"teapot\"", [](auto& config, auto&) { config.add_test_shapes("teapot"); }},
      {"no shape \"teapot\" to test with; none is left",
       [](auto& config, auto& shapes) {
         for (const Shape& shape : shapes) config.add_test_shapes(shape.name);
         config.add_test_shapes("teapot");
       }},
      {"no shape is left to train with",
       [](auto& config, auto& shapes) {
         for (const Shape& shape : shapes) config.add_test_shapes(shape.name);
       }},
  };
  for (const Row& row : rows) {
    v1::DatasetConfig config = small_config();
    std::vector<Shape> shapes = nameless(5);
    row.spoil(config, shapes);
    expect_error(ErrorKind::kInvalidInput, row.message, [&] { plan_dataset(config, shapes); });
  }
}

}  // namespace
}  // namespace itn
