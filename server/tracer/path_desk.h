// Where the tracers get their orders from, and deliver what became of them. Internal to the tracer.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "server/tracer/render.h"

namespace itn::tracer {

// A path to be traced.
struct PathOrder {
  uint32_t pixel = 0;
  uint32_t sample = 0;
  float baseline = 0;  // radiance to expect, for the derivatives' control variates
};

// What one path from the camera contributes to its pixel.
struct PathEstimate {
  double radiance = 0;
  std::array<double, kCoordinates> derivatives{};
  std::array<double, kMaxAlbedos> at_albedos{};  // radiance for RenderSettings::albedos
  bool hit = false;                              // the camera ray meets the object
  bool leaked = false;                           // to be dropped
  uint32_t steps = 0;                            // free flights inside the medium
};

// Used by one thread.
class PathDesk {
 public:
  virtual ~PathDesk() = default;
  // Fills some of `orders`, from the front, and returns how many; 0: there are no more.
  virtual size_t take(std::span<PathOrder> orders) = 0;
  virtual void deliver(const PathOrder& order, const PathEstimate& estimate) = 0;
};

}  // namespace itn::tracer
