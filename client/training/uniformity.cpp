#include "client/training/uniformity.h"

#include <algorithm>
#include <cmath>

namespace itn {

double uniformity_p_value(std::vector<double> numbers) {
  if (numbers.empty()) return 1;
  std::ranges::sort(numbers);
  const auto count = static_cast<double>(numbers.size());
  double farthest = 0;
  for (size_t i = 0; i < numbers.size(); ++i) {
    const double below = static_cast<double>(i) / count, above = static_cast<double>(i + 1) / count;
    farthest = std::max({farthest, numbers[i] - below, above - numbers[i]});
  }
  const double root = std::sqrt(count);
  const double t = farthest * (root + 0.12 + 0.11 / root);
  constexpr double kSurelyUniform = 0.2;  // below, the series needs many terms for nothing but 1
  if (t < kSurelyUniform) return 1;
  double sum = 0;
  for (int k = 1; k <= 50; ++k) sum += (k % 2 == 1 ? 2 : -2) * std::exp(-2.0 * k * k * t * t);
  return std::clamp(sum, 0.0, 1.0);
}

}  // namespace itn
