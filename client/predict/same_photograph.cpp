#include "client/predict/same_photograph.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/error.h"

namespace itn {
namespace {

constexpr int kSignatureSide = 32;
constexpr double kNearlySame = 0.05;

// The radiance of the object over its mean, averaged down to 32 x 32; 0 around it.
std::vector<double> signature(const FramedPhotograph& photograph) {
  std::vector<double> sums(kSignatureSide * kSignatureSide),
      counts(kSignatureSide * kSignatureSide);
  const auto side = static_cast<size_t>(photograph.side);
  const auto channels = static_cast<size_t>(photograph.channels);
  double sum = 0, area = 0;
  for (size_t p = 0; p < photograph.mask.size(); ++p) {
    const size_t cell =
        p / side * kSignatureSide / side * kSignatureSide + p % side * kSignatureSide / side;
    double value = 0;
    for (size_t c = 0; c < channels; ++c) value += photograph.pixels[p * channels + c];
    value *= static_cast<double>(photograph.mask[p]);
    sums[cell] += value;
    counts[cell] += 1;
    sum += value;
    area += static_cast<double>(photograph.mask[p]);
  }
  for (size_t i = 0; i < sums.size(); ++i) sums[i] *= area / (std::max(counts[i], 1.0) * sum);
  return sums;
}

double difference(const std::vector<double>& a, const std::vector<double>& b) {
  double squares = 0, norm = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    squares += (a[i] - b[i]) * (a[i] - b[i]);
    norm += a[i] * a[i];
  }
  return std::sqrt(squares / norm);
}

}  // namespace

std::vector<size_t> different_photographs(std::span<const PredictInput> photographs,
                                          std::vector<std::string>& told) {
  std::vector<size_t> result;
  std::vector<std::vector<double>> signatures;
  for (size_t n = 0; n < photographs.size(); ++n) {
    const PredictInput& input = photographs[n];
    signatures.push_back(signature(input.photograph));
    const auto same = std::ranges::find_if(result, [&](size_t i) {
      const PredictInput& other = photographs[i];
      if (other.photograph.pixels == input.photograph.pixels &&
          other.photograph.mask == input.photograph.mask) {
        throw invalid_input(
            fmt::format("{} and {} are the same photograph: of one material, photographs in other "
                        "light or from other sides say more; the same one twice says nothing",
                        other.name, input.name));
      }
      return difference(signatures[i], signatures[n]) < kNearlySame;
    });
    if (same == result.end()) {
      result.push_back(n);
    } else {
      told.push_back(fmt::format("{} is nearly the same photograph as {}, and does not count",
                                 input.name, photographs[*same].name));
    }
  }
  return result;
}

}  // namespace itn
