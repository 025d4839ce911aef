// Lights as they are described: what the light sources are compiled from.
#pragma once

#include <string>
#include <variant>
#include <vector>

#include "server/tracer/lights/constant.h"
#include "server/tracer/lights/directional.h"

namespace itn::tracer {

// Which part of coloured lights is rendered.
enum class Channel { kLuminance, kRed, kGreen, kBlue };

// Clear sky of Hosek and Wilkie with a sun of constant radiance over its disc.
struct SunSkyLight {
  double turbidity = 3;              // [1, 10]
  double ground_albedo = 0.15;       // [0, 1]
  double sun_elevation = 1.0471976;  // [0, pi/2]
  double sun_azimuth = 0;            // 0 is -z, pi/2 is +x
  double sun_angular_radius = 0.00465;
  double sun_scale = 1;
  double sky_scale = 1;
};

// Latitude-longitude panorama, u = atan2(x, -z) / 2 pi, v = acos(y) / pi, bilinear.
struct EnvironmentMapLight {
  int width = 0;
  int height = 0;
  std::vector<float> rgb;  // 3 * width * height, top row first
  double scale = 1;
  double rotate_y = 0;
  // Of the pixels, for scenes that share them; empty: not shared.
  std::string digest = {};
};

using LightDescription =
    std::variant<SunSkyLight, EnvironmentMapLight, ConstantLight, DirectionalLight>;

}  // namespace itn::tracer
