#include "client/image/colour_difference.h"

#include <lcms2.h>

#include "common/luminance.h"

namespace itn {
namespace {

// IEC 61966-2-1.
constexpr std::array<std::array<double, 3>, 3> kXyzOfSrgb{
    {{0.4124, 0.3576, 0.1805}, kLuminanceOfColours, {0.0193, 0.1192, 0.9505}}};

cmsCIEXYZ xyz_of(const std::array<double, 3>& rgb) {
  std::array<double, 3> xyz{};
  for (size_t row = 0; row < 3; ++row) {
    for (size_t c = 0; c < 3; ++c) xyz[row] += kXyzOfSrgb[row][c] * rgb[c];
  }
  return {xyz[0], xyz[1], xyz[2]};
}

cmsCIELab lab_of(const std::array<double, 3>& rgb) {
  const cmsCIEXYZ white = xyz_of({1, 1, 1}), xyz = xyz_of(rgb);
  cmsCIELab lab;
  cmsXYZ2Lab(&white, &lab, &xyz);
  return lab;
}

}  // namespace

double colour_difference(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  const cmsCIELab lab_a = lab_of(a), lab_b = lab_of(b);
  return cmsCIE2000DeltaE(&lab_a, &lab_b, 1, 1, 1);
}

}  // namespace itn
