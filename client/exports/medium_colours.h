// A medium by colours and a distance, as surface shaders of film renderers have it.
#pragma once

#include <array>

#include "client/exports/rgb_material.h"

namespace itn {

// OpenPBR Surface 1.1, "Translucent base": mu_t = -ln(color) / depth, mu_s = scatter / depth. It
// describes what Arnold's standard_surface does (pull request 28 of the specification).
struct TransmissionColours {
  std::array<double, 3> color{};
  std::array<double, 3> scatter{};
  double depth = 0;  // the mean free path of the channel where it is shortest; in the same unit
};
TransmissionColours transmission_colours(const RgbMaterial& material);

// OpenPBR Surface 1.1, "Subsurface": the mean free path is radius * radius_scale, and color the
// diffuse albedo.
struct SubsurfaceColours {
  std::array<double, 3> color{};
  std::array<double, 3> radius_scale{};
  double radius = 0;  // the mean free path of the channel where it is longest; in the same unit
};
SubsurfaceColours subsurface_colours(const RgbMaterial& material);

}  // namespace itn
