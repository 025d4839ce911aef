// Places between two ends, on a scale that has none.
#pragma once

#include <cmath>

namespace itn {

struct LogitScale {
  double low = 0, high = 1;

  double to(double value) const { return std::log((value - low) / (high - value)); }
  double from(double place) const { return low + (high - low) / (1 + std::exp(-place)); }
  // d value / d place.
  double slope(double value) const { return (value - low) * (high - value) / (high - low); }
};

}  // namespace itn
