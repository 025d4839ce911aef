// Triangle meshes, and the checks that make one usable as the boundary of a medium.
#pragma once

#include <array>
#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

#include "common/vec.h"

namespace itn {

struct Mesh {
  std::vector<Vec3f> vertices;                     // in mm
  std::vector<std::array<uint32_t, 3>> triangles;  // vertex indices, counter-clockwise from outside
};

struct Bounds {
  Vec3f min, max;
};

// The bounds of a mesh with at least one vertex.
Bounds bounds(const Mesh& mesh);

// In mm.
double longest_side(const Bounds& box);
Vec3d middle_of(const Bounds& box);

// A 3x4 affine map, row by row: the last column is the translation.
using Affine = std::array<double, 12>;

Mesh transformed(const Mesh& mesh, const Affine& affine);

// Centred over the origin (x and z), lowest point at y = 0, longest side 1 mm.
Mesh normalized(const Mesh& mesh);

// Merges vertices at exactly the same position (formats like STL repeat them) and drops triangles
// that repeat a vertex, then vertices that no triangle uses. Indices must be in range.
Mesh welded(const Mesh& mesh);

// Throws Error (invalid input) unless every index is in range, every coordinate finite, and the
// mesh has a triangle. `what` names the mesh in the message.
void validate_triangles(const Mesh& mesh, const std::string& what);

// Throws Error (invalid input) unless the (welded) mesh bounds a volume: every edge is shared by
// triangles that run along it in opposite directions, the same number each way; the volume enclosed
// by every connected part is positive, or negative where the part is a cavity inside another; no
// solid part is inside another; no two parts overlap by more than rounding of coordinates, nor is a
// part there twice, though solids may touch: light would be counted once where it passes both. The
// message says how many edges are open and where the first is, or that the mesh is inside out, or
// where parts overlap. Whether a part cuts through itself is not looked at: scans do in places.
// Takes n log n. Throws Error (cancelled) soon after a stop is asked for.
void validate_closed(const Mesh& mesh, const std::string& what, const std::stop_token& stop = {});

// Signed volume enclosed, in mm^3; positive for an outward oriented mesh.
double signed_volume(const Mesh& mesh);

// In mm^2.
double area(const Mesh& mesh);

// Twice the volume of a closed mesh over its area, in mm: how thick a wide sheet is; of a ball two
// thirds of its radius.
double thickness(const Mesh& mesh);

// How often a closed mesh winds around a point: 1 inside of an outward oriented one, 0 outside, a
// fraction next to an open one. Takes time linear in the number of triangles.
double winding_number(const Mesh& mesh, Vec3d p);

}  // namespace itn
