// Sources of the images of each training step.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "client/dataset/sampler.h"
#include "client/training/packed_inputs.h"
#include "client/training/training_set.h"
#include "common/learning/network_input.h"
#include "common/material.h"

namespace itn {

struct TrainingImages {
  std::vector<uint32_t> items;  // their numbers in the LabelledImages
  ImageBatch images;
  std::vector<Material> truth;  // by channel, of the first of them; the others have no label
};

class Batches {
 public:
  virtual ~Batches() = default;

  // For the step after so many. A function of its arguments and of what it was made of: whoever
  // asks again, or goes on after a pause, gets the same. Steps must not be asked for in falling
  // order, but for the last one again. May throw Error.
  virtual TrainingImages batch_at(uint64_t step, uint32_t size) = 0;

  // The side of the images, in pixels.
  virtual int resolution() const = 0;

  // The number of images in an epoch.
  virtual uint64_t image_count() const = 0;
};

// All images of a split, each once in every epoch; if not all are labelled, those alone that are,
// or half of a batch from those, and half from the others.
class DatasetBatches final : public Batches {
 public:
  // What is referred to must outlive it. `seed`: of the order.
  DatasetBatches(const LabelledImages& images, const PackedInputs& inputs, uint64_t seed,
                 bool labelled_alone = true);

  TrainingImages batch_at(uint64_t step, uint32_t size) override;
  int resolution() const override { return inputs_.format().resolution; }
  uint64_t image_count() const override { return items_.size() + others_.size(); }

 private:
  const LabelledImages& images_;
  const PackedInputs& inputs_;
  std::vector<uint32_t> items_, others_;  // with labels, and without
  EpochSampler sampler_;
  std::optional<EpochSampler> other_sampler_;
};

}  // namespace itn
