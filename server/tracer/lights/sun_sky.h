// Clear sky of Hosek and Wilkie with a sun of constant radiance over its disc.
#pragma once

#include <tuple>

#include "common/angle.h"
#include "server/tracer/lights/light_frame.h"
#include "server/tracer/lights/sky.h"
#include "server/tracer/lights/sun_disc.h"

namespace itn::tracer {

struct SunSkyLight {
  double turbidity = 3;
  double ground_albedo = 0.15;
  double sun_elevation = 60 * kRadiansPerDegree;
  double sun_azimuth = 0;  // 0 is -z, pi/2 is +x
  double sun_angular_radius = 0.2665 * kRadiansPerDegree;
  double sun_scale = 1;
  double sky_scale = 1;

  static constexpr const char* kName = "sun_sky";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.number("turbidity", self.turbidity, 1, 10);
    to.number("ground_albedo", self.ground_albedo, 0, 1);
    to.angle("sun_elevation_degrees", self.sun_elevation, 0, 90);
    to.angle("sun_azimuth_degrees", self.sun_azimuth);
    to.angle("sun_angular_radius_degrees", self.sun_angular_radius, 0.1, 45);
    to.number("sun_scale", self.sun_scale, 0, 1e6);
    to.number("sky_scale", self.sky_scale, 0, 1e6);
  }
  std::tuple<SkyLight, SunDisc> compile(const LightFrame& frame) const;
};

}  // namespace itn::tracer
