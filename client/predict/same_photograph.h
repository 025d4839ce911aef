// Photographs that tell nothing new beside one another.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "client/predict/photograph_input.h"

namespace itn {

// The numbers of the photographs but for those that are nearly the same as an earlier one, as of a
// burst: what they say is one answer, and must not count twice. Two are nearly the same if their
// framed images, averaged down and over their means, differ by less than 5 % on the object. Throws
// Error (invalid input) if two are the same to the bit. `told` gets a sentence for each that is
// left out.
std::vector<size_t> different_photographs(std::span<const PredictInput> photographs,
                                          std::vector<std::string>& told);

}  // namespace itn
