// One path from the camera: an estimate of the radiance and of its derivatives.
#pragma once

#include <array>
#include <cstdint>
#include <stop_token>

#include "server/tracer/compiled_scene.h"
#include "server/tracer/random.h"
#include "server/tracer/render.h"

namespace itn::tracer {

struct PathEstimate {
  double radiance = 0;
  std::array<double, kCoordinates> derivatives{};
  bool hit = false;     // the camera ray meets the object
  bool leaked = false;  // to be dropped
  uint32_t steps = 0;   // free flights inside the medium
};

// Estimates the radiance that arrives at a random point of a pixel. Throws Cancelled if stopped.
PathEstimate trace_path(const Scene::Compiled& scene, const RenderSettings& settings, int x, int y,
                        const SampleRandom& random, const std::stop_token& stop);

}  // namespace itn::tracer
