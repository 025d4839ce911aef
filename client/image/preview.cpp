#include "client/image/preview.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace itn {

float white_level(std::vector<float> values) {
  const auto nth = values.begin() + static_cast<ptrdiff_t>((values.size() - 1) * 99 / 100);
  std::nth_element(values.begin(), nth, values.end());
  return *nth > 0 ? *nth : 1;
}

unsigned char to_byte(float value) {
  return static_cast<unsigned char>(std::lround(255 * std::clamp(value, 0.0F, 1.0F)));
}

unsigned char to_srgb_byte(float linear) {
  const float v = std::clamp(linear, 0.0F, 1.0F);
  return to_byte(v <= 0.0031308F ? 12.92F * v : 1.055F * std::pow(v, 1 / 2.4F) - 0.055F);
}

}  // namespace itn
