// What the pool is asked for.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "common/scene/scene_bytes.h"
#include "itn/v1/render.pb.h"

namespace itn {

// One render. `request` has neither scene nor digest: the pool fills in what the worker needs.
struct RenderJob {
  std::shared_ptr<const SerializedScene> scene;
  v1::RenderGradRequest request;
};

// Sets a number of the scene or the medium (RenderGradRequest.values).
void set_value(v1::RenderGradRequest& request, const std::string& name, double value);

// What became of all renders of a pool.
struct RenderStatistics {
  uint64_t jobs = 0;         // that succeeded
  uint64_t retries = 0;      // attempts after one that failed
  uint64_t hedges = 0;       // at renders that were late
  uint64_t scenes_sent = 0;  // scenes that a worker did not hold
  double cpu_seconds = 0;    // spent by the workers on what succeeded
};

// For messages: which render it is.
std::string describe(const RenderJob& job);

}  // namespace itn
