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

// Rows of three or nine numbers.
template <typename Row>
torch::Tensor as_tensor(const std::vector<Row>& rows) {
  const auto count = static_cast<int64_t>(rows.size());
  torch::Tensor tensor =
      torch::empty({count, static_cast<int64_t>(rows.front().size())}, torch::kFloat64);
  for (int64_t i = 0; i < count; ++i) {
    const Row& row = rows[static_cast<size_t>(i)];
    std::ranges::copy(row, tensor[i].data_ptr<double>());
  }
  return tensor;
}

}  // namespace

v1::Calibration fit_calibration(const torch::Tensor& outputs, const torch::Tensor& truth) {
  const torch::Tensor widths = torch::zeros({2, 3}, torch::kFloat64).requires_grad_();
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
  for (int64_t k = 0; k < 3; ++k) {
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
  std::vector<std::vector<double>> outputs;
  std::vector<MaterialCoordinates> truth;
  for (size_t first = 0; first < shown.size(); first += kImagesAtATime) {
    if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
    const std::span<const uint32_t> numbers =
        std::span(shown).subspan(first, std::min(kImagesAtATime, shown.size() - first));
    for (MaterialEstimate& estimate : predictor.estimate(held_out.images.batch(numbers))) {
      outputs.push_back(std::move(estimate.outputs));
    }
    for (const uint32_t number : numbers) {
      truth.push_back(predictor.standardized(held_out.truth[number]));
    }
  }
  return fit_calibration(as_tensor(outputs), as_tensor(truth));
}

}  // namespace itn
