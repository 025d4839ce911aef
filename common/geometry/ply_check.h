// What a PLY file must be before a foreign parser sees it. Internal to mesh_file.
#pragma once

#include <string>

namespace itn {

// Checks that a PLY file holds all that its header promises, and nothing but numbers, and returns
// it in the plainest form: one element a line if it is text, with no byte that could be taken for a
// part of the header. `what` names the file in messages. Throws Error: kInvalidInput (not a PLY
// file, a word where a number should be), kDataLoss (it ends too early). Takes time and memory in
// proportion to the file's size.
std::string checked_ply(const std::string& content, const std::string& what);

}  // namespace itn
