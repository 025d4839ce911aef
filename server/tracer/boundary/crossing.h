// Where a line meets the boundary, and how a path goes on there.
#pragma once

#include <cstdint>

#include "common/vec.h"

namespace itn::tracer {

// Everything in the coordinates of the object's mesh, in mm.
struct Crossing {
  Vec3f point;
  Vec3f normal;           // of the triangle, of unit length, outwards
  Vec3f direction;        // of unit length, in which the path, which starts at the camera, goes on
  uint32_t triangle = 0;  // its number in the object's mesh
  bool leaving = false;   // the medium: direction . normal > 0
};

struct BoundarySample {
  enum class Event {
    kAbsorbed,     // the path ends; the rest means nothing
    kTransmitted,  // it goes on on the other side of the boundary
    kReflected     // it goes on on the side that it came from
  } event = Event::kAbsorbed;
  Vec3f direction{};  // of unit length, on the side of the boundary that the event says
  // What the weight of the path is multiplied by: the value of the boundary for the pair of
  // directions, times the cosine, over the density that the direction was drawn with, and over the
  // probability of the event.
  float weight = 0;
};

}  // namespace itn::tracer
