// Processor time, which neighbours on the machine disturb less than the clock's.
#pragma once

#include <time.h>

namespace itn::testing {

// That this process has used so far, all threads together, in seconds.
inline double own_cpu_seconds() {
  timespec used{};
  return ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used) == 0
             ? static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec)
             : 0;
}

}  // namespace itn::testing
