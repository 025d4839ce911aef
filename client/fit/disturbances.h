// What is not known of a scene, apart from the material, does to a photograph.
#pragma once

#include <array>
#include <span>
#include <vector>

namespace itn {

// Renders with something more, and with as much less of it, by the same random numbers: independent
// estimates of the radiance, as many of each, by pixel; of colours one image below the other.
struct RenderedChange {
  std::vector<std::vector<float>> more, less;
  double apart = 2;  // in standard deviations of what is not known
  // By pixel of one image, how far a standard deviation moves what is seen there, in pixels to the
  // right and down; empty: nothing moves.
  std::vector<std::array<float, 2>> motion = {};
};

// Planes of Observation::disturbances, colours as in the renders: what a standard deviation of each
// of some independent errors adds, as a part of the radiance. The errors that changed are
// independent, too; those that are made of them change the image most. What changes it by less than
// a thousandth, root mean square over the pixels of the mask, is left out.
//
// Renders of few samples are noisier than they differ. What moves changes a pixel by how the
// radiance rises towards its neighbours. What a change does besides is fitted by polynomials in
// `surface`, any number of planes such as place, depth and normal of what the pixel shows; of their
// degrees that is taken by which one estimate is told best from the others. `mask` and `surface`
// are of one image, of `width` pixels a row.
std::vector<std::vector<float>> disturbances_of(std::span<const RenderedChange> changes,
                                                const std::vector<float>& mask, int width,
                                                std::span<const std::vector<float>> surface);

}  // namespace itn
