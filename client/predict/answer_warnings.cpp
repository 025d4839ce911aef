#include "client/predict/answer_warnings.h"

#include <algorithm>

namespace itn {

std::string in_words(v1::MaterialBound bound) {
  switch (bound) {
    case v1::SIGMA_T_MIN: return "the least sigma_t";
    case v1::SIGMA_T_MAX: return "the greatest sigma_t";
    case v1::ALBEDO_MIN: return "the least albedo";
    case v1::ALBEDO_MAX: return "the greatest albedo";
    case v1::G_MIN: return "the least g";
    case v1::G_MAX: return "the greatest g";
    default: return "an end";
  }
}

bool in_all_channels(const v1::Prediction& prediction, const v1::Warning& warning) {
  return std::ranges::all_of(prediction.channels(), [&](const v1::Prediction::Channel& channel) {
    return std::ranges::any_of(channel.caveats().warnings(), [&](const v1::Warning& other) {
      return other.kind() == warning.kind();
    });
  });
}

}  // namespace itn
