// More materials from the same renders: what derivative images say of neighbours.
#pragma once

#include <cstdint>
#include <memory>

#include "client/training/batches.h"
#include "client/training/packed_derivatives.h"
#include "common/learning/parameterization.h"

namespace itn {

// Images of materials near those that were rendered: with pi moved to pi', I becomes
// I + dI/dpi (pi' - pi), and the truth pi'. The step is a normal number in each of the UNBOUNDED
// coordinates, whose standard deviation is `step`; one that would leave the model's bounds is not
// made. What is left out is of second order in the step; the noise of the derivative images comes
// on top of that of the image, times the step.
class FirstOrderAugmentation final : public Batches {
 public:
  // `derivatives`: of the dataset's images, must outlive it. `seed`: of the steps.
  FirstOrderAugmentation(std::unique_ptr<Batches> batches, const PackedDerivatives& derivatives,
                         const v1::MaterialRange& bounds, double step, uint64_t seed);

  TrainingImages batch_at(uint64_t step, uint32_t size) override;
  int resolution() const override { return batches_->resolution(); }
  uint64_t image_count() const override { return batches_->image_count(); }

 private:
  Material moved(const Material& material, const MaterialCoordinates& normal) const;

  std::unique_ptr<Batches> batches_;
  const PackedDerivatives& derivatives_;
  Box box_;
  OpenInterval g_;
  double step_;
  uint64_t seed_;
};

}  // namespace itn
