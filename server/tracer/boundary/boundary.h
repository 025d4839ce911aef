// What happens to light where it crosses the boundary of the medium: the contract between the
// tracers and whatever the boundary is made of.
//
// Without a model the boundary is index-matched: light passes as if it were not there. Both tracers
// know this case without asking anybody, and a line runs through any number of entries and exits in
// one go.
//
// Otherwise they ask a BoundaryModel at every crossing. There are two kinds:
//   straight: light that passes goes on in its direction, less what is lost. A line runs through as
//     before and gathers the transmittances on its way; so do shadow rays, and next-event
//     estimation remains what it is;
//   bending: a line ends at the boundary, and the crossing is a vertex of the path, where the model
//     draws the direction to go on with. Shadow rays end at the boundary and bring nothing, as the
//     straight line to the light is not a path of light. In return, nothing competes with the walk
//     for the light that it meets on the line behind such a crossing: no weight of multiple
//     importance sampling applies there. DistantLight, which no walk meets by itself, is thus not
//     seen through a boundary that bends.
// A path of the second kind that crosses more than kMaxConsecutiveCrossings times in a row, without
// scattering or reflection by a surface in between, counts as trapped by rounding, and is dropped
// as leaked.
//
// The model takes no part in derivatives: what it returns must not depend on a parameter that is
// differentiated. A smooth dielectric is a bending model: a coin against the Fresnel reflectance
// chooses between the mirrored direction and Snell's, with a delta density (pdf 0) and weight 1,
// times the squared ratio of the indices where radiance is transmitted.
#pragma once

#include <array>
#include <cstdint>

#include "common/vec.h"

namespace itn::tracer {

// A line meets the boundary. Everything in the coordinates of the object's mesh, in mm.
struct BoundaryInteraction {
  Vec3f point;
  Vec3f normal;           // of the triangle, of unit length, outwards
  Vec3f direction;        // of unit length, in which the path, which starts at the camera, goes on
  uint32_t triangle = 0;  // its number in the object's mesh
  bool leaving = false;   // the medium: direction . normal > 0
};

// How a path goes on behind an interaction.
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
  // That density, per steradian and with the probability of the event; 0: the direction is the only
  // one possible (a delta). No technique competes with it today, so that nothing reads it but one
  // that would connect the boundary to the lights.
  float pdf = 0;
};

class BoundaryModel {
 public:
  static constexpr uint32_t kMaxConsecutiveCrossings = 1000;

  virtual ~BoundaryModel() = default;

  // Which kind it is; the same answer always. Called from many threads, like the others.
  virtual bool straight() const = 0;

  // Asked of straight models alone: the fraction of the radiance that passes, in [0, 1]. Light that
  // comes from the other side along the same line loses as much.
  virtual float transmittance(const BoundaryInteraction& at) const = 0;

  // Asked of bending models alone: draws how a path goes on. `u` are uniform in [0, 1).
  virtual BoundarySample sample(const BoundaryInteraction& at,
                                const std::array<float, 5>& u) const = 0;
};

}  // namespace itn::tracer
