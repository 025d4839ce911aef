// Sources of the images of each training step.
#pragma once

#include <cstdint>
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
  std::vector<Material> truth;
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

// All images of a split, each once in every epoch.
class DatasetBatches final : public Batches {
 public:
  // What is referred to must outlive it. `seed`: of the order.
  DatasetBatches(const LabelledImages& images, const PackedInputs& inputs, uint64_t seed);

  TrainingImages batch_at(uint64_t step, uint32_t size) override;
  int resolution() const override { return inputs_.format().resolution; }
  uint64_t image_count() const override { return images_.items.size(); }

 private:
  const LabelledImages& images_;
  const PackedInputs& inputs_;
  EpochSampler sampler_;
};

}  // namespace itn
