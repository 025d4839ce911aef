#include "server/tracer/lights/sun_sky_irradiance.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/angle.h"
#include "server/tracer/lights/lights.h"
#include "server/tracer/random/sampler.h"

namespace itn::testing {
namespace {

using namespace tracer;

struct MonteCarlo {
  double mean, standard_error;
};

// By directions that the tracer draws.
MonteCarlo irradiance_by_chance(const SunSkyLight& light, Channel channel) {
  const Lights lights({light}, channel);
  constexpr int kSamples = 200'000;
  const Sampler sampler(1, 0, 0);
  double sum = 0, squares = 0;
  for (uint32_t i = 0; i < kSamples; ++i) {
    const LightSample sample = lights.sample({}, sampler.words(i, 0), sampler.words(i, 1));
    const double value = static_cast<double>(sample.weight) * std::max(0.0F, sample.direction.y);
    sum += value;
    squares += value * value;
  }
  const double mean = sum / kSamples;
  return {mean, std::sqrt((squares / kSamples - mean * mean) / kSamples)};
}

struct Day {
  double turbidity, elevation_degrees, radius_degrees;
};

// Low suns, which the horizon cuts, and high ones, narrow and wide.
TEST(SunSkyIrradiance, IsWhatTheTracerShows) {
  for (const Day day : {Day{3, 60, 18.75}, Day{2, 10, 1}, Day{8, 85, 20}, Day{1.5, 0, 5},
                        Day{5, 15, 40}, Day{10, 40, 0.2665}}) {
    for (const Channel channel : {Channel::kLuminance, Channel::kBlue}) {
      const SunSkyLight light{.turbidity = day.turbidity,
                              .sun_elevation = day.elevation_degrees * kRadiansPerDegree,
                              .sun_azimuth = 1,
                              .sun_angular_radius = day.radius_degrees * kRadiansPerDegree};
      const MonteCarlo shown = irradiance_by_chance(light, channel);
      // 4.5 standard errors, and what the tables of the tracer and the quadrature may be off.
      EXPECT_NEAR(irradiance_from_above(light, channel), shown.mean,
                  4.5 * shown.standard_error + 0.001 * shown.mean)
          << "elevation " << day.elevation_degrees;
    }
  }
}

TEST(SunSkyIrradiance, SunAndSkyAreScaledByThemselves) {
  SunSkyLight light;
  const double both = irradiance_from_above(light, Channel::kLuminance);
  light.sun_scale = 0;
  const double sky = irradiance_from_above(light, Channel::kLuminance);
  light.sun_scale = 3;
  light.sky_scale = 2;
  EXPECT_NEAR(irradiance_from_above(light, Channel::kLuminance), 3 * (both - sky) + 2 * sky,
              1e-9 * both);
}

}  // namespace
}  // namespace itn::testing
