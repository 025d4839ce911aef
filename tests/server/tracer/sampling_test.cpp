// Random numbers, the phase function and the lights: each density integrates to 1 and is the one
// that is sampled from.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <numbers>
#include <sstream>
#include <tuple>
#include <vector>

#include "common/error.h"
#include "common/low_discrepancy.h"
#include "server/tracer/lights/lights.h"
#include "server/tracer/lights/sky_model.h"
#include "server/tracer/random/sampler.h"
#include "tests/server/tracer/lane_probes.h"
#include "tests/server/tracer/scenes.h"
#include "tests/support/paths.h"

namespace itn::testing {
namespace {

using namespace tracer;
constexpr double kPi = std::numbers::pi;

// The known answers that the authors publish with Philox.
TEST(PhiloxTest, KnownAnswers) {
  using Counter = std::array<uint32_t, 4>;
  EXPECT_EQ(philox({0, 0, 0, 0}, {0, 0}),
            (Counter{0x5f6fb709, 0x0d893f64, 0x4f121f81, 0x4f730a48}));
  EXPECT_EQ(philox({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}),
            (Counter{0x5207ddc2, 0x45165e59, 0x4d8ee751, 0x8c52f662}));
  EXPECT_EQ(philox({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}),
            (Counter{0x4dfccaba, 0x190a87f0, 0xc47362ba, 0xb6b5242a}));

  EXPECT_EQ(philox<10>({0, 0, 0, 0}, {0, 0}),
            (Counter{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}));
  EXPECT_EQ(philox<10>({0xffffffff, 0xffffffff, 0xffffffff, 0xffffffff}, {0xffffffff, 0xffffffff}),
            (Counter{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}));
  EXPECT_EQ(philox<10>({0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}, {0xa4093822, 0x299f31d0}),
            (Counter{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}));
}

TEST(SamplerTest, LanesDrawTheSameNumbers) {
  std::array<FloatColumn, 5> uniforms;
  for (const uint64_t seed : {uint64_t{1}, uint64_t{0xfedcba9876543210}}) {
    for (const uint32_t vertex : {0U, 7U, 0xffffffffU}) {
      draw_uniforms(seed, 12345, vertex, Sampler::kShadowRay, uniforms);
      for (uint32_t i = 0; i < kSlots; ++i) {
        const Uniforms expected = Sampler(seed, 12345, i).uniforms(vertex, Sampler::kShadowRay);
        for (size_t k = 0; k < 5; ++k) ASSERT_EQ(uniforms[k][i], expected[k]) << i << ", u" << k;
      }
    }
  }
}

TEST(SamplerTest, EveryCoordinateOfTheCounterMatters) {
  const Uniforms u = Sampler(1, 2, 3).uniforms(4, 5);
  EXPECT_NE(u, Sampler(9, 2, 3).uniforms(4, 5));
  EXPECT_NE(u, Sampler(uint64_t{1} << 32 | 1, 2, 3).uniforms(4, 5));
  EXPECT_NE(u, Sampler(1, 9, 3).uniforms(4, 5));
  EXPECT_NE(u, Sampler(1, 2, 9).uniforms(4, 5));
  EXPECT_NE(u, Sampler(1, 2, 3).uniforms(9, 5));
  EXPECT_NE(u, Sampler(1, 2, 3).uniforms(4, 9));
  for (const float v : u) {
    EXPECT_GE(v, 0.0F);
    EXPECT_LT(v, 1.0F);
  }
}

// A phase function, and by slot the derivative of its mean cosine.
struct PhaseRow {
  PhaseFunction phase;
  double legendre;  // the mean of P2(cos)
  std::vector<double> slopes;
};

void PrintTo(const PhaseRow& row, std::ostream* out) {
  *out << "kind " << row.phase.index() << ", second moment " << row.legendre;
}

class PhaseTest : public ::testing::TestWithParam<PhaseRow> {
 protected:
  void probe(PhaseProbe& probe) const { probe_phase(GetParam().phase, probe); }
  double mean_cosine() const {
    return std::visit([](const auto& kind) { return kind.mean_cosine(); }, GetParam().phase);
  }
};

// By the midpoint rule in cos_theta, fine enough for the peak at |g| = 0.99.
TEST_P(PhaseTest, IsNormalisedAndHasItsMeanCosine) {
  constexpr int kSteps = 4000 * static_cast<int>(kSlots);
  const auto point = [](int i) { return static_cast<float>(-1 + 2 * (i + 0.5) / kSteps); };
  double norm = 0, mean = 0;
  PhaseProbe probed;
  for (int first = 0; first < kSteps; first += static_cast<int>(kSlots)) {
    for (size_t i = 0; i < kSlots; ++i) probed.cosine[i] = point(first + static_cast<int>(i));
    probe(probed);
    for (size_t i = 0; i < kSlots; ++i) {
      const double part = 2 * kPi * double{probed.value[i]} * 2 / kSteps;
      norm += part;
      mean += part * double{probed.cosine[i]};
    }
  }
  EXPECT_NEAR(norm, 1, 2e-3);
  EXPECT_NEAR(mean, mean_cosine(), 2e-3);
}

// The first two moments of the samples: E cos and E P2(cos), of Henyey and Greenstein's g and g^2
// (Legendre moments). A score has expectation 0 and, by parts, E(score cos) = d E cos / d slot.
TEST_P(PhaseTest, SamplesFollowTheDensity) {
  const std::vector<double>& slopes = GetParam().slopes;
  std::vector<double> cosine, legendre;
  std::vector<std::vector<double>> score(slopes.size()), score_cosine(slopes.size());
  PhaseProbe probed;
  for (uint32_t batch = 0; batch < 800; ++batch) {
    for (uint32_t i = 0; i < kSlots; ++i) {
      probed.u[i] = Sampler(1, 0, batch).uniforms(i / 4, 0)[i % 4];
    }
    probe(probed);
    probed.cosine = probed.drawn;
    probe(probed);
    for (size_t i = 0; i < kSlots; ++i) {
      const double c = double{probed.cosine[i]};
      cosine.push_back(c);
      legendre.push_back(1.5 * c * c - 0.5);
      for (size_t s = 0; s < slopes.size(); ++s) {
        score[s].push_back(double{probed.scores[s][i]});
        score_cosine[s].push_back(score[s].back() * c);
      }
    }
  }
  constexpr int kComparisons = 8 * 12;
  expect_equal(over_batches(cosine), {mean_cosine(), 0}, kComparisons, "cos");
  expect_equal(over_batches(legendre), {GetParam().legendre, 0}, kComparisons, "P2");
  for (size_t s = 0; s < slopes.size(); ++s) {
    expect_equal(over_batches(score[s]), {0, 0}, kComparisons, "score");
    expect_equal(over_batches(score_cosine[s]), {slopes[s], 0}, kComparisons, "score cos");
  }
}

// Adds to one slot of a phase function.
struct SlotAdder {
  size_t number;
  float by;
  void slot(const char* /*name*/, float& value, double /*low*/, double /*high*/) {
    if (number-- == 0) value += by;
  }
};
PhaseFunction moved(PhaseFunction phase, size_t slot, float by) {
  SlotAdder fields{slot, by};
  std::visit([&]<typename Kind>(Kind& kind) { Kind::fields(kind, fields); }, phase);
  return phase;
}

TEST_P(PhaseTest, ScoresAreTheDerivativesOfTheLogarithm) {
  constexpr float kStep = 1e-3F;
  const std::vector<float> cosines = {-1.0F, -0.3F, 0.0F, 0.5F, 0.9F};
  PhaseProbe at, above, below;
  for (PhaseProbe* probe : {&at, &above, &below}) {
    std::ranges::copy(cosines, probe->cosine.begin());
  }
  probe(at);
  for (size_t s = 0; s < GetParam().slopes.size(); ++s) {
    probe_phase(moved(GetParam().phase, s, kStep), above);
    probe_phase(moved(GetParam().phase, s, -kStep), below);
    for (size_t i = 0; i < cosines.size(); ++i) {
      const double slope = (std::log(double{above.value[i]}) - std::log(double{below.value[i]})) /
                           (2 * double{kStep});
      EXPECT_NEAR(double{at.scores[s][i]}, slope, 0.01 * std::max(1.0, std::abs(slope)))
          << "slot " << s << ", cos_theta " << cosines[i];
    }
  }
}

PhaseRow henyey_greenstein(double g) {
  return {HenyeyGreenstein{static_cast<float>(g)}, g * g, {1}};
}
PhaseRow two_term(double g_1, double g_2, double weight) {
  return {TwoTerm{static_cast<float>(g_1), static_cast<float>(g_2), static_cast<float>(weight)},
          weight * g_1 * g_1 + (1 - weight) * g_2 * g_2,
          {weight, 1 - weight, g_1 - g_2}};
}

// E cos = coth kappa - 1 / kappa = m and E cos^2 = 1 - 2 m / kappa.
PhaseRow von_mises_fisher(double kappa) {
  const double m = 1 / std::tanh(kappa) - 1 / kappa;
  return {VonMisesFisher{static_cast<float>(kappa)},
          1 - 3 * m / kappa,
          {1 / (kappa * kappa) - 1 / std::pow(std::sinh(kappa), 2)}};
}

INSTANTIATE_TEST_SUITE_P(
    Kinds, PhaseTest,
    ::testing::Values(henyey_greenstein(-0.9), henyey_greenstein(-0.5), henyey_greenstein(0),
                      henyey_greenstein(1e-6), henyey_greenstein(0.01), henyey_greenstein(0.4),
                      henyey_greenstein(0.8), henyey_greenstein(0.98), two_term(0.8, -0.3, 0.9),
                      two_term(0.6, 0.1, 0.3), two_term(0.5, -0.5, 0.01), von_mises_fisher(0.05),
                      von_mises_fisher(1), von_mises_fisher(8), von_mises_fisher(40)));

// Evaluated cases of the published model: turbidity, ground albedo, sun elevation, theta, gamma,
// RGB.
struct SkyCase {
  double turbidity, ground_albedo, elevation, theta, gamma;
  Rgb rgb;
};

void expect_sky(const SkyCase& c) {
  const Rgb rgb =
      Sky(c.turbidity, c.ground_albedo, c.elevation).radiance(std::cos(c.theta), c.gamma);
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(rgb[i] / c.rgb[i], 1, 2e-6) << "turbidity " << c.turbidity << ", channel " << i;
  }
}

TEST(SkyTest, EqualsThePublishedModel) {
  expect_sky({3,
              0.569203875,
              1.22119374,
              0.0978155739,
              0.260739602,
              {8.95712236, 11.8170925, 17.8378512}});
  expect_sky({7.848662,
              0.472245244,
              0.625257465,
              0.32542995,
              0.971002413,
              {5.28522091, 7.11761842, 10.1789664}});
  expect_sky({9.03985338,
              0.389808807,
              0.946487575,
              1.18909433,
              1.58164428,
              {10.3024681, 12.9571583, 17.6647288}});
}

TEST(SkyTest, EqualsTheCheckFile) {
  const char* folder = std::getenv("ITN_VALIDATION_DATA");
  const std::string path = std::string(folder != nullptr ? folder : source("../shared/data")) +
                           "/hosek_wilkie_rgb_check.csv";
  std::ifstream file(path);
  if (!file) GTEST_SKIP() << "no validation data at " << path << " (set ITN_VALIDATION_DATA)";
  std::string line;
  std::getline(file, line);
  int cases = 0;
  while (std::getline(file, line)) {
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream in(line);
    SkyCase c{};
    in >> c.turbidity >> c.ground_albedo >> c.elevation >> c.theta >> c.gamma >> c.rgb[0] >>
        c.rgb[1] >> c.rgb[2];
    expect_sky(c);
    ++cases;
  }
  EXPECT_EQ(cases, 100);
}

// The renderer's table of the sky against the model: within 0.3 % on the average of every band of
// height, and in places but for the last degree above the horizon and the sun's centre.
TEST(SkyTest, TheTableFollowsTheModel) {
  const SunSkyLight light{.sun_elevation = 0.8, .sun_azimuth = 0.4, .sun_scale = 0};
  const Lights lights({light}, Channel::kGreen);
  const Sky sky(light.turbidity, light.ground_albedo, light.sun_elevation);
  const Vec3d sun{std::sin(0.4) * std::cos(0.8), std::sin(0.8), -std::cos(0.4) * std::cos(0.8)};
  double worst = 0;
  for (double elevation = 1.5; elevation < 90; elevation += 1.7) {
    double table_sum = 0, model_sum = 0;
    for (double azimuth = 0; azimuth < 360; azimuth += 0.77) {
      const double e = elevation * kPi / 180, a = azimuth * kPi / 180;
      const Vec3d d{std::sin(a) * std::cos(e), std::sin(e), -std::cos(a) * std::cos(e)};
      const double gamma = std::acos(std::min(1.0, dot(d, sun)));
      const double model = sky.radiance(d.y, gamma)[1];
      const double table = lights.radiance(static_cast<Vec3f>(d));
      table_sum += table;
      model_sum += model;
      if (gamma > 0.02) worst = std::max(worst, std::abs(table / model - 1));
    }
    EXPECT_NEAR(table_sum / model_sum, 1, 3e-3) << "elevation " << elevation;
  }
  EXPECT_LT(worst, 3e-3);
}

// On a clear day with a high sun, direct light outweighs the sky some four to eight times; it is
// reddened by the air, the more the lower it stands.
TEST(SunTest, IsPlausible) {
  const Rgb high = sun_irradiance(3, kPi / 3), low = sun_irradiance(3, 0.1);
  EXPECT_NEAR(luminance(high), 130, 30);  // about 90 klx / (683 lm/W)
  EXPECT_GT(low[0] / low[2], 2 * high[0] / high[2]);
  EXPECT_LT(luminance(low), luminance(high) / 2);
}

EnvironmentMapLight checkered_map() {
  EnvironmentMapLight map;
  map.width = 6;
  map.height = 4;
  for (int i = 0; i < map.width * map.height; ++i) {
    const float v = (i * 7 % 5) == 0 ? 0.0F : static_cast<float>(i % 7);
    map.rgb.insert(map.rgb.end(), {v, v, v});
  }
  map.rotate_y = 0.7;
  return map;
}

struct LightRow {
  const char* name;
  LightDescription light;
};

void PrintTo(const LightRow& row, std::ostream* out) {
  *out << row.name;
}

class LightTest : public ::testing::TestWithParam<LightRow> {};

Vec3f uniform_direction(const Uniforms& u) {
  const float y = 1 - 2 * u[0], r = std::sqrt(std::max(0.0F, 1 - y * y));
  const float phi = 2 * static_cast<float>(kPi) * u[1];
  return {r * std::sin(phi), y, -r * std::cos(phi)};
}

// Over uniform directions, the density integrates to 1 and the radiance to the power; over sampled
// ones, the weight (radiance over density) has the power as its mean, and weighting a smooth
// function gives its integral against the radiance.
TEST_P(LightTest, SamplesFollowTheDensity) {
  const Lights lights({GetParam().light}, Channel::kLuminance);
  const auto smooth = [](Vec3f d) {
    return 1 + 0.5 * double{d.x} + 0.3 * double{d.y} * double{d.z};
  };
  std::vector<double> density, power, moment, sampled_power, sampled_moment;
  for (uint32_t i = 0; i < 400'000; ++i) {
    const Uniforms u = Sampler(3, 0, 0).uniforms(i, 0);
    const Vec3f d = uniform_direction(u);
    density.push_back(4 * kPi * double{lights.pdf(d)});
    power.push_back(4 * kPi * double{lights.radiance(d)});
    moment.push_back(power.back() * smooth(d));
    const Sampler sampler(3, 0, 0);
    const LightSample sample = lights.sample({}, sampler.words(i, 1), sampler.words(i, 2));
    EXPECT_NEAR(length(sample.direction), 1, 1e-5);
    sampled_power.push_back(sample.weight);
    sampled_moment.push_back(double{sample.weight} * smooth(sample.direction));
  }
  constexpr int kComparisons = 4 * 4;
  const std::string name = GetParam().name;
  if (std::string(name) != "constant") {  // whose density has no noise
    expect_equal(over_batches(density), {1, 0}, kComparisons, name + ", density");
    expect_equal(over_batches(sampled_power), over_batches(power), kComparisons, name + ", power");
  } else {
    EXPECT_NEAR(over_batches(density).mean, 1, 1e-6);
    EXPECT_NEAR(over_batches(sampled_power).mean, over_batches(power).mean, 1e-4);
  }
  expect_equal(over_batches(sampled_moment), over_batches(moment), kComparisons, name + ", moment");
  EXPECT_NEAR(over_batches(power).mean, lights.power(), 0.03 * lights.power());
}

INSTANTIATE_TEST_SUITE_P(
    Kinds, LightTest,
    ::testing::Values(LightRow{"sun and sky", paper_sun_sky(1.0)},
                      LightRow{"sky", SunSkyLight{.sun_elevation = 0.3, .sun_scale = 0}},
                      LightRow{"map", checkered_map()}, LightRow{"constant", ConstantLight{2}}));

// Many directions at a time and one alone: the same bits.
TEST_P(LightTest, EveryLaneIsTheSame) {
  const Lights lights({GetParam().light}, Channel::kLuminance);
  const auto probe = std::make_unique<LightProbe>();
  for (uint32_t batch = 0; batch < 20; ++batch) {
    for (uint32_t i = 0; i < kSlots; ++i) {
      probe->direction.set(i, uniform_direction(Sampler(4, 0, batch).uniforms(i, 0)));
    }
    evaluate_lights(lights, *probe, kSlots);
    for (uint32_t i = 0; i < kSlots; ++i) {
      const Vec3f d = probe->direction.at(i);
      ASSERT_EQ(probe->radiance[i], lights.radiance(d));
      ASSERT_EQ(probe->pdf[i], lights.pdf(d));
    }
    sample_lights(lights, 100 + batch, *probe, kSlots);
    for (uint32_t i = 0; i < kSlots; ++i) {
      const Sampler sampler(100 + batch, 0, i);
      const LightSample sample = lights.sample({}, sampler.words(0, 0), sampler.words(0, 1));
      ASSERT_EQ(probe->direction.at(i), sample.direction);
      ASSERT_EQ(probe->pdf[i], sample.pdf);
      ASSERT_EQ(sample.pdf, lights.pdf(sample.direction));
    }
  }
}

// Bilinear between the middles of the pixels, around the turn and up to the first and last row.
TEST(EnvironmentMapTest, IsInterpolatedBetweenItsPixels) {
  const EnvironmentMapLight map = checkered_map();
  const Lights lights({map}, Channel::kGreen);
  const auto pixel = [&](double column, double row) {
    const int c = (static_cast<int>(column) + map.width) % map.width;
    const int r = std::clamp(static_cast<int>(row), 0, map.height - 1);
    return double{map.rgb[3 * (static_cast<size_t>(r) * map.width + c) + 1]};
  };
  for (uint32_t i = 0; i < 10'000; ++i) {
    const Vec3f d = uniform_direction(Sampler(6, 0, 0).uniforms(i, 0));
    const double azimuth = std::atan2(double{d.x}, -double{d.z}) + map.rotate_y;
    const double turns = azimuth / (2 * kPi) - std::floor(azimuth / (2 * kPi));
    const double x = turns * map.width - 0.5;
    const double y = std::acos(double{d.y}) / kPi * map.height - 0.5;
    const double c = std::floor(x), r = std::floor(y);
    const double upper = std::lerp(pixel(c, r), pixel(c + 1, r), x - c);
    const double lower = std::lerp(pixel(c, r + 1), pixel(c + 1, r + 1), x - c);
    ASSERT_NEAR(lights.radiance(d), std::lerp(upper, lower, y - r), 1e-4) << i;
  }
}

// Point `index` of the sequence of three scrambles.
std::array<float, 3> scrambled_point(uint32_t index, const std::array<uint32_t, 3>& scrambles) {
  const std::array<uint32_t, 3> point = sobol_point(index);
  std::array<float, 3> result{};
  for (size_t i = 0; i < result.size(); ++i) {
    result[i] = scrambled_coordinate(point[i], scrambles[i]);
  }
  return result;
}

// Every prefix of a power of two has one point in each of as many equal intervals, in each
// dimension, whatever the scrambles.
TEST(LowDiscrepancyTest, PrefixesAreStratified) {
  for (uint32_t seed = 0; seed < 20; ++seed) {
    for (const uint32_t n : {4U, 64U, 1024U}) {
      std::array<std::vector<int>, 3> count;
      count.fill(std::vector<int>(n));
      for (uint32_t i = 0; i < n; ++i) {
        const auto point = scrambled_point(i, {seed, seed * 0x9E3779B9, ~seed});
        for (size_t dimension = 0; dimension < 3; ++dimension) {
          ++count[dimension][static_cast<size_t>(point[dimension] * static_cast<float>(n))];
        }
      }
      for (const auto& intervals : count) EXPECT_EQ(intervals, std::vector<int>(n, 1));
    }
  }
}

// The mean of one point over many scrambles is that of a uniform number, as is its square.
TEST(LowDiscrepancyTest, PointsAreUniform) {
  std::array<std::vector<double>, 3> values, squares;
  for (uint32_t i = 0; i < 40'000; ++i) {
    const auto key = philox({i, 0, 0, 0}, {1, 2});
    const auto point = scrambled_point(5, {key[0], key[1], key[2]});
    for (size_t dimension = 0; dimension < 3; ++dimension) {
      values[dimension].push_back(point[dimension]);
      squares[dimension].push_back(double{point[dimension]} * point[dimension]);
    }
  }
  for (size_t dimension = 0; dimension < 3; ++dimension) {
    expect_equal(over_batches(values[dimension]), {0.5, 0}, 6, "mean");
    expect_equal(over_batches(squares[dimension]), {1.0 / 3, 0}, 6, "mean square");
  }
}

// The sun's power does not depend on its angle, and its disc has the radiance that makes it so.
TEST(LightsTest, AWiderSunIsDimmer) {
  const auto sun = [](double radius) {
    return Lights({SunSkyLight{.sun_angular_radius = radius, .sky_scale = 0}}, Channel::kLuminance);
  };
  const double expected = luminance(sun_irradiance(3, SunSkyLight{}.sun_elevation));
  for (const double radius : {0.00465, 0.05, 0.327}) {
    EXPECT_NEAR(sun(radius).power(), expected, 1e-9 * expected);
    const double elevation = SunSkyLight{}.sun_elevation;
    const Vec3f centre{0, static_cast<float>(std::sin(elevation)),
                       static_cast<float>(-std::cos(elevation))};
    EXPECT_NEAR(sun(radius).radiance(centre), expected / (2 * kPi * (1 - std::cos(radius))),
                1e-3 * expected / (kPi * radius * radius));
  }
}

TEST(LightsTest, ADirectionalLightMayBeADisc) {
  const Lights disc({DirectionalLight{{0, 2, 0}, 3, 0.2}}, Channel::kLuminance);
  EXPECT_NEAR(disc.power(), 3, 1e-9);
  const double expected = 3 / (2 * kPi * (1 - std::cos(0.2)));
  EXPECT_NEAR(disc.radiance(Vec3f{0, 1, 0}), expected, 1e-4 * expected);
  EXPECT_EQ(disc.radiance(Vec3f{std::sin(0.21F), std::cos(0.21F), 0}), 0);
  EXPECT_EQ(Lights({DirectionalLight{{0, 2, 0}, 3}}, Channel::kLuminance).radiance(Vec3f{0, 1, 0}),
            0);
}

// Azimuth 0 is -z and 90 degrees +x; maps have +y on top, -z at the left edge, +x at a quarter.
TEST(LightsTest, OrientationIsMitsubas) {
  SunSkyLight east{.sun_elevation = 0.5, .sun_azimuth = kPi / 2, .sky_scale = 0};
  const Lights sun({east}, Channel::kLuminance);
  EXPECT_GT(sun.radiance(Vec3f{std::cos(0.5F), std::sin(0.5F), 0}), 0);
  EXPECT_EQ(sun.radiance(Vec3f{0, std::sin(0.5F), -std::cos(0.5F)}), 0);

  EnvironmentMapLight map;
  map.width = 4;
  map.height = 2;
  map.rgb.assign(3 * 8, 0);
  map.rgb[3 * 0] = 1;  // red in the top row, first quarter of the turn: azimuth 45 degrees
  const Vec3f there = itn::normalize(Vec3f{1, std::sqrt(2.0F), -1});
  EXPECT_NEAR(Lights({map}, Channel::kRed).radiance(there), 1, 1e-3);
  map.rotate_y = kPi / 2;  // counter-clockwise seen from above: from +x towards -z, and on to -x
  const Vec3f turned = itn::normalize(Vec3f{-1, std::sqrt(2.0F), -1});
  EXPECT_NEAR(Lights({map}, Channel::kRed).radiance(turned), 1, 1e-3);
}

TEST(LightsTest, RefusesBadNumbers) {
  EnvironmentMapLight negative = checkered_map();
  negative.rgb[5] = -1;
  EnvironmentMapLight short_map = checkered_map();
  short_map.rgb.pop_back();
  const std::vector<LightDescription> bad = {SunSkyLight{.turbidity = 11},
                                             SunSkyLight{.sun_elevation = -0.1},
                                             ConstantLight{-1},
                                             ConstantLight{std::nan("")},
                                             DirectionalLight{{0, 0, 0}, 1},
                                             negative,
                                             short_map,
                                             ConstantLight{0}};
  for (size_t i = 0; i < bad.size(); ++i) {
    EXPECT_THROW(Lights({bad[i]}, Channel::kLuminance), Error) << "row " << i;
  }
}

}  // namespace
}  // namespace itn::testing
