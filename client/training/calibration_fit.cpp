#include "client/training/calibration_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <torch/optim/lbfgs.h>

#include "client/training/evaluation.h"
#include "common/error.h"
#include "common/learning/gaussian.h"
#include "common/learning/predictor.h"

namespace itn {
namespace {

constexpr size_t kMaxImages = 4096, kFewestImages = 256;

// Rows of as many numbers each.
torch::Tensor as_tensor(const std::vector<std::vector<double>>& rows) {
  const auto count = static_cast<int64_t>(rows.size());
  torch::Tensor tensor =
      torch::empty({count, static_cast<int64_t>(rows.front().size())}, torch::kFloat64);
  for (int64_t i = 0; i < count; ++i) {
    std::ranges::copy(rows[static_cast<size_t>(i)], tensor[i].data_ptr<double>());
  }
  return tensor;
}

}  // namespace

v1::Calibration fit_calibration(const torch::Tensor& outputs, const torch::Tensor& truth) {
  const int64_t n = truth.size(1);
  const torch::Tensor widths = torch::zeros({2, n}, torch::kFloat64).requires_grad_();
  torch::optim::LBFGS optimizer(
      {widths},
      torch::optim::LBFGSOptions(1).max_iter(100).line_search_fn(std::string("strong_wolfe")));
  optimizer.step([&] {
    optimizer.zero_grad();
    torch::Tensor loss = negative_log_likelihood(calibrated(outputs, widths), truth).mean();
    loss.backward();
    return loss;
  });
  v1::Calibration correction;
  for (int64_t k = 0; k < n; ++k) {
    correction.add_offset(widths[0][k].item<double>());
    correction.add_slope(widths[1][k].item<double>());
  }
  return correction;
}

double conformal_level(std::span<const double> levels) {
  std::vector<double> sorted(levels.begin(), levels.end());
  std::ranges::sort(sorted);
  const auto rank = static_cast<size_t>(std::ceil(0.9 * static_cast<double>(sorted.size() + 1)));
  return rank <= sorted.size() ? sorted[rank - 1] : 1;
}

namespace {

// Calls `use` with the estimates for the channels of each image and their truth.
template <typename Use>
void for_each_estimate(const Predictor& predictor, const HeldOutImages& held_out,
                       std::span<const uint32_t> shown, const std::stop_token& stop,
                       const Use& use) {
  const size_t channels = predictor.channels();
  for (; !shown.empty(); shown = shown.subspan(std::min(kImagesAtATime, shown.size()))) {
    if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
    const std::span<const uint32_t> numbers = shown.first(std::min(kImagesAtATime, shown.size()));
    const std::vector<MaterialEstimate> estimates =
        predictor.estimate(held_out.images.batch(numbers));
    for (size_t i = 0; i < numbers.size(); ++i) {
      use(estimates[i * channels], held_out.truth.subspan(numbers[i] * channels, channels));
    }
  }
}

// The fitted level of each number, from all channels of these images.
void fit_levels(const Predictor& predictor, const HeldOutImages& held_out,
                std::span<const uint32_t> shown, const std::stop_token& stop,
                v1::Calibration& correction) {
  constexpr double kLowest = 1e-3, kHighest = 0.999;  // of levels that a model may have
  std::array<std::vector<double>, kPosteriorNumbers> reached;
  for_each_estimate(
      predictor, held_out, shown, stop,
      [&](const MaterialEstimate& estimate, std::span<const Material> truth) {
        for (const IntervalLevels& levels : predictor.levels_that_reach(estimate, truth)) {
          for (size_t k = 0; k < kPosteriorNumbers; ++k) {
            reached[k].push_back(levels[k]);
          }
        }
      });
  for (const std::vector<double>& levels : reached) {
    correction.add_interval_level(std::clamp(conformal_level(levels), kLowest, kHighest));
  }
}

}  // namespace

std::optional<v1::Calibration> measure_calibration(const v1::Model& model,
                                                   const HeldOutImages& held_out,
                                                   const std::stop_token& stop) {
  if (model.output() != v1::GAUSSIAN || held_out.images.count < kFewestImages) return std::nullopt;
  const std::vector<uint32_t> shown = spread(kMaxImages, held_out.images.count);
  std::vector<uint32_t> for_widths, for_levels;
  for (size_t i = 0; i < shown.size(); ++i) {
    const bool is_for_levels = shown.size() >= 2 * kFewestImages && i % 2 == 1;
    (is_for_levels ? for_levels : for_widths).push_back(shown[i]);
  }
  v1::Model corrected = model;
  corrected.clear_calibration();
  const Predictor predictor(corrected);
  std::vector<std::vector<double>> outputs, truth;  // of each image
  for_each_estimate(predictor, held_out, for_widths, stop,
                    [&](const MaterialEstimate& estimate, std::span<const Material> materials) {
                      outputs.push_back(estimate.outputs);
                      truth.push_back(predictor.standardized(materials));
                    });
  v1::Calibration correction = fit_calibration(as_tensor(outputs), as_tensor(truth));
  if (for_levels.empty()) return correction;
  *corrected.mutable_calibration() = correction;
  fit_levels(Predictor(corrected), held_out, for_levels, stop, correction);
  return correction;
}

}  // namespace itn
