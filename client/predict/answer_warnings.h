// What limits how far an answer can be trusted, in words.
#pragma once

#include <string>
#include <vector>

#include "itn/v1/learning.pb.h"
#include "itn/v1/predict.pb.h"

namespace itn {

// Such as "the greatest albedo".
std::string in_words(v1::MaterialBound bound);

// Whether all channels have a warning of this kind: what holds for all of them is said once.
bool in_all_channels(const v1::Prediction& prediction, const v1::Warning& warning);

// What limits how far the answer can be trusted; in words, the worst first.
struct Limit {
  std::string text;
  bool is_grave = false;  // the answer should not be trusted
};
std::vector<Limit> limits_of(const v1::Prediction& prediction);

}  // namespace itn
