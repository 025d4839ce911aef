// The formats of mesh files, one reader in a file of its own each, and what they share. Internal to
// mesh_file.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/error.h"
#include "common/geometry/mesh.h"

namespace itn {

// Each reads the content of a file; `what` names it in messages. Throws Error: kInvalidInput,
// kDataLoss (the file was cut short). Takes time and memory in proportion to the content, but for
// polygons (triangulated). Coordinates may be infinite or nan.
Mesh read_ply(std::string_view content, const std::string& what);
Mesh read_obj(std::string_view content, const std::string& what);
Mesh read_stl(std::string_view content, const std::string& what);

// A face has at most so many corners.
inline constexpr size_t kMaxCorners = 1024;

// A mesh whose faces are polygons.
struct PolygonMesh {
  std::vector<Vec3f> vertices;
  std::vector<uint32_t> corners;  // vertex indices, face after face
  std::vector<uint32_t> sizes;    // the number of corners of each face
};

// Cuts off ears: corners whose triangle holds no other corner. Faces of one or two corners are
// points and lines, and vanish. A convex face becomes a fan around its first corner. Takes time by
// the square of the number of a face's corners, and by their cube for a spiral. Throws Error
// (kInvalidInput) for an index out of range.
Mesh triangulated(const PolygonMesh& mesh, const std::string& what);

// The word as a number, if it is one; infinite if it is too large. Words of more than 64 characters
// are none.
std::optional<double> number_in(std::string_view word);

// The next word of the text, which loses it; empty at the end of the text.
std::string_view take_word(std::string_view& text);

// The next line of the text, without its end; the text loses it.
std::string_view take_line(std::string_view& text);

Error cut_short(const std::string& what, const std::string& reason);

}  // namespace itn
