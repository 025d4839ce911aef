// Solids to begin with, about the origin; those with an axis have it along y.
#pragma once

#include <vector>

#include "client/geometry/sdf/solid.h"

namespace itn::sdf {

Solid ball(float radius);
Solid box(Vec3f half_sides);
Solid cylinder(float radius, float half_height);
Solid torus(float radius, float tube_radius);
// The frustum of a cone; a radius may be 0.
Solid cone(float bottom_radius, float top_radius, float half_height);

// The points behind all of the planes, each at `offset` from the origin along its unit normal.
struct Plane {
  Vec3f normal;
  float offset = 0;
};
Solid polyhedron(std::vector<Plane> planes);

// Round limbs between two points, thicker or thinner towards the end, in one smooth union: limbs
// nearer to each other than about `fillet` (> 0) flow together. At least one limb.
struct Limb {
  Vec3f from, to;  // not the same
  float from_radius = 0, to_radius = 0;
};
Solid limbs(const std::vector<Limb>& limbs, float fillet);

// A polygon that does not cut itself, either way round, of three vertices at least.
struct Vertex2 {
  float x = 0, y = 0;
};
using Outline = std::vector<Vertex2>;
// In the plane y = 0, its y along z, between y = -half_height and half_height.
Solid extruded(const Outline& outline, float half_height);
// Turned about the y axis: x is the distance from it.
Solid revolved(const Outline& outline);

// The wall of about the given thickness along the gyroid: endless, to be intersected.
Solid gyroid(float period, float thickness);

}  // namespace itn::sdf
