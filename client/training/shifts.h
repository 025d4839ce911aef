// What may differ between photographs and the images of training, done to the images of a test.
#pragma once

#include <span>
#include <string>

#include "itn/v1/learning.pb.h"

namespace itn {

struct Shift {
  std::string name;         // as in "contrast off by 20 %"
  v1::Augmentation change;  // drawn anew for each image
};

// As large as is usual between two cameras, or two people who draw a mask.
std::span<const Shift> shifts();

}  // namespace itn
