#include "client/training/complete_model.h"

#include <optional>

#include "client/training/familiarity_fit.h"
#include "client/training/width_fit.h"

namespace itn {

void complete_model(const ImageSource& training, const HeldOutImages& held_out, v1::Model& model,
                    const std::stop_token& stop) {
  model.clear_familiarity();
  if (const auto familiarity = measure_familiarity(model, training, held_out.images, stop)) {
    *model.mutable_familiarity() = *familiarity;
  }
  if (const auto widths = measure_widths(model, held_out, stop)) {
    *model.mutable_widths() = *widths;
  }
}

}  // namespace itn
