// Threads of torch's that wait for each other must not spin: beside other processes that makes a
// computation take tens of times as long.
#pragma once

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <system_error>

namespace itn {

// For programs that this process becomes: their libraries read it when they are loaded. What a user
// has set counts.
inline void wait_passively() {
  ::setenv("OMP_WAIT_POLICY", "PASSIVE", 0);
  ::setenv("OPENBLAS_NUM_THREADS", "1", 0);
}

// For a program that links torch itself, first thing in main: begins anew unless that is set.
inline void begin_with_passive_waiting(char** argv) {
  if (std::getenv("OMP_WAIT_POLICY") != nullptr) return;
  wait_passively();
  std::error_code none;
  // By its own name, which is what ps shows. If it fails, the program is merely slower.
  ::execv(std::filesystem::read_symlink("/proc/self/exe", none).c_str(), argv);
}

}  // namespace itn
