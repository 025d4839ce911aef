// Stopping long work early.
#pragma once

#include <stop_token>
#include <utility>

#include "common/error.h"

namespace itn {

// Throws Error (cancelled) once a stop is asked for.
inline void check_cancelled(const std::stop_token& stop) {
  if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "it was cancelled");
}

// Asks a stop token in loops of short turns: of well below 1 ms, that a stop may take effect within
// 50 ms.
class Cancellation {
 public:
  explicit Cancellation(std::stop_token stop = {}) : stop_(std::move(stop)) {}

  // At every turn of a loop. Throws Error (cancelled) once a stop is asked for.
  void turn() const { check_cancelled(stop_); }

  const std::stop_token& stop() const { return stop_; }

 private:
  std::stop_token stop_;
};

}  // namespace itn
