// Differences of a photograph and its renders that neighbouring pixels share, as where the shape is
// off: a part of the radiance, of this size (root mean square), which is a Gaussian process of the
// place, of covariance exp(-d^2 / (2 length^2)) at pixels that are d apart.
//
// Pixels are taken together in squares, within which all share one such part, so that all of it is
// a few hundred numbers.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "client/refine/matrix.h"

namespace itn {

struct Likeness {
  double size = 0;    // 0: pixels are independent
  double length = 1;  // in pixels
};

// By what the squared distance of two places is, over that of the length.
double likeness_at(double squared_distance);

class AlikePixels {
 public:
  // `pixels` of an image of so many a row.
  AlikePixels(std::span<const uint32_t> pixels, uint32_t width, const Likeness& likeness);

  // Multiplies planes by the inverse of the covariance of independent noise of variance 1 / weight
  // and what is alike, by Woodbury's identity ("Inverting modified matrices", 1950): the weighted
  // least squares of Aitken ("On least squares and linear combination of observations", 1935), in
  // which what pixels share counts for as little as it tells. All are by pixel.
  void weigh(std::span<const double> weights, std::span<const double> radiance,
             std::span<std::vector<double>> planes) const;

 private:
  std::vector<Eigen::Index> squares_;  // by pixel
  Matrix covariance_;                  // of the parts, by square
};

}  // namespace itn
