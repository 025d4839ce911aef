#include "client/training/calibration_fit.h"

#include <algorithm>
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

std::optional<v1::Calibration> measure_calibration(const v1::Model& model,
                                                   const HeldOutImages& held_out,
                                                   const std::stop_token& stop) {
  if (model.output() != v1::GAUSSIAN || held_out.images.count < kFewestImages) return std::nullopt;
  v1::Model uncorrected = model;
  uncorrected.clear_calibration();
  Predictor predictor(uncorrected);
  const std::vector<uint32_t> shown = spread(kMaxImages, held_out.images.count);
  std::vector<std::vector<double>> outputs, truth;  // of each image
  for (size_t first = 0; first < shown.size(); first += kImagesAtATime) {
    if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
    const std::span<const uint32_t> numbers =
        std::span(shown).subspan(first, std::min(kImagesAtATime, shown.size() - first));
    std::vector<MaterialEstimate> estimates = predictor.estimate(held_out.images.batch(numbers));
    const size_t channels = predictor.channels();
    for (size_t i = 0; i < numbers.size(); ++i) {
      outputs.push_back(std::move(estimates[i * channels].outputs));
      truth.push_back(
          predictor.standardized(held_out.truth.subspan(numbers[i] * channels, channels)));
    }
  }
  return fit_calibration(as_tensor(outputs), as_tensor(truth));
}

}  // namespace itn
