// The parts of a mask: people's masks have specks of a brush beside the object, and holes.
#pragma once

#include <cstddef>
#include <vector>

namespace itn {

struct MaskParts {
  size_t specks = 0;          // parts that were left out
  size_t speck_pixels = 0;    // in all of them
  size_t parts = 0;           // that are left
  double filled = 0;          // of the image, by what is left and the holes in it
  double largest_hole = 0;    // of the image
  bool is_rectangle = false;  // what is filled, to 2 % of its area
};

// Blackens what is on the object (is_on_object()) and smaller than 1/200 of the largest part.
// Pixels hang together where sides or corners meet; holes are what does not reach the border, where
// sides meet. `mask`: width * height values.
MaskParts drop_specks(std::vector<float>& mask, int width, int height);

}  // namespace itn
