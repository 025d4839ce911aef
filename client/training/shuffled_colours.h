// More materials from the same renders: red, green and blue in another order.
#pragma once

#include <cstdint>
#include <memory>

#include "client/training/batches.h"

namespace itn {

// Each image of colour with its planes, and the materials that are its truth, in a random order of
// the six. An image sees each colour over what the lights send of it, so that what was blue is as
// good a red. Images of one plane stay as they are.
class ShuffledColours final : public Batches {
 public:
  // `seed`: of the orders.
  ShuffledColours(std::unique_ptr<Batches> batches, uint64_t seed);

  TrainingImages batch_at(uint64_t step, uint32_t size) override;
  int resolution() const override { return batches_->resolution(); }
  uint64_t image_count() const override { return batches_->image_count(); }

 private:
  std::unique_ptr<Batches> batches_;
  uint64_t seed_;
};

}  // namespace itn
