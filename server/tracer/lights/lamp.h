// What lamps that stand near the object have in common.
#pragma once

#include <string>

#include "common/geometry/mesh.h"
#include "common/vec.h"
#include "server/tracer/lights/light_frame.h"

namespace itn::tracer {

struct LampPlace {
  Vec3d position;  // in the coordinates of the object
  // The squared distance of the object's middle, in mm^2: there, power() is the irradiance. It
  // decides how often the lamp is drawn.
  double distance2;
  double rounding;  // of places of the object and the lamp, at most, in mm
};

// `field`: of the position, for messages. Throws Error (invalid input) if that is in an object.
LampPlace lamp_place(const LightFrame& frame, const std::string& field, Vec3d position);

// Whether a part of the mesh is in the ball, or some of its triangles cross the parallelogram,
// which reaches from its center by half_u and half_v to both sides; more than what rounding does to
// either. Places are in the coordinates of the mesh, whose bounds are `box`.
bool is_in_ball(const Mesh& mesh, const Bounds& box, Vec3d center, double radius);
bool crosses(const Mesh& mesh, const Bounds& box, Vec3d center, Vec3d half_u, Vec3d half_v);

// W/m^2 from W/sr over mm^2.
constexpr double kSquareMmPerSquareM = 1e6;

}  // namespace itn::tracer
