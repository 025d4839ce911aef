#include "client/predict/answer_warnings.h"

#include <algorithm>

namespace itn {

std::string in_words(v1::MaterialBound bound) {
  switch (bound) {
    case v1::SIGMA_T_LEAST: return "the least sigma_t";
    case v1::SIGMA_T_MOST: return "the greatest sigma_t";
    case v1::ALBEDO_LEAST: return "the least albedo";
    case v1::ALBEDO_MOST: return "the greatest albedo";
    case v1::G_LEAST: return "the least g";
    case v1::G_MOST: return "the greatest g";
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
