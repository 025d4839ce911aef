// What lamps that stand near the object have in common.
#pragma once

#include <string>

#include "common/vec.h"
#include "server/tracer/lights/light_frame.h"

namespace itn::tracer {

struct LampPlace {
  Vec3d position;  // in the coordinates of the object
  // Of the object's middle, squared, in mm^2: there, power() is the irradiance. It decides how
  // often the lamp is drawn.
  double distance2;
  double rounding;  // of places of the object and the lamp, at most, in mm
};

// `field`: of the position, for messages. Throws Error (invalid input) if that is in the object.
LampPlace lamp_place(const LightFrame& frame, const std::string& field, Vec3d position);

// W/m^2 from W/sr over mm^2.
constexpr double kSquareMmPerSquareM = 1e6;

}  // namespace itn::tracer
