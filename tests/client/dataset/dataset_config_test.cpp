#include "client/dataset/dataset_config.h"

#include <fstream>

#include "client/dataset/distribution.h"
#include "client/presets/presets.h"
#include "client/scene/text_proto.h"
#include "tests/client/dataset/dataset_support.h"

namespace itn {
namespace {

v1::DatasetConfig parsed(const std::string& text) {
  v1::DatasetConfig config;
  parse_text_proto(text, "test", config);
  set_defaults(config);
  return config;
}

TEST(Distribution, QuantilesAndRanges) {
  v1::Distribution list;
  for (const double value : {3, 1, 2}) list.mutable_one_of()->add_value(value);
  EXPECT_EQ(quantile(fixed(7), 0.3), 7);
  EXPECT_DOUBLE_EQ(quantile(uniform(2, 4), 0.25), 2.5);
  EXPECT_DOUBLE_EQ(quantile(log_uniform(1, 100), 0.5), 10);
  EXPECT_NEAR(quantile(complement_log_uniform(0.9, 0.9999), 1.0 / 3), 0.99, 1e-12);
  EXPECT_NEAR(quantile(complement_log_uniform(0, 0.9), 1), 0.9, 1e-12);
  EXPECT_EQ(quantile(list, 0), 3);
  EXPECT_EQ(quantile(list, 0.34), 1);
  EXPECT_EQ(quantile(list, 0.999999), 2);
  EXPECT_EQ(range_of(list).min(), 1);
  EXPECT_EQ(range_of(list).max(), 3);
  EXPECT_EQ(range_of(fixed(7)).max(), 7);
}

// A quantile's slope is the reciprocal of the density, but for one factor.
TEST(Distribution, DensitiesAreThoseOfQuantiles) {
  constexpr double kStep = 1e-4;
  for (const v1::Distribution& distribution :
       {uniform(2, 4), log_uniform(1, 100), complement_log_uniform(0.3, 0.9999)}) {
    const auto factor = [&](double u) {
      const double slope =
          (quantile(distribution, u + kStep) - quantile(distribution, u - kStep)) / (2 * kStep);
      return slope * density(distribution, quantile(distribution, u));
    };
    for (const double u : {0.01, 0.3, 0.99}) EXPECT_NEAR(factor(u) / factor(0.5), 1, 1e-4) << u;
    EXPECT_EQ(density(distribution, range_of(distribution).max() + 1e-9), 0);
  }
}

TEST(Distribution, SaysWhatIsWrong) {
  const auto expect = [](const std::string& message, const v1::Distribution& distribution) {
    expect_error(ErrorKind::kInvalidInput, message, [&] { validate("x", distribution, -1, 10); });
  };
  v1::Distribution list;
  list.mutable_one_of();
  expect("x is 11; it must be in [-1, 10]", fixed(11));
  expect("x is nan", fixed(NAN));
  expect("range of x is [4, 2]; its minimum must not exceed its maximum", uniform(4, 2));
  expect("range of x is [4, 20]; it must lie in [-1, 10]", uniform(4, 20));
  expect("logarithm needs a minimum above 0", log_uniform(0, 2));
  expect("1 minus it needs a maximum below 1", complement_log_uniform(0, 1));
  expect("x is one of an empty list", list);
  expect("one of fixed, uniform, log_uniform, one_of and complement_log_uniform", {});
}

TEST(DatasetConfig, PresetsAreValidAndReadBackEqual) {
  for (const Preset& preset : dataset_presets()) {
    v1::DatasetConfig config = preset_config(preset.name);
    EXPECT_NO_THROW(validate(config)) << preset.name;
    EXPECT_EQ(to_text_proto(parsed(to_text_proto(config))), to_text_proto(config)) << preset.name;
  }
  expect_error(ErrorKind::kInvalidInput, "no preset \"indoor\"; there are paper, outdoor, flash",
               [] { preset_config("indoor"); });
}

TEST(DatasetConfig, MaterialsSayHowDenseTheyAreOnce) {
  const auto expect = [](const std::string& message, const std::string& materials) {
    expect_error(ErrorKind::kInvalidInput, message,
                 [&] { validate(parsed("materials { " + materials + " }")); });
  };
  const std::string reduced = "sigma_s_reduced { log_uniform { min: 5 max: 400 } } ";
  EXPECT_NO_THROW(validate(parsed("materials { " + reduced + "}")));
  EXPECT_FALSE(parsed("materials { " + reduced + "}").materials().has_sigma_t());
  expect("there are sigma_t and sigma_s_reduced", reduced + "sigma_t { fixed: 1 }");
  expect("the albedo begins at 0", reduced + "albedo { uniform { max: 1 } }");
  expect("materials may have a sigma_t from", "sigma_s_reduced { fixed: 1e5 } g { fixed: 0.95 }");
  expect("gray is 0.8, measured 0.5 and independent 0", "colours { gray: 0.8 measured: 0.5 }");
  expect("scattering is 200", "colours { scattering { fixed: 200 } }");
  expect("a grid takes sigma_t",
         "sampling: GRID sigma_t { fixed: 1 } albedo { fixed: 0.5 } g { fixed: 0 } colours {}");
  // Bounds follow.
  const v1::Interval sigma_t =
      material_range(parsed("materials { " + reduced +
                            "albedo { uniform { min: 0.5 max: 1 } } g { uniform { max: 0.9 } } }"))
          .sigma_t();
  EXPECT_DOUBLE_EQ(sigma_t.min(), 5);
  EXPECT_NEAR(sigma_t.max(), 400 / (0.5 * 0.1), 1e-6);
}

TEST(DatasetConfig, WhatIsAbsentIsThePapers) {
  EXPECT_EQ(to_text_proto(parsed("")), to_text_proto(preset_config("paper")));
  const v1::DatasetConfig config = parsed(
      "camera { distance { fixed: 5 } } materials { albedo { uniform { max: 0.5 } } }"
      "pose { turned: 1 } lights { sun_sky { azimuth_degrees { fixed: 7 } } }"
      "lights { weight: 3 sun_sky { turbidity { fixed: 2 } } }");
  EXPECT_EQ(config.camera().distance().fixed(), 5);
  EXPECT_EQ(config.camera().pitch_degrees().fixed(), 15);
  EXPECT_EQ(config.materials().albedo().uniform().min(), 0);  // not the default's
  EXPECT_EQ(config.materials().sigma_t().log_uniform().max(), 276);
  EXPECT_EQ(config.pose().upright(), 0);
  ASSERT_EQ(config.lights_size(), 2);
  EXPECT_EQ(config.lights(0).weight(), 1);
  EXPECT_FALSE(config.lights(0).sun_sky().has_test_azimuth_degrees());  // as those of training
  EXPECT_EQ(config.lights(1).sun_sky().test_azimuth_degrees().one_of().value_size(), 6);
  EXPECT_EQ(config.lights(1).sun_sky().azimuth_degrees().one_of().value_size(), 4);
}

// Files without a surface, a lamp and a checkerboard mean what they did before there were any.
TEST(DatasetConfig, WhatIsNotAskedForStaysAbsent) {
  const v1::DatasetConfig paper = preset_config("paper");
  EXPECT_FALSE(paper.has_boundary());
  EXPECT_FALSE(paper.ground().has_square());
  const v1::DatasetConfig config =
      parsed("boundary { roughness { fixed: 0.2 } } ground { checkered: 0.5 } lights { lamp {} }");
  EXPECT_EQ(config.boundary().probability(), 1);
  EXPECT_EQ(config.boundary().roughness().fixed(), 0.2);
  EXPECT_EQ(config.boundary().index().uniform().max(), 1.6);
  EXPECT_EQ(config.boundary().smooth_angle_degrees(), 30);
  EXPECT_EQ(config.ground().square().log_uniform().max(), 1);
  EXPECT_FALSE(config.ground().has_image_size());
  const v1::DatasetConfig mottled = parsed("ground { mottled: 0.5 }");
  EXPECT_EQ(mottled.ground().image_size().log_uniform().max(), 10);
  EXPECT_EQ(mottled.ground().persistence().uniform().max(), 0.9);
  EXPECT_FALSE(mottled.ground().has_square());
  EXPECT_EQ(config.ground().reflectance().fixed(), 0.5);
  EXPECT_EQ(config.lights(0).lamp().distance().log_uniform().min(), 1.5);
  EXPECT_EQ(config.lights(0).lamp().ambient().fixed(), 0);
}

TEST(DatasetConfig, WhatIsAbsentOfAStudioIsThePresets) {
  EXPECT_EQ(to_text_proto(parsed("lights { studio {} }").lights(0)),
            to_text_proto(preset_config("studio").lights(0)));
  const v1::StudioChoice studio =
      parsed("lights { studio { emitters { fixed: 2 } emitter { lamps: 0 edge { fixed: 1 } } } }")
          .lights(0)
          .studio();
  EXPECT_EQ(studio.emitters().fixed(), 2);
  EXPECT_EQ(studio.emitter().lamps(), 0);
  EXPECT_EQ(studio.emitter().edge().fixed(), 1);
  EXPECT_EQ(studio.emitter().aspect().uniform().max(), 1);
  EXPECT_EQ(studio.irradiance().fixed(), 100);
}

TEST(DatasetConfig, NoiseTakesThePlaceOfSpp) {
  const v1::DatasetConfig config = parsed("noise { target: 0.05 max_spp: 99 }");
  EXPECT_FALSE(config.has_spp());
  EXPECT_EQ(config.noise().max_spp(), 99);
  EXPECT_EQ(config.noise().pilot_spp(), 8);
  EXPECT_NO_THROW(validate(config));
  expect_error(ErrorKind::kInvalidInput, "noise target and spp",
               [] { validate(parsed("noise { target: 0.05 } spp: 16")); });
}

TEST(DatasetConfig, ATypoIsAnErrorWithLineAndColumn) {
  const auto path = std::filesystem::path(::testing::TempDir()) / "dataset-with-a-typo.textproto";
  std::ofstream(path) << "count: 5\ncamera {\n  pitsch_degrees { fixed: 3 }\n}\n";
  expect_error(ErrorKind::kInvalidInput,
               path.string() + ":3:18: ", [&] { load_dataset_config(path); });
  std::filesystem::remove(path);
  expect_error(ErrorKind::kIo, "cannot read", [&] { load_dataset_config(path); });
  expect_error(ErrorKind::kInvalidInput, "\"emiters\"",
               [] { parsed("lights { studio { emiters { fixed: 3 } } }"); });
  expect_error(ErrorKind::kInvalidInput, "\"size\"",
               [] { parsed("lights { studio { emitter { size { fixed: 30 } } } }"); });
}

TEST(DatasetConfig, KnowsTheIrradianceThatAllLightsHave) {
  EXPECT_EQ(common_irradiance(preset_config("any")), 100);
  EXPECT_EQ(common_irradiance(preset_config("studio")), 100);
  EXPECT_EQ(common_irradiance(preset_config("flash")), 100);
  EXPECT_EQ(common_irradiance(preset_config("outdoor")), 0);
  EXPECT_EQ(common_irradiance(parsed("lights { sun_sky { irradiance { fixed: 70 } } }")), 70);
  EXPECT_EQ(common_irradiance(parsed("lights { sun_sky { irradiance { fixed: 70 } } } "
                                     "lights { flash {} }")),
            0);
  EXPECT_EQ(common_irradiance(parsed("lights { flash { irradiance { uniform { min: 70 max: 80 } } "
                                     "} }")),
            0);
}

TEST(DatasetConfig, SaysWhatIsOutOfRange) {
  const std::pair<const char*, const char*> rows[] = {
      {"resolution: 48", "resolution is 48"},
      {"materials { albedo { uniform { min: 0.39 max: 1.2 } } }", "range of albedo is [0.39, 1.2]"},
      {"materials { g { uniform { min: 0.8 } } }", "range of g is [0.8, 0]"},
      {"lights { sun_sky { azimuth_degrees { one_of { value: [30] } }"
       " test_azimuth_degrees { fixed: 390 } } }",
       "sun azimuth 390 is in both splits"},
      {"lights { sun_sky { turbidity { fixed: 11 } } }", "lights[0].sun_sky.turbidity is 11"},
      {"lights { sun_sky { irradiance { fixed: 0 } } }", "lights[0].sun_sky.irradiance is 0"},
      {"lights { studio { emitters { uniform { min: 1 max: 3 } } } }",
       "lights[0].studio.emitters is a range"},
      {"lights { studio { emitters { fixed: 2.5 } } }", "emitters is 2.5; it must be a whole"},
      {"lights { studio { emitters { fixed: 0 } } }", "emitters is 0; it must be in [1, 16]"},
      {"views: 0", "views is 0; it must be in [1, 64]"},
      {"views: 65", "views is 65; it must be in [1, 64]"},
      {"lights { studio { emitter { temperature { fixed: 4000 } } } }",
       "lights[0] has a temperature; images have no colours: materials { colours {} }"},
      {"materials { colours {} } lights { flash { temperature { fixed: 1000 } } }",
       "lights[0].flash.temperature is 1000; it must be in [2000, 40000]"},
      {"lights { studio { irradiance { fixed: 0 } } }", "lights[0].studio.irradiance is 0"},
      {"lights { studio { walls { fixed: 1.5 } } }", "lights[0].studio.walls is 1.5"},
      {"lights { studio { emitter { size_degrees { fixed: -20 } } } }",
       "lights[0].studio.emitter.size_degrees is -20; it must be in [4, 120]"},
      {"lights { studio { emitter { elevation_degrees { uniform { min: -9 max: 20 } } } } }",
       "range of lights[0].studio.emitter.elevation_degrees is [-9, 20]"},
      {"lights { studio { emitter { lamps: 2 } } }", "lights[0].studio.emitter.lamps is 2"},
      {"lights { panoramas { folder: \"a\" irradiance { fixed: -1 } } }",
       "lights[0].panoramas.irradiance is -1"},
      {"lights { panoramas { folder: \"a\" } } lights { panoramas { folder: \"b\" } }",
       "two lights are panoramas"},
      {"shapes { random { count: 1 } }", "shapes.random.count is 1"},
      {"lights { weight: 1 }", "lights[0] says no light"},
      {"lights { lamp { distance { fixed: 0.5 } } }", "lights[0].lamp.distance is 0.5"},
      {"lights { lamp { radius { fixed: 0.4 } } }", "lights[0].lamp.radius is 0.4"},
      {"lights { lamp { elevation_degrees { fixed: -1 } } }",
       "lights[0].lamp.elevation_degrees is -1"},
      {"boundary { probability: 1.5 }", "boundary.probability is 1.5; it must be in [0, 1]"},
      {"boundary { index { fixed: 1 } }", "boundary.index is 1; it must be in [1.1, 2.5]"},
      {"boundary { roughness { fixed: 0 } }", "boundary.roughness is 0; it must be in [0.001, 1]"},
      {"boundary { smooth_angle_degrees: 181 }", "boundary.smooth_angle_degrees is 181"},
      {"ground { checkered: 2 }", "ground.checkered is 2"},
      {"ground { mottled: -1 }", "ground.mottled is -1"},
      {"ground { coloured: 2 }", "ground.coloured is 2"},
      {"ground { mottled: 0.6 checkered: 0.5 }", "together they are at most 1"},
      {"ground { mottled: 1 image_size { fixed: 0 } }", "ground.image_size is 0"},
      {"ground { mottled: 1 persistence { fixed: 2 } }", "ground.persistence is 2"},
      {"ground { checkered: 1 square { fixed: 0 } }", "ground.square is 0"},
      {"ground { checkered: 1 other_reflectance { fixed: 2 } }", "ground.other_reflectance is 2"},
      {"coloured: 1.5", "coloured is 1.5; it must be in [0, 1]"},
      {"pose { turned: -1 }", "weights of pose"},
      {"ground { probability: 2 }", "ground.probability is 2"},
      {"camera { pitch_degrees { fixed: 90 } }", "pitch_degrees is 90"},
      {"test_fraction: 0.5 validation_fraction: 0.5", "leave nothing to train with"},
      {"noise { target: 5 }", "noise.target is 5; it must be in (0, 1]"},
      {"noise { target: 0.1 min_spp: 1 }", "noise.min_spp"},
      {"materials { sampling: GRID }", "a grid takes lists"},
  };
  for (const auto& [file, message] : rows) {
    expect_error(ErrorKind::kInvalidInput, message, [&] { validate(parsed(file)); });
  }
}

}  // namespace
}  // namespace itn
