#include "server/tracer/lights/sun_sky.h"

#include <cmath>

namespace itn::tracer {

std::tuple<SkyLight, SunDisc> SunSkyLight::compile(const LightFrame& frame) const {
  const auto table = frame.table<SkyTable>(
      part_key("sky", turbidity, ground_albedo, sun_elevation, frame.channel), [&] {
        return std::make_shared<const SkyTable>(turbidity, ground_albedo, sun_elevation,
                                                frame.channel);
      });
  const double cos_elevation = std::cos(sun_elevation);
  const Vec3d sun{std::sin(sun_azimuth) * cos_elevation, std::sin(sun_elevation),
                  -std::cos(sun_azimuth) * cos_elevation};
  return {SkyLight(table, turned_back(sun_azimuth).after(frame.pose.rotation), sky_scale),
          SunDisc(frame.pose.rotation.inverse()(sun), sun_angular_radius,
                  sun_scale * table->sun_irradiance(), table->sun_colours())};
}

}  // namespace itn::tracer
