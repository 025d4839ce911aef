#include "server/render/weighted_image_loss.h"

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
    fits = fits && estimate.radiance.size() == image.size() &&
           estimate.derivatives.size() == estimates[0].derivatives.size();
    for (const std::vector<float>& derivative : estimate.derivatives) {
      fits = fits && derivative.size() == image.size();
    }
  }
  if (!fits) throw invalid_input("the estimates differ, or do not have the size of the image");
}

double weighted_energy(std::span<const float> image, std::span<const float> weight) {
  double energy = 0;
  for (size_t p = 0; p < image.size(); ++p) {
    const double value = static_cast<double>(weight[p]) * image[p];
    energy += value * value;
  }
  if (!(energy > 0)) throw invalid_input("the image is black where its weight map is not 0");
  return energy;
}

// For a quantity f_k by estimate k, and the differences T_k - I at one pixel, the sum over the
// pairs of different estimates of (T_j - I) f_k, before division by K (K - 1).
double pair_sum(double intended, std::span<const RenderEstimate> estimates, size_t pixel,
                const auto& quantity) {
  double differences = 0, quantities = 0, products = 0;
  for (const RenderEstimate& estimate : estimates) {
    const double difference = estimate.radiance[pixel] - intended;
    const double f = quantity(estimate, difference);
    differences += difference;
    quantities += f;
    products += difference * f;
  }
  return differences * quantities - products;
}

}  // namespace

LossWithGradient weighted_image_loss(std::span<const float> image, std::span<const float> weight,
                                     std::span<const RenderEstimate> estimates) {
  check_sizes(image, weight, estimates);
  const double energy = weighted_energy(image, weight);
  const auto count = static_cast<double>(estimates.size());
  const double scale = 1 / (energy * count * (count - 1));
  LossWithGradient loss;
  loss.gradient.resize(estimates[0].derivatives.size());
  for (size_t p = 0; p < image.size(); ++p) {
    const double w2 = static_cast<double>(weight[p]) * weight[p];
    if (w2 == 0) continue;
    const auto difference = [](const RenderEstimate&, double d) { return d; };
    loss.value += w2 * scale * pair_sum(image[p], estimates, p, difference);
    for (size_t i = 0; i < loss.gradient.size(); ++i) {
      const auto derivative = [&](const RenderEstimate& estimate, double) {
        return static_cast<double>(estimate.derivatives[i][p]);
      };
      loss.gradient[i] += 2 * w2 * scale * pair_sum(image[p], estimates, p, derivative);
    }
  }
  return loss;
}

std::vector<float> loss_sampling_weights(std::span<const float> image,
                                         std::span<const float> weight) {
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
  std::vector<float> result(exact.size());
  std::transform(exact.begin(), exact.end(), result.begin(), [&](double e) {
    return e > 0 ? std::max(static_cast<float>(e / most), std::numeric_limits<float>::min()) : 0;
  });
  return result;
}

}  // namespace itn
