#include "client/training/batches.h"

namespace itn {

DatasetBatches::DatasetBatches(const LabelledImages& images, const PackedInputs& inputs,
                               uint64_t seed)
    : images_(images),
      inputs_(inputs),
      sampler_(static_cast<uint32_t>(images.items.size()), seed) {}

TrainingImages DatasetBatches::batch_at(uint64_t step, uint32_t size) {
  TrainingImages result{.items = sampler_.batch(step, size), .images = {}, .truth = {}};
  result.images = inputs_.batch(result.items);
  for (const uint32_t item : result.items) result.truth.push_back(images_.truth[item]);
  return result;
}

}  // namespace itn
