// Which pixels see the object. Internal to the tracer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {

// In order: those where one of kMaskRays x kMaskRays camera rays, spread evenly over the pixel,
// meets the object.
struct ObjectPixels {
  static constexpr int kMaskRays = 4;

  // On `threads` threads; 0: all. Throws Error (cancelled) within milliseconds after a stop is
  // requested.
  ObjectPixels(const Scene::Compiled& scene, int threads, const std::stop_token& stop);

  size_t memory() const { return sizeof(*this) + pixels.size() * sizeof(uint32_t); }

  std::vector<uint32_t> pixels;
};

}  // namespace itn::tracer
