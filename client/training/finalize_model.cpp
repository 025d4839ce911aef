#include "client/training/finalize_model.h"

#include <optional>

#include "client/training/calibration_fit.h"
#include "client/training/camera_augmentation.h"
#include "client/training/outlier_fit.h"

namespace itn {
namespace {

// The images as the model was trained with them.
ImageSource with_camera_effects(const ImageSource& source, const v1::CameraAugmentation& camera) {
  if (source.count == 0 || !changes_images(camera)) return source;
  return {.count = source.count, .batch = [source, camera](std::span<const uint32_t> numbers) {
            return itn::with_camera_effects(source.batch(numbers), camera, numbers.front());
          }};
}

}  // namespace

void finalize_model(const ImageSource& training, const HeldOutImages& held_out, v1::Model& model,
                    const std::stop_token& stop) {
  model.clear_outlier_model();
  const HeldOutImages others{with_camera_effects(held_out.images, model.camera()), held_out.truth};
  if (const auto outlier_model = measure_outlier_model(
          model, with_camera_effects(training, model.camera()), others.images, stop)) {
    *model.mutable_outlier_model() = *outlier_model;
  }
  if (const auto widths = measure_calibration(model, others, stop)) {
    *model.mutable_calibration() = *widths;
  }
}

}  // namespace itn
