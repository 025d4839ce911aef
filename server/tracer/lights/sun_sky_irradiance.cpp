#include "server/tracer/lights/sun_sky_irradiance.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/tracer/lights/sky_model.h"

namespace itn::tracer {
namespace {

// The mean of f over [0, 1] by the midpoint rule.
template <typename F>
double mean(int count, const F& f) {
  double sum = 0;
  for (int i = 0; i < count; ++i) sum += f((i + 0.5) / count);
  return sum / count;
}

// The integral of L cos(theta) over the upper hemisphere. With y = cos(theta) = s (2 - s), which
// straightens the sky's rise towards the horizon, d omega = 2 (1 - s) ds d phi; the sky is the same
// on both sides of the sun.
double sky_irradiance(const SunSkyLight& light, Channel channel) {
  constexpr int kHeights = 48, kAzimuths = 32;
  const Sky sky(light.turbidity, light.ground_albedo, light.sun_elevation);
  const double sun_y = std::sin(light.sun_elevation), sun_r = std::cos(light.sun_elevation);
  return 2 * std::numbers::pi * mean(kHeights, [&](double s) {
           const double y = s * (2 - s), r = std::sqrt(1 - y * y);
           return 2 * (1 - s) * y * mean(kAzimuths, [&](double u) {
                    const double cos_gamma = y * sun_y + r * sun_r * std::cos(std::numbers::pi * u);
                    return select(sky.radiance(y, std::acos(std::clamp(cos_gamma, -1.0, 1.0))),
                                  channel);
                  });
         });
}

// The integral of max(0, y) over the circle of directions at an angle psi from the sun, along which
// y = a + b cos(phi).
double height_around(double sun_elevation, double psi) {
  const double a = std::sin(sun_elevation) * std::cos(psi);
  const double b = std::cos(sun_elevation) * std::sin(psi);
  const double phi = std::acos(b > 0 ? std::clamp(-a / b, -1.0, 1.0) : -1.0);  // where y = 0
  return 2 * (a * phi + b * std::sin(phi));
}

// The irradiance of a disc of one radiance, which the horizon may cut.
double sun_irradiance_from_above(const SunSkyLight& light, Channel channel) {
  constexpr int kCircles = 64;
  const double radius = light.sun_angular_radius;
  const double solid_angle = 4 * std::numbers::pi * std::pow(std::sin(radius / 2), 2);
  const double facing = select(sun_irradiance(light.turbidity, light.sun_elevation), channel);
  return facing / solid_angle * radius * mean(kCircles, [&](double u) {
           return height_around(light.sun_elevation, u * radius) * std::sin(u * radius);
         });
}

}  // namespace

double irradiance_from_above(const SunSkyLight& light, Channel channel) {
  return light.sky_scale * sky_irradiance(light, channel) +
         light.sun_scale * sun_irradiance_from_above(light, channel);
}

}  // namespace itn::tracer
