// Room between objects and what they touch, for renderers whose rays start a little off surfaces:
// they lose their side where an object stands on something.
#pragma once

#include <array>
#include <span>

#include "common/geometry/mesh.h"
#include "common/vec.h"

namespace itn {

// How a rectangle, by its corners in turn, lies to objects.
struct Contact {
  bool touches = false;  // at least one of them
  // The way to move it, in mm, so that there is air. Zero where none touches it, or objects on both
  // sides do.
  Vec3d away{};
};
Contact contact_of(const std::array<Vec3d, 4>& rectangle, std::span<const Mesh> objects);

// How far from a surface Mitsuba's rays start, in mm, where a mesh is.
double start_of_rays(const Mesh& mesh);

// Whether the boxes around two meshes touch, or overlap: if not, they do not touch.
bool may_touch(const Mesh& a, const Mesh& b);

}  // namespace itn
