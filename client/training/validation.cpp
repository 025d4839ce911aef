#include "client/training/validation.h"

#include <algorithm>
#include <numeric>
#include <vector>

#include "client/training/augmentation.h"
#include "client/training/evaluation.h"
#include "common/random.h"

namespace itn {
namespace {

constexpr uint64_t kNoiseSeed = 1;  // whatever the run's: runs are compared by their validation
constexpr size_t kValidationBatch = 64;

}  // namespace

Validation::Validation(const LabelledImages& images, const PackedInputs& inputs, double noise)
    : images_(images), inputs_(inputs), noise_(noise) {}

v1::ValidationMetrics Validation::measure(const v1::Model& model) const {
  Predictor predictor(model);
  std::vector<Material> predictions;
  for (size_t first = 0; first < images_.items.size(); first += kValidationBatch) {
    std::vector<uint32_t> items(std::min(kValidationBatch, images_.items.size() - first));
    std::iota(items.begin(), items.end(), static_cast<uint32_t>(first));
    const ImageBatch batch =
        with_noise(inputs_.batch(items), noise_, derive_seed(kNoiseSeed, {first}));
    for (const MaterialEstimate& estimate : predictor.estimate(batch)) {
      predictions.push_back(estimate.material);
    }
  }
  const MaterialCoordinates errors = relative_errors(predictions, images_);
  v1::ValidationMetrics metrics;
  metrics.set_sigma_t(errors[0]);
  metrics.set_albedo(errors[1]);
  metrics.set_g(errors[2]);
  return metrics;
}

double score(const v1::ValidationMetrics& metrics) {
  return (metrics.sigma_t() + metrics.albedo() + metrics.g()) / 3;
}

}  // namespace itn
