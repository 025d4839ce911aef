// What is not known of a scene, apart from the material, does to a photograph.
#pragma once

#include <span>
#include <vector>

namespace itn {

// Renders with something more, and with as much less of it, by the same random numbers: independent
// estimates of the radiance, as many of each, by pixel.
struct RenderedChange {
  std::vector<std::vector<float>> more, less;
  double apart = 2;  // in standard deviations of what is not known
};

// Planes of Observation::disturbances, of images of `width` pixels a row: what a standard deviation
// of each of some independent errors adds, as a part of the radiance. The errors that changed are
// independent, too; those that are made of them change the image most. What changes it by less than
// two thousandths, root mean square over the pixels of the mask, is left out.
std::vector<std::vector<float>> disturbances_of(std::span<const RenderedChange> changes,
                                                const std::vector<float>& mask, int width);

}  // namespace itn
