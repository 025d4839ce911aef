#include "client/exports/medium_colours.h"

#include <algorithm>
#include <cmath>

namespace itn {

TransmissionColours transmission_colours(const RgbMaterial& material) {
  TransmissionColours result;
  // With this depth no colour is dark, and `scatter` is at most 1.
  result.depth = std::min(
      {material.mean_free_path(0), material.mean_free_path(1), material.mean_free_path(2)});
  for (size_t c = 0; c < 3; ++c) {
    result.color[c] = std::exp(-material.sigma_t(c) * result.depth);
    result.scatter[c] = material.sigma_s[c] * result.depth;
  }
  return result;
}

SubsurfaceColours subsurface_colours(const RgbMaterial& material) {
  SubsurfaceColours result;
  result.radius = std::max(
      {material.mean_free_path(0), material.mean_free_path(1), material.mean_free_path(2)});
  for (size_t c = 0; c < 3; ++c) {
    result.color[c] = material.diffuse_albedo(c);
    result.radius_scale[c] = material.mean_free_path(c) / result.radius;
  }
  return result;
}

}  // namespace itn
