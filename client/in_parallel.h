// The same work for each of many, by all processors.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <stop_token>

#include "common/error.h"
#include "common/threads.h"

namespace itn {

// Calls work(0) .. work(count - 1), some at a time. Throws what one of them throws, and Error
// (cancelled) soon after a stop is requested; calls no others then.
inline void in_parallel(size_t count, const std::stop_token& stop,
                        const std::function<void(size_t)>& work) {
  std::atomic<size_t> next = 0;
  on_threads(thread_count(0), [&](size_t) {
    try {
      for (size_t i = next++; i < count; i = next++) {
        if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
        work(i);
      }
    } catch (...) {
      next = count;
      throw;
    }
  });
}

}  // namespace itn
