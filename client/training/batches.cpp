#include "client/training/batches.h"

#include <algorithm>
#include <iterator>
#include <numeric>

#include "common/random.h"

namespace itn {
namespace {

std::vector<uint32_t> labelled_items(const LabelledImages& images) {
  if (!images.labelled.empty()) return images.labelled;
  std::vector<uint32_t> all(images.items.size());
  std::iota(all.begin(), all.end(), 0U);
  return all;
}

std::vector<uint32_t> items_without_label(const LabelledImages& images) {
  std::vector<bool> is_labelled(images.items.size(), images.labelled.empty());
  for (const uint32_t i : images.labelled) is_labelled[i] = true;
  std::vector<uint32_t> others;
  for (uint32_t i = 0; i < is_labelled.size(); ++i) {
    if (!is_labelled[i]) others.push_back(i);
  }
  return others;
}

}  // namespace

DatasetBatches::DatasetBatches(const LabelledImages& images, const PackedInputs& inputs,
                               uint64_t seed, bool labelled_alone)
    : images_(images),
      inputs_(inputs),
      items_(labelled_items(images)),
      others_(labelled_alone ? std::vector<uint32_t>() : items_without_label(images)),
      sampler_(static_cast<uint32_t>(items_.size()), seed) {
  if (others_.empty()) return;
  other_sampler_.emplace(static_cast<uint32_t>(others_.size()), derive_seed(seed, {1}));
}

TrainingImages DatasetBatches::batch_at(uint64_t step, uint32_t size) {
  const uint32_t without = other_sampler_ ? size / 2 : 0;
  TrainingImages result;
  for (const uint32_t i : sampler_.batch(step, size - without)) {
    result.items.push_back(items_[i]);
    std::ranges::copy(images_.truth_of(items_[i]), std::back_inserter(result.truth));
  }
  if (without > 0) {
    for (const uint32_t i : other_sampler_->batch(step, without))
      result.items.push_back(others_[i]);
  }
  result.images = inputs_.batch(result.items);
  return result;
}

}  // namespace itn
