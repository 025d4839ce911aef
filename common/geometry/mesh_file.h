// Mesh files, apart from mesh.h so that a program that reads none does not load Assimp.
#pragma once

#include <filesystem>

#include "common/geometry/mesh.h"

namespace itn {

// Reads PLY, OBJ or STL, welded. Throws Error: kIo (missing, unreadable), kInvalidInput (no
// triangles, non-finite vertices, an index out of range), kDataLoss (a PLY file that was cut
// short).
Mesh load_mesh(const std::filesystem::path& path);

}  // namespace itn
