#include "client/refine/refinement.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "client/refine/coordinates.h"
#include "client/refine/refine_run.h"
#include "tests/client/refine/synthetic_model.h"
#include "tests/support/expect_error.h"
#include "tests/support/statistics.h"

namespace itn {
namespace {

using namespace testing;

constexpr Material kTruth{60, 0.8, 0.3}, kStart{90, 0.6, 0};

v1::RefineResult refined(const SyntheticModel& model, const std::vector<Observation>& observations,
                         v1::RefineSettings settings, const std::vector<Material>& starts) {
  Refinement refinement(std::move(settings), observations, starts);
  while (!refinement.finished()) refinement.step(model.renderer());
  return refinement.result();
}

bool has(const v1::RefinedParameter& p, double truth) {
  return p.low_95() <= truth && truth <= p.high_95();
}

// Expects 95 % of so many draws, give or take four standard deviations of the binomial
// distribution.
void expect_covered(std::span<const int> inside, int draws) {
  const double sigma = std::sqrt(0.95 * 0.05 / draws);
  for (const int count : inside) EXPECT_NEAR(static_cast<double>(count) / draws, 0.95, 4 * sigma);
}

TEST(Refinement, FindsTheTruthInImagesWithoutNoise) {
  const SyntheticModel quiet(0.01);
  const v1::RefineResult result = refined(quiet, {quiet.observe(kTruth, 0, 1)}, {}, {kStart});
  EXPECT_EQ(result.end(), v1::RefineResult::TOLERANCE);
  EXPECT_NEAR(result.material().sigma_t(), kTruth.sigma_t, 0.02 * kTruth.sigma_t);
  EXPECT_NEAR(result.material().albedo(), kTruth.albedo, 0.005);
  EXPECT_NEAR(result.material().g(), kTruth.g, 0.01);
  EXPECT_LE(result.iterations(), 15U);
}

// A shadow that the scene does not have is told, whether or not the image says how noisy it is.
// Noise is not, nor what demosaicing and compression do to it: neighbours that are alike.
TEST(Refinement, TellsDifferencesThatHangTogether) {
  constexpr int kImages = 40;
  constexpr size_t kSide = SyntheticModel::kSide;
  // `noise`: of the image, a tenth of that of a sample of a render.
  const auto told = [&](bool says_noise, bool smooth, double shadow, uint32_t block = 1,
                        double noise = 0.05, bool is_thin = false) {
    const SyntheticModel model(10 * noise);
    int count = 0;
    for (uint64_t i = 0; i < kImages; ++i) {
      Observation observation = model.observe(kTruth, noise, 100 + i);
      std::vector<float>& radiance = observation.radiance;
      if (smooth) {
        std::vector<double> relative;
        for (size_t p = 0; p < radiance.size(); ++p) {
          relative.push_back(radiance[p] / model.radiance(p, kTruth) - 1);
        }
        for (size_t p = 0; p < radiance.size(); ++p) {  // with those to the right and below
          const size_t right = p % kSide + 1 < kSide ? p + 1 : p;
          const size_t below = p + kSide < radiance.size() ? p + kSide : p;
          const double mean = (relative[p] + relative[right] + relative[below]) / 3;
          radiance[p] = static_cast<float>(model.radiance(p, kTruth) * (1 + mean));
        }
      }
      for (size_t p = 0; p < radiance.size(); ++p) {
        const bool in_shadow = p % kSide > kSide / 2 && p / kSide > kSide / 3;
        if (in_shadow) radiance[p] *= static_cast<float>(1 - shadow);
      }
      if (!says_noise) observation.noise.clear();
      if (is_thin) {  // limbs of three pixels
        observation.mask.resize(radiance.size());
        for (size_t p = 0; p < radiance.size(); ++p)
          observation.mask[p] = p % kSide % 5 < 3 ? 1 : 0;
      }
      v1::RefineSettings settings;
      settings.set_seed(i);
      settings.set_max_spp(1024);
      settings.set_block(block);
      const v1::RefineResult result = refined(model, {observation}, settings, {kStart});
      EXPECT_EQ(result.misfit(),
                result.remarks_size() > 0 &&
                    result.remarks(result.remarks_size() - 1).find("No interval holds") !=
                        std::string::npos);
      count += result.misfit() ? 1 : 0;
    }
    return count;
  };
  EXPECT_EQ(told(true, false, 0), 0);
  EXPECT_EQ(told(false, false, 0), 0);
  EXPECT_EQ(told(false, true, 0), 0);
  EXPECT_GE(told(false, false, 0.2), kImages * 9 / 10);
  EXPECT_GE(told(true, false, 0.2), kImages * 9 / 10);
  // Intervals that come from squares of pixels know of a hundredth.
  constexpr double kLittleNoise = 0.003, kFaint = 0.03;
  EXPECT_GE(told(false, false, kFaint, 1, kLittleNoise), kImages * 9 / 10);
  EXPECT_EQ(told(false, false, kFaint, 2, kLittleNoise), 0);
  EXPECT_GE(told(false, false, 0.2, 2), kImages * 9 / 10);
  EXPECT_EQ(told(false, false, 0, 1, 0.02, true), 0);
  EXPECT_GE(told(false, false, 0.2, 1, 0.02, true), kImages * 9 / 10);
}

// A render takes a millisecond for each of its samples. Without a limit 40 iterations would take
// minutes.
TEST(Refinement, KeepsItsTimeLimit) {
  constexpr double kSecondsPerSample = 1e-3;
  const SyntheticModel model;
  const std::vector<Observation> observations{model.observe(kTruth, 1e-4, 1)};
  for (const auto& [limit, before] : {std::pair{0.3, 0.0}, {1.0, 0.0}, {5.0, 0.0}, {5.0, 4.0}}) {
    v1::RefineSettings settings;
    settings.set_time_limit(limit);
    settings.set_max_spp(1U << 16);
    settings.set_tolerance(0);
    Refinement refinement(settings, observations, {kStart, {50, 0.8, 0.3}}, before);
    double now = before;
    const auto run = [&](Refinement& one) {
      one.use_clock([&] { return now; });
      while (!one.finished()) {
        one.step([&](std::span<const RenderQuery> queries) {
          for (const RenderQuery& query : queries) now += kSecondsPerSample * query.spp;
          return model.renderer()(queries);
        });
      }
    };
    run(refinement);
    EXPECT_EQ(refinement.result().end(), v1::RefineResult::TIME_LIMIT) << limit;
    EXPECT_DOUBLE_EQ(refinement.result().seconds(), now) << limit;
    EXPECT_LE(now, limit) << limit;
    EXPECT_GT(now, 0.6 * limit) << limit;
    // Another fifth of the time.
    v1::RefineState state = refinement.state();
    state.mutable_settings()->set_time_limit(1.2 * limit);
    for (v1::RefineStartState& start : *state.mutable_starts()) {
      start.set_end(v1::RefineResult::UNFINISHED);
    }
    Refinement longer(observations, state);
    run(longer);
    EXPECT_LE(now, 1.2 * limit) << limit;
  }
}

// What went by before the first iteration is no time that this took, for a run that goes on
// neither.
TEST(Refinement, KnowsHowLongItsFirstIterationTook) {
  const SyntheticModel model;
  const std::vector<Observation> observations{model.observe(kTruth, 1e-4, 1)};
  constexpr double kBefore = 9, kTook = 0.1;
  v1::RefineSettings settings;
  settings.set_time_limit(10);
  Refinement refinement(settings, observations, {kStart}, kBefore);
  double now = kBefore;
  refinement.use_clock([&] { return now; });
  refinement.step([&](std::span<const RenderQuery> queries) {
    now += kTook;
    return model.renderer()(queries);
  });
  EXPECT_FALSE(refinement.finished());
  EXPECT_FALSE(Refinement(observations, refinement.state()).finished());
}

TEST(Refinement, SaysThatItWasOnItsWay) {
  const SyntheticModel model;
  const std::vector<Observation> observations{model.observe(kTruth, 1e-4, 1)};
  for (const uint32_t iterations : {2U, 40U}) {
    v1::RefineSettings settings;
    settings.set_max_iterations(iterations);
    Refinement refinement(settings, observations, {kStart});
    while (!refinement.finished()) refinement.step(model.renderer());
    const v1::RefineResult result = refinement.result();
    EXPECT_EQ(result.unfinished(), iterations == 2);
    EXPECT_EQ(to_text(result).find("unknown: unfinished") != std::string::npos, iterations == 2);
  }
}

// Differs by a part `size` of the radiance, root mean square, alike over `length` pixels.
void make_a_little_off(Observation& observation, double size, double length, uint64_t seed) {
  constexpr int kWaves = 60;
  constexpr size_t kSide = SyntheticModel::kSide;
  Gaussian1D gaussian(seed);
  std::vector<double> error(SyntheticModel::kPixels);
  for (int wave = 0; wave < kWaves; ++wave) {
    const double u = gaussian() / length, v = gaussian() / length, phase = 10 * gaussian();
    for (size_t p = 0; p < error.size(); ++p) {
      error[p] +=
          size * std::sqrt(2.0 / kWaves) *
          std::cos(u * static_cast<double>(p % kSide) + v * static_cast<double>(p / kSide) + phase);
    }
  }
  for (size_t p = 0; p < error.size(); ++p) {
    observation.radiance[p] *= static_cast<float>(1 + error[p]);
  }
}

v1::RefineSettings settings_of_a_little_off(uint64_t seed, double size, double length) {
  v1::RefineSettings settings;
  settings.set_seed(seed);
  settings.set_max_spp(1024);
  settings.set_unknown_exposure(true);
  (*settings.mutable_known_within())["exposure"] = 0.01;
  settings.set_model_error(size);
  settings.set_model_error_length(size > 0 ? length : 0);
  return settings;
}

// Images may differ from renders of the truth by some per cent, alike over some pixels, as those of
// a shape that is a little off do. 95 % of the intervals have the truth if they are told so, and
// less if not.
TEST(Refinement, IntervalsKnowThatTheSceneIsALittleOff) {
  constexpr int kImages = 100;
  constexpr double kError = 0.05, kLength = 3;
  const SyntheticModel model;
  std::array<std::array<int, 3>, 2> inside{};
  for (uint64_t i = 0; i < kImages; ++i) {
    Observation observation = model.observe(kTruth, 0.02, 100 + i);
    make_a_little_off(observation, kError, kLength, 500 + i);
    for (const bool knows : {false, true}) {
      const v1::RefineResult r = refined(
          model, {observation}, settings_of_a_little_off(i, knows ? kError : 0, kLength), {kStart});
      std::array<int, 3>& count = inside[knows ? 1 : 0];
      count[0] += has(r.sigma_t(), kTruth.sigma_t) ? 1 : 0;
      count[1] += has(r.albedo(), kTruth.albedo) ? 1 : 0;
      count[2] += has(r.g(), kTruth.g) ? 1 : 0;
    }
  }
  for (const int count : inside[0]) EXPECT_LT(count, 0.8 * kImages);
  for (const int count : inside[1]) EXPECT_GE(count, 0.87 * kImages);
}

// Expects that three colours of a photograph, which spoil(observation, i) spoils alike, say no more
// of what they share, as g, than one, and that its interval holds; colours of three photographs
// would say more.
template <typename Spoil, typename SettingsOf>
void expect_colours_say_what_one_does(int images, const SyntheticModel& model, double noise,
                                      const Spoil& spoil, const SettingsOf& settings_of) {
  const std::array<Material, 3> truths{{{60, 0.8, 0.3}, {80, 0.7, 0.3}, {45, 0.9, 0.3}}};
  int inside = 0;
  double together = 0, apart = 0;
  for (uint64_t i = 0; i < static_cast<uint64_t>(images); ++i) {
    std::vector<Observation> observations;
    for (size_t c = 0; c < 3; ++c) {
      observations.push_back(model.observe(truths[c], noise, 3 * i + c));
      observations.back().colour = c;
      observations.back().photograph = 0;
      spoil(observations.back(), i);
    }
    const v1::RefineSettings settings = settings_of(i);
    const v1::RefinedParameter g = refined(model, observations, settings, {kStart}).g();
    inside += has(g, 0.3) ? 1 : 0;
    together += g.standard_deviation();
    for (size_t c = 0; c < 3; ++c) observations[c].photograph = c;
    apart += refined(model, observations, settings, {kStart}).g().standard_deviation();
  }
  EXPECT_GE(inside, 0.85 * images);
  EXPECT_GT(together, 1.3 * apart);
}

TEST(Refinement, ColoursAreALittleOffTogether) {
  constexpr double kError = 0.05, kLength = 3;
  expect_colours_say_what_one_does(
      60, SyntheticModel(), 0.02,
      [](Observation& observation, uint64_t i) {
        make_a_little_off(observation, kError, kLength, 500 + i);
      },
      [](uint64_t i) { return settings_of_a_little_off(i, kError, kLength); });
}

// If hardly anything is absorbed, noise of the renders moves the albedo as far as it is uncertain:
// iterations go nowhere then, and the intervals hold the truth.
TEST(Refinement, IsNotOnItsWayWhereNoiseMovesIt) {
  constexpr int kImages = 100;
  constexpr Material kBright{60, 0.998, 0.3};
  const SyntheticModel model;
  int unfinished = 0, inside = 0;
  for (uint64_t i = 0; i < kImages; ++i) {
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_iterations(5);
    settings.set_max_spp(64);
    const v1::RefineResult r =
        refined(model, {model.observe(kBright, 0.02, 100 + i)}, settings, {{70, 0.99, 0.2}});
    unfinished += r.unfinished() ? 1 : 0;
    inside += has(r.albedo(), kBright.albedo) ? 1 : 0;
  }
  EXPECT_LE(unfinished, kImages / 7);
  expect_covered({&inside, 1}, kImages);
}

// 95 % of the intervals of 200 images, each with noise of its own, have the truth, give or take
// four standard deviations of the binomial distribution: 1.54 % each.
TEST(Refinement, IntervalsCoverTheTruth) {
  constexpr int kImages = 200;
  const SyntheticModel model;
  std::array<int, 3> inside{};
  for (uint64_t i = 0; i < kImages; ++i) {
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(1024);
    const v1::RefineResult r =
        refined(model, {model.observe(kTruth, 0.05, 100 + i)}, settings, {kStart});
    inside[0] += has(r.sigma_t(), kTruth.sigma_t);
    inside[1] += has(r.albedo(), kTruth.albedo);
    inside[2] += has(r.g(), kTruth.g);
  }
  expect_covered(inside, kImages);
}

// If the renders that are allowed hardly tell g, chance must not make it look as if they did, and
// no run may stray along the ridge, or be long about it.
TEST(Refinement, IntervalsCoverTheTruthOnTheSimilarityRidge) {
  constexpr int kImages = 100;
  SyntheticModel model(1);
  model.make_similar_materials_alike();
  int inside = 0;
  for (uint64_t i = 0; i < kImages; ++i) {
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(256);
    const v1::RefineResult r =
        refined(model, {model.observe(kTruth, 0.05, 100 + i)}, settings, {{70, 0.75, 0.1}});
    inside += has(r.sigma_t(), kTruth.sigma_t) && has(r.g(), kTruth.g);
    EXPECT_LE(r.iterations(), 15U);
  }
  EXPECT_GE(inside, 85);
}

TEST(Refinement, FindsAnUnknownExposureToo) {
  const SyntheticModel model;
  v1::RefineSettings settings;
  settings.set_unknown_exposure(true);
  const v1::RefineResult r =
      refined(model, {model.observe(kTruth, 0.02, 3, 2.5)}, settings, {kStart});
  ASSERT_TRUE(r.has_exposure());
  const auto within = [](const v1::RefinedParameter& p, double truth) {
    return std::abs(p.value() - truth) < 4 * p.standard_deviation();
  };
  EXPECT_TRUE(within(r.exposure(), 2.5)) << r.exposure().value();
  EXPECT_TRUE(within(r.sigma_t(), kTruth.sigma_t)) << r.sigma_t().value();
  EXPECT_LT(r.exposure().standard_deviation(), 0.5);
}

// The same as IntervalsCoverTheTruth, with an index that is elsewhere than in the scene, and an
// exposure.
TEST(Refinement, FindsAnUnknownOfTheSceneToo) {
  constexpr int kImages = 100;
  constexpr double kIndex = 1.3, kExposure = 2.5;
  const SyntheticModel model;
  std::array<int, 3> inside{};
  std::vector<double> errors;
  for (uint64_t i = 0; i < kImages; ++i) {
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(1024);
    settings.set_unknown_exposure(true);
    settings.add_unknowns("rough_dielectric.index");
    const v1::RefineResult r = refined(
        model, {model.observe(kTruth, 0.02, 100 + i, kExposure, kIndex)}, settings, {kStart});
    ASSERT_EQ(r.unknowns_size(), 1);
    EXPECT_EQ(r.unknowns(0).name(), "rough_dielectric.index");
    inside[0] += has(r.sigma_t(), kTruth.sigma_t);
    inside[1] += has(r.unknowns(0), kIndex);
    inside[2] += has(r.exposure(), kExposure);
    errors.push_back(r.unknowns(0).value() - kIndex);
  }
  expect_covered(inside, kImages);
  expect_equal(over_batches(errors), {0}, 1, "index");
}

// Three materials of one g in one exposure, by an index that is elsewhere than in the scene, but
// about where it is said to be: all intervals hold, and each colour is told better than by itself.
TEST(Refinement, ColoursShareWhatIsNoMaterial) {
  constexpr int kImages = 60;
  constexpr double kExposure = 2.5, kInScene = 1.5, kWithin = 0.02;
  const std::array<Material, 3> truths{{{60, 0.8, 0.3}, {80, 0.7, 0.3}, {45, 0.9, 0.3}}};
  const SyntheticModel model;
  Gaussian1D gaussian(5);
  std::array<int, 3> of_sigma_t{}, of_albedo{};
  int of_g = 0, of_exposure = 0, of_index = 0;
  double together = 0, alone = 0, index_deviation = 0;
  for (uint64_t i = 0; i < kImages; ++i) {
    const double index = kInScene + kWithin * gaussian();
    std::vector<Observation> observations;
    for (size_t c = 0; c < 3; ++c) {
      observations.push_back(model.observe(truths[c], 0.3, 3 * i + c, kExposure, index));
      observations.back().colour = c;
    }
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(1024);
    settings.set_unknown_exposure(true);
    settings.add_unknowns("rough_dielectric.index");
    (*settings.mutable_known_within())["rough_dielectric.index"] = kWithin;
    Refinement refinement(settings, observations, {kStart});
    while (!refinement.finished()) refinement.step(model.renderer());
    ASSERT_EQ(refinement.colours(), 3U);
    for (size_t c = 0; c < 3; ++c) {
      const v1::RefineResult r = refinement.result(c);
      of_sigma_t[c] += has(r.sigma_t(), truths[c].sigma_t);
      of_albedo[c] += has(r.albedo(), truths[c].albedo);
    }
    const v1::RefineResult first = refinement.result();
    of_g += has(first.g(), 0.3);
    of_exposure += has(first.exposure(), kExposure);
    of_index += has(first.unknowns(0), index);
    together += first.exposure().standard_deviation() / kImages;
    index_deviation += first.unknowns(0).standard_deviation() / kImages;
    alone += refined(model, {observations[0]}, settings, {kStart}).exposure().standard_deviation() /
             kImages;
  }
  for (const auto& counts : {of_sigma_t, of_albedo, {of_g, of_exposure, of_index}}) {
    expect_covered(counts, kImages);
  }
  EXPECT_LT(together, 0.75 * alone);
  EXPECT_LT(index_deviation, kWithin);
  EXPECT_GT(index_deviation, 0.1 * kWithin);
}

// Three materials, each with a g of its own, in one exposure: all intervals hold.
TEST(Refinement, ColoursMayHaveEachItsOwnG) {
  constexpr int kImages = 60;
  constexpr double kExposure = 2.5;
  const std::array<Material, 3> truths{{{60, 0.8, 0.1}, {80, 0.7, 0.3}, {45, 0.9, 0.6}}};
  const SyntheticModel model;
  std::array<int, 3> of_sigma_t{}, of_g{};
  for (uint64_t i = 0; i < kImages; ++i) {
    std::vector<Observation> observations;
    for (size_t c = 0; c < 3; ++c) {
      observations.push_back(model.observe(truths[c], 0.02, 3 * i + c, kExposure));
      observations.back().colour = c;
    }
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(1024);
    settings.set_unknown_exposure(true);
    settings.set_g_of_each_colour(true);
    Refinement refinement(settings, observations, {kStart});
    while (!refinement.finished()) refinement.step(model.renderer());
    for (size_t c = 0; c < 3; ++c) {
      const v1::RefineResult r = refinement.result(c);
      of_sigma_t[c] += has(r.sigma_t(), truths[c].sigma_t);
      of_g[c] += has(r.g(), truths[c].g);
    }
    const double apart = refinement.result(2).g().value() - refinement.result(0).g().value();
    EXPECT_GT(apart, 0.2);
  }
  expect_covered(of_sigma_t, kImages);
  expect_covered(of_g, kImages);
}

// What a wrong pose does to an image is left out of the material, and its doubt is in the
// intervals; without, they are wrong.
TEST(Refinement, DisturbancesLeaveTheMaterialAlone) {
  constexpr int kImages = 60;
  const SyntheticModel model;
  Gaussian1D gaussian(7);
  std::vector<std::vector<float>> planes(2);
  for (size_t p = 0; p < SyntheticModel::kPixels; ++p) {
    const double u = static_cast<double>(p % SyntheticModel::kSide) / SyntheticModel::kSide;
    planes[0].push_back(static_cast<float>(0.05 * std::sin(6 * u)));
    planes[1].push_back(static_cast<float>(0.04 * u - 0.03));
  }
  std::array<int, 3> inside{};
  int inside_without = 0;
  for (uint64_t i = 0; i < kImages; ++i) {
    Observation observation = model.observe(kTruth, 0.05, 300 + i);
    const std::array<double, 2> amounts{gaussian(), gaussian()};
    for (size_t p = 0; p < SyntheticModel::kPixels; ++p) {
      observation.radiance[p] *=
          static_cast<float>(1 + amounts[0] * planes[0][p] + amounts[1] * planes[1][p]);
    }
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(1024);
    inside_without +=
        has(refined(model, {observation}, settings, {kStart}).sigma_t(), kTruth.sigma_t);
    observation.disturbances = planes;
    const v1::RefineResult r = refined(model, {observation}, settings, {kStart});
    inside[0] += has(r.sigma_t(), kTruth.sigma_t);
    inside[1] += has(r.albedo(), kTruth.albedo);
    inside[2] += has(r.g(), kTruth.g);
    EXPECT_FALSE(r.misfit());
  }
  expect_covered(inside, kImages);
  EXPECT_LT(inside_without, kImages * 3 / 4);
}

// Two photographs in colour are disturbed each by itself, and alike in their colours.
TEST(Refinement, PhotographsHaveDisturbancesOfTheirOwn) {
  constexpr int kImages = 40;
  const std::array<Material, 3> truths{{{60, 0.8, 0.3}, {80, 0.7, 0.3}, {45, 0.9, 0.3}}};
  const SyntheticModel model(0.1);
  std::vector<float> plane;
  for (size_t p = 0; p < SyntheticModel::kPixels; ++p) {
    const double u = static_cast<double>(p % SyntheticModel::kSide) / SyntheticModel::kSide;
    plane.push_back(static_cast<float>(0.05 * std::sin(6 * u)));
  }
  Gaussian1D gaussian(11);
  std::array<int, 3> of_sigma_t{};
  int of_g = 0;
  for (uint64_t i = 0; i < kImages; ++i) {
    std::vector<Observation> observations;
    for (size_t photograph = 0; photograph < 2; ++photograph) {
      const double amount = gaussian();
      for (size_t c = 0; c < 3; ++c) {
        Observation& observation =
            observations.emplace_back(model.observe(truths[c], 0.05, 6 * i + 3 * photograph + c));
        observation.photograph = photograph;
        observation.colour = c;
        observation.disturbances.resize(2);
        observation.disturbances[photograph] = plane;
        for (size_t p = 0; p < SyntheticModel::kPixels; ++p) {
          observation.radiance[p] *= static_cast<float>(1 + amount * plane[p]);
        }
      }
    }
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(1024);
    Refinement refinement(settings, observations, {kStart});
    while (!refinement.finished()) refinement.step(model.renderer());
    for (size_t c = 0; c < 3; ++c) {
      of_sigma_t[c] += has(refinement.result(c).sigma_t(), truths[c].sigma_t);
    }
    of_g += has(refinement.result().g(), 0.3);
  }
  expect_covered(of_sigma_t, kImages);
  expect_covered(std::array{of_g}, kImages);
}

// Multiplies squares of so many pixels a side by a factor each.
void make_squares_off(Observation& observation, size_t side, double off, uint64_t seed) {
  constexpr size_t kSide = SyntheticModel::kSide;
  Gaussian1D gaussian(seed);
  std::vector<double> factors;
  for (size_t b = 0; b < (kSide / side) * (kSide / side); ++b) {
    factors.push_back(1 + off * gaussian());
  }
  for (size_t p = 0; p < observation.radiance.size(); ++p) {
    const size_t block = p / kSide / side * (kSide / side) + p % kSide / side;
    observation.radiance[p] *= static_cast<float>(factors[block]);
  }
}

TEST(Refinement, SquaresOfColoursHangTogether) {
  expect_colours_say_what_one_does(
      80, SyntheticModel(0.03), 0.003,
      [](Observation& observation, uint64_t i) {
        observation.noise.clear();
        make_squares_off(observation, 2, 0.02, 500 + i);
      },
      [](uint64_t i) {
        v1::RefineSettings settings;
        settings.set_seed(i);
        settings.set_max_spp(1024);
        settings.set_block(2);
        return settings;
      });
}

// Intervals know where differences hang together over more than the squares that count as one, of
// half that side.
TEST(Refinement, IntervalsKnowWhatHangsTogetherOverSquares) {
  constexpr int kImages = 100;
  constexpr size_t kAlike = 4;
  const SyntheticModel model(0.03);
  std::array<int, 2> inside{};
  for (uint64_t i = 0; i < kImages; ++i) {
    Observation observation = model.observe(kTruth, 0.003, 100 + i);
    observation.noise.clear();
    make_squares_off(observation, kAlike, 0.02, 500 + i);
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(1024);
    settings.set_block(kAlike / 2);
    const v1::RefineResult r = refined(model, {observation}, settings, {kStart});
    inside[0] += has(r.sigma_t(), kTruth.sigma_t);
    inside[1] += has(r.albedo(), kTruth.albedo);
  }
  for (const int count : inside) EXPECT_GE(count, 0.85 * kImages);
}

// Dust that hides 2 % of the pixels does not change the answer, and is told.
TEST(Refinement, LeavesOutWhatNoMaterialExplains) {
  constexpr int kImages = 100;
  constexpr size_t kSide = SyntheticModel::kSide;
  const SyntheticModel model;
  std::array<int, 3> inside{};
  for (uint64_t i = 0; i < kImages; ++i) {
    Observation observation = model.observe(kTruth, 0.05, 100 + i);
    std::vector<uint32_t> dust;
    for (const size_t corner : {4 * kSide + 5, 13 * kSide + 12}) {
      for (const size_t p : {corner, corner + 1, corner + kSide, corner + kSide + 1}) {
        observation.radiance[p] *= 0.3F;
        dust.push_back(static_cast<uint32_t>(p));
      }
    }
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(1024);
    const std::vector<Observation> observations{observation};
    Refinement refinement(settings, observations, {kStart});
    while (!refinement.finished()) refinement.step(model.renderer());
    const v1::RefineResult r = refinement.result();
    inside[0] += has(r.sigma_t(), kTruth.sigma_t);
    inside[1] += has(r.albedo(), kTruth.albedo);
    inside[2] += has(r.g(), kTruth.g);
    EXPECT_THAT(refinement.unexplained_pixels(0), ::testing::IsSupersetOf(dust));
    EXPECT_LE(refinement.unexplained_pixels(0).size(), 5 * dust.size());
    EXPECT_GT(r.unexplained(), 0.019);
    EXPECT_THAT(r.remarks(), ::testing::Contains(::testing::HasSubstr("dust")));
  }
  expect_covered(inside, kImages);
  const v1::RefineResult clean = refined(model, {model.observe(kTruth, 0.05, 1)}, {}, {kStart});
  EXPECT_EQ(clean.unexplained(), 0);
}

// Half of the images ask for less absorption than none, and for an index below the least. What an
// image cannot tell from none, must not look as if much of it were possible.
TEST(Refinement, IntervalsCoverTheTruthAtTheEndsOfRanges) {
  constexpr int kImages = 200;
  constexpr double kLeastIndex = 1.1;
  constexpr Material kWhite{60, 0.9999, 0.3};
  const SyntheticModel model;
  std::array<int, 4> inside{};
  for (uint64_t i = 0; i < kImages; ++i) {
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(1024);
    settings.add_unknowns("rough_dielectric.index");
    const v1::RefineResult r =
        refined(model, {model.observe(kWhite, 0.05, 100 + i, 1, kLeastIndex)}, settings, {kStart});
    inside[0] += has(r.sigma_t(), kWhite.sigma_t);
    inside[1] += has(r.g(), kWhite.g);
    inside[2] += has(r.albedo(), kWhite.albedo);
    inside[3] += has(r.unknowns(0), kLeastIndex);
    EXPECT_GT(r.albedo().low_95(), 0.8);
  }
  expect_covered(inside, kImages);
}

// Renders whose derivatives are hardly more than noise, as of a thick ball by flash, tell hardly
// what sigma_t is, and must not tell it wrongly, where g is given.
TEST(Refinement, IntervalsCoverTheTruthThoughDerivativesAreNoise) {
  constexpr int kImages = 200;
  constexpr double kNoiseOfSample = 20;
  const SyntheticModel model(kNoiseOfSample);
  std::array<int, 2> inside{};
  for (uint64_t i = 0; i < kImages; ++i) {
    v1::RefineSettings settings;
    settings.set_seed(i);
    settings.set_max_spp(256);
    settings.set_max_iterations(6);
    settings.set_unknown_exposure(true);
    settings.set_expected_g(kTruth.g);
    (*settings.mutable_known_within())["g"] = 1e-4;
    const v1::RefineResult r = refined(model, {model.observe(kTruth, 0.05, 100 + i)}, settings,
                                       {{20, kTruth.albedo, kTruth.g}});
    inside[0] += has(r.sigma_t(), kTruth.sigma_t);
    inside[1] += has(r.sigma_s_reduced(), kTruth.sigma_s_reduced());
  }
  expect_covered(inside, kImages);
}

TEST(Refinement, SeveralImagesTellMore) {
  const SyntheticModel model;
  const v1::RefineResult one = refined(model, {model.observe(kTruth, 0.1, 1)}, {}, {kStart});
  std::vector<Observation> four;
  for (uint64_t i = 0; i < 4; ++i) four.push_back(model.observe(kTruth, 0.1, i));
  const v1::RefineResult all = refined(model, four, {}, {kStart});
  EXPECT_NEAR(all.sigma_t().standard_deviation() / one.sigma_t().standard_deviation(), 0.5, 0.12);
}

TEST(Refinement, NamesTheSimilarityRidge) {
  SyntheticModel model;
  model.make_similar_materials_alike();
  v1::RefineSettings settings;
  settings.set_max_spp(512);
  const v1::RefineResult r =
      refined(model, {model.observe(kTruth, 0.05, 1)}, settings, {{70, 0.75, 0.1}});
  ASSERT_FALSE(r.remarks().empty());
  EXPECT_THAT(r.remarks(0), ::testing::HasSubstr("similarity ridge"));
  // What is known of them is right.
  EXPECT_NEAR(r.sigma_s_reduced().value(), kTruth.sigma_s_reduced(),
              4 * r.sigma_s_reduced().standard_deviation());
  EXPECT_LT(r.sigma_s_reduced().standard_deviation(), 0.1 * kTruth.sigma_s_reduced());
}

TEST(Refinement, SaysThatTooFewPixelsCount) {
  const SyntheticModel model;
  v1::RefineSettings settings;
  settings.set_max_spp(64);
  const auto remarks = [&](uint32_t block) {
    settings.set_block(block);
    std::string all;
    const v1::RefineResult r = refined(model, {model.observe(kTruth, 0.01, 1)}, settings, {kStart});
    for (const std::string& remark : r.remarks()) all += remark;
    return all;
  };
  const char* const few = "too few for the intervals to hold";
  EXPECT_THAT(remarks(1), Not(::testing::HasSubstr(few)));
  // The image has 20 x 20 pixels.
  EXPECT_THAT(remarks(7), ::testing::HasSubstr("9 independent squares of pixels count, for 3"));
}

TEST(Refinement, SaysThatTheSceneIsAnother) {
  const SyntheticModel model;
  Observation observation = model.observe(kTruth, 0.01, 1);
  for (size_t p = 0; p < observation.radiance.size(); p += 2) observation.radiance[p] *= 1.5F;
  v1::RefineSettings settings;
  settings.set_max_spp(512);
  const v1::RefineResult r = refined(model, {observation}, settings, {kStart});
  ASSERT_FALSE(r.remarks().empty());
  EXPECT_THAT(r.remarks(r.remarks_size() - 1), ::testing::HasSubstr("shape, size, light"));
  EXPECT_TRUE(r.misfit());
  // No interval in words.
  for (const std::string& remark : r.remarks()) {
    EXPECT_THAT(remark, Not(::testing::HasSubstr("similarity ridge")));
  }
}

// The best of several starts goes on; one whose loss is higher by more than noise does not.
TEST(Refinement, KeepsTheBestOfSeveralStarts) {
  const SyntheticModel model;
  const std::vector<Observation> observations{model.observe(kTruth, 0.02, 1)};
  v1::RefineSettings settings;
  settings.set_max_spp(512);
  settings.set_max_iterations(4);
  settings.set_method(v1::RefineSettings::ADAM);  // which comes nowhere in 4 iterations
  const v1::RefineResult r =
      refined(model, observations, settings, {{500, 0.2, -0.5}, {61, 0.79, 0.3}, {10, 0.9, 0.9}});
  EXPECT_EQ(r.best_start(), 1U);
  EXPECT_EQ(r.total_iterations(), 12U);
  EXPECT_EQ(starts_around(kStart, 3).size(), 3U);
  EXPECT_NEAR(starts_around(kStart, 3)[0].sigma_t, kStart.sigma_t, 1e-9);
}

TEST(Refinement, AdamComesNearInManyMoreIterations) {
  const SyntheticModel model(0.05);
  v1::RefineSettings settings;
  settings.set_method(v1::RefineSettings::ADAM);
  const std::vector<Observation> observations{model.observe(kTruth, 0.01, 1)};
  const v1::RefineResult adam = refined(model, observations, settings, {kStart});
  EXPECT_EQ(adam.iterations(), 150U);
  EXPECT_NEAR(adam.material().sigma_t(), kTruth.sigma_t, 0.15 * kTruth.sigma_t);
  EXPECT_LE(refined(model, observations, {}, {kStart}).iterations(), 15U);
}

// After each iteration: as a message, and back.
TEST(Refinement, GoesOnFromItsStateBitForBit) {
  const SyntheticModel model;
  const std::vector<Observation> observations{model.observe(kTruth, 0.05, 1),
                                              model.observe(kTruth, 0.05, 2)};
  for (const auto method : {v1::RefineSettings::GAUSS_NEWTON, v1::RefineSettings::ADAM}) {
    v1::RefineSettings settings;
    settings.set_method(method);
    settings.set_unknown_exposure(true);
    settings.add_unknowns("rough_dielectric.index");
    settings.set_max_iterations(12);
    settings.set_max_spp(1024);
    const std::vector<Material> starts = starts_around(kStart, 2);
    v1::RefineResult straight = refined(model, observations, settings, starts);
    std::string state = Refinement(settings, observations, starts).state().SerializeAsString();
    for (bool finished = false; !finished;) {
      v1::RefineState read;
      ASSERT_TRUE(read.ParseFromString(state));
      Refinement refinement(observations, read);
      finished = refinement.finished();
      if (!finished) refinement.step(model.renderer());
      state = refinement.state().SerializeAsString();
    }
    v1::RefineState last;
    ASSERT_TRUE(last.ParseFromString(state));
    v1::RefineResult stopped = Refinement(observations, last).result();
    straight.clear_seconds();
    stopped.clear_seconds();
    EXPECT_EQ(straight.SerializeAsString(), stopped.SerializeAsString());
  }
}

TEST(Refinement, SaysWhatIsWrong) {
  const SyntheticModel model;
  const auto refuse = [&](const std::vector<std::string>& parts, auto change) {
    Observation observation = model.observe(kTruth, 0.05, 1);
    v1::RefineSettings settings;
    std::vector<Material> starts{kStart};
    change(observation, settings, starts);
    expect_error(ErrorKind::kInvalidInput, parts, [&] {
      const std::vector<Observation> observations{observation};
      Refinement(settings, observations, starts);
    });
  };
  refuse({"synthetic", "399 pixels", "20 x 20"},
         [](Observation& o, auto&, auto&) { o.radiance.pop_back(); });
  refuse({"the disturbance has 1 pixels"}, [](Observation& o, auto&, auto&) {
    o.disturbances = {{}, {1}};
  });
  refuse({"the mask has 1 pixels"}, [](Observation& o, auto&, auto&) { o.mask = {1}; });
  refuse({"nan", "pixel (3, 1)"}, [](Observation& o, auto&, auto&) {
    o.radiance[23] = std::numeric_limits<float>::quiet_NaN();
  });
  refuse({"no pixel on the object"},
         [](Observation& o, auto&, auto&) { o.mask.assign(SyntheticModel::kPixels, 0); });
  refuse({"black"}, [](Observation& o, auto&, auto&) { o.radiance.assign(400, 0); });
  refuse({"spp 2"}, [](auto&, v1::RefineSettings& s, auto&) { s.set_spp(2); });
  refuse({"tolerance"}, [](auto&, v1::RefineSettings& s, auto&) { s.set_tolerance(-1); });
  refuse({"light[0].scale cannot be refined", "has no scale of a light"},
         [](auto&, v1::RefineSettings& s, auto&) { s.add_unknowns("light[0].scale"); });
  const auto know = [](v1::RefineSettings& s, const char* name, double deviation) {
    (*s.mutable_known_within())[name] = deviation;
  };
  refuse({"known_within names exposure, which is not found"},
         [&](auto&, v1::RefineSettings& s, auto&) { know(s, "exposure", 0.1); });
  refuse({"known_within names rough_dielectric.index, which is not found"},
         [&](auto&, v1::RefineSettings& s, auto&) { know(s, "rough_dielectric.index", 0.1); });
  refuse({"known_within of exposure is 0"}, [&](auto&, v1::RefineSettings& s, auto&) {
    s.set_unknown_exposure(true);
    know(s, "exposure", 0);
  });
  refuse({"not for ADAM"}, [&](auto&, v1::RefineSettings& s, auto&) {
    s.set_method(v1::RefineSettings::ADAM);
    s.set_unknown_exposure(true);
    know(s, "exposure", 0.1);
  });
  refuse({"no image shows colour 0"}, [](Observation& o, auto&, auto&) { o.colour = 1; });
  refuse({"no material"}, [](auto&, auto&, std::vector<Material>& m) { m.clear(); });
  refuse({"albedo"}, [](auto&, auto&, std::vector<Material>& m) { m[0].albedo = 2; });
  refuse({"sigma_t"}, [](auto&, auto&, std::vector<Material>& m) { m[0].sigma_t = 1e5; });
}

TEST(Refinement, RefusesAStateOfOthers) {
  const SyntheticModel model;
  const std::vector<Observation> ours{model.observe(kTruth, 0.05, 1)};
  const std::vector<Observation> other{model.observe(kTruth, 0.05, 2)};
  Refinement refinement({}, ours, {kStart});
  refinement.step(model.renderer());
  expect_error(ErrorKind::kInvalidInput, {"other images"},
               [&] { Refinement(other, refinement.state()); });
  v1::RefineState damaged = refinement.state();
  damaged.mutable_starts(0)->mutable_gradient()->RemoveLast();
  expect_error(ErrorKind::kInvalidInput, {"damaged"}, [&] { Refinement(ours, damaged); });
}

}  // namespace
}  // namespace itn
