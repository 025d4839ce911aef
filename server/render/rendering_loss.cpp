#include "server/render/rendering_loss.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/error.h"

namespace itn {
namespace {

void check_sizes(std::span<const float> image, std::span<const float> weight,
                 std::span<const RenderEstimate> estimates) {
  if (estimates.size() < 2) {
    throw invalid_input(fmt::format(
        "{} estimate(s) of the render; an unbiased gradient needs 2 at least", estimates.size()));
  }
  bool fits = weight.size() == image.size();
  for (const RenderEstimate& estimate : estimates) {
    fits = fits && estimate.radiance.size() == image.size();
    for (const std::vector<float>& derivative : estimate.derivatives) {
      fits = fits && derivative.size() == image.size();
    }
  }
  if (!fits) {
    throw invalid_input("the render does not have the size of the image");
  }
}

double weighted_energy(std::span<const float> image, std::span<const float> weight) {
  double energy = 0;
  for (size_t p = 0; p < image.size(); ++p) {
    const double value = static_cast<double>(weight[p]) * image[p];
    energy += value * value;
  }
  if (!(energy > 0)) {
    throw invalid_input("the image is black where its weight map is not 0");
  }
  return energy;
}

// Sums over the pairs of different estimates at one pixel, before division by K (K - 1).
struct PairSums {
  double squares = 0;
  std::array<double, 3> products{};
};

PairSums pair_sums(double intended, std::span<const RenderEstimate> estimates, size_t pixel) {
  double sum = 0, sum_of_squares = 0;
  std::array<double, 3> derivative_sum{}, sum_of_products{};
  for (const RenderEstimate& estimate : estimates) {
    const double difference = estimate.radiance[pixel] - intended;
    sum += difference;
    sum_of_squares += difference * difference;
    for (size_t i = 0; i < 3; ++i) {
      const double derivative = estimate.derivatives[i][pixel];
      derivative_sum[i] += derivative;
      sum_of_products[i] += difference * derivative;
    }
  }
  PairSums result;
  result.squares = sum * sum - sum_of_squares;
  for (size_t i = 0; i < 3; ++i) {
    result.products[i] = sum * derivative_sum[i] - sum_of_products[i];
  }
  return result;
}

}  // namespace

RenderingLoss rendering_loss(std::span<const float> image, std::span<const float> weight,
                             std::span<const RenderEstimate> estimates) {
  check_sizes(image, weight, estimates);
  const double energy = weighted_energy(image, weight);
  const auto count = static_cast<double>(estimates.size());
  const double scale = 1 / (energy * count * (count - 1));
  RenderingLoss loss;
  for (size_t p = 0; p < image.size(); ++p) {
    const double w2 = static_cast<double>(weight[p]) * weight[p];
    if (w2 == 0) {
      continue;
    }
    const PairSums pairs = pair_sums(image[p], estimates, p);
    loss.value += w2 * scale * pairs.squares;
    for (size_t i = 0; i < 3; ++i) {
      loss.gradient[i] += 2 * w2 * scale * pairs.products[i];
    }
  }
  return loss;
}

std::vector<float> loss_importance(std::span<const float> image, std::span<const float> weight) {
  constexpr double kFloor = 0.25;  // of the mean
  double sum = 0;
  size_t weighted = 0;
  for (size_t p = 0; p < image.size(); ++p) {
    if (weight[p] != 0) {
      sum += std::abs(double{image[p]});
      ++weighted;
    }
  }
  const double floor = weighted > 0 ? kFloor * sum / static_cast<double>(weighted) : 0;
  std::vector<double> exact(image.size());
  std::transform(image.begin(), image.end(), weight.begin(), exact.begin(),
                 [&](float i, float w) { return double{w} * w * (std::abs(double{i}) + floor); });
  const double most = exact.empty() ? 0 : *std::max_element(exact.begin(), exact.end());
  std::vector<float> importance(exact.size());
  std::transform(exact.begin(), exact.end(), importance.begin(), [&](double e) {
    return e > 0 ? std::max(static_cast<float>(e / most), std::numeric_limits<float>::min()) : 0;
  });
  return importance;
}

}  // namespace itn
