// What became of all renders of a pool.
#pragma once

#include <cstdint>

namespace itn {

struct RenderStatistics {
  uint64_t jobs = 0;         // that succeeded
  uint64_t retries = 0;      // attempts after one that failed
  uint64_t hedges = 0;       // at renders that were late
  uint64_t scenes_sent = 0;  // scenes that a worker did not hold
  double cpu_seconds = 0;    // spent by the workers on what succeeded
};

}  // namespace itn
