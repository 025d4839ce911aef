// How different two colours look.
#pragma once

#include <array>

namespace itn {

// CIE delta E 2000 of two colours in linear sRGB, whose white, 1 in each, is that of the observer
// (D65). Side by side, a difference of about 1 is just seen; black and white are 100 apart.
double colour_difference(const std::array<double, 3>& a, const std::array<double, 3>& b);

}  // namespace itn
