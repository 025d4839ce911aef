// What an OBJ file must be before a foreign parser sees it. Internal to mesh_file.
#pragma once

#include <string>

namespace itn {

// The vertices and faces of an OBJ file in the plainest form: lines of "v" with numbers and of "f"
// with vertices that are there, counted from 1, and nothing else, as Assimp writes where it must
// not when others are damaged. `what` names the file in messages. Throws Error (kInvalidInput) with
// the line. Takes time and memory in proportion to the file's size.
std::string checked_obj(const std::string& content, const std::string& what);

}  // namespace itn
