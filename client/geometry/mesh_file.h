// Mesh files.
#pragma once

#include <array>
#include <filesystem>
#include <span>
#include <string>

#include "common/geometry/mesh.h"

namespace itn {

// Reads PLY, OBJ or STL, welded; opens no other file, whatever the mesh names. Faces may be concave
// polygons of at most 1024 corners. Throws Error: kIo (missing, unreadable, not a regular file),
// kInvalidInput (no triangles, non-finite vertices, an index out of range, a word where a number
// should be), kDataLoss (a file that was cut short, or promises more than it holds).
Mesh load_mesh(const std::filesystem::path& path);

// The bytes of a binary PLY file, from which load_mesh reads the same mesh, bit for bit, if it is
// welded.
std::string encode_ply(const Mesh& mesh);
// The same surface with normals at the corners of its triangles, each of which has vertices of its
// own then; no normals: as above.
std::string encode_ply(const Mesh& mesh, std::span<const std::array<Vec3f, 3>> corner_normals);

}  // namespace itn
