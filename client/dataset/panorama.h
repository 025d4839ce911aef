// Panoramas in latitude-longitude format (EnvironmentMap in scene.proto) as datasets make and keep
// them.
#pragma once

#include <cstdint>
#include <span>

#include "itn/v1/scene.pb.h"

namespace itn {

// A row of pixels, counted from the top, where +y is; radiance is constant over each of them.
struct PanoramaRow {
  double solid_angle;  // of a pixel, in sr
  double from_above;  // irradiance on a surface that faces +y, in W/m^2, from radiance 1 in a pixel
};
PanoramaRow panorama_row(uint32_t row, uint32_t width, uint32_t height);

// Pixels of these colours, three numbers each.
v1::Pixels panorama_of(uint32_t width, uint32_t height, std::span<const float> rgb);

// The irradiance by what a film that is not RGB shows of a panorama, on a surface that faces +y, in
// W/m^2.
double irradiance_from_above(const v1::Pixels& panorama,
                             v1::Film::Channel channel = v1::Film::LUMINANCE);

// With each pixel the mean over its solid angle, where there are more than these; else as it is.
v1::Pixels averaged_down(const v1::Pixels& panorama, uint32_t max_width, uint32_t max_height);

void scale(v1::Pixels& panorama, double factor);

}  // namespace itn
