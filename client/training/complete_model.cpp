#include "client/training/complete_model.h"

#include <optional>

#include "client/training/camera_augmentation.h"
#include "client/training/familiarity_fit.h"
#include "client/training/width_fit.h"

namespace itn {
namespace {

// As the model was trained with.
ImageSource photographed(const ImageSource& source, const v1::CameraAugmentation& camera) {
  if (source.count == 0 || !does_anything(camera)) return source;
  return {.count = source.count, .batch = [source, camera](std::span<const uint32_t> numbers) {
            return itn::photographed(source.batch(numbers), camera, numbers.front());
          }};
}

}  // namespace

void complete_model(const ImageSource& training, const HeldOutImages& held_out, v1::Model& model,
                    const std::stop_token& stop) {
  model.clear_familiarity();
  const HeldOutImages others{photographed(held_out.images, model.camera()), held_out.truth};
  if (const auto familiarity =
          measure_familiarity(model, photographed(training, model.camera()), others.images, stop)) {
    *model.mutable_familiarity() = *familiarity;
  }
  if (const auto widths = measure_widths(model, others, stop)) {
    *model.mutable_widths() = *widths;
  }
}

}  // namespace itn
