// The order that a parallel loop keeps: what came before it, its iterations, what comes after it.
// TBB is not built with the thread sanitizer, which therefore has to be told. Does nothing
// otherwise.
#pragma once

#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
#endif

namespace itn::tracer {

#ifdef __SANITIZE_THREAD__
class ForkJoin {
 public:
  void before_loop() { __tsan_release(&fork_); }
  void begin_iteration() { __tsan_acquire(&fork_); }
  void end_iteration() { __tsan_release(&join_); }
  void after_loop() { __tsan_acquire(&join_); }

 private:
  char fork_ = 0, join_ = 0;
};
#else
class ForkJoin {
 public:
  void before_loop() {}
  void begin_iteration() {}
  void end_iteration() {}
  void after_loop() {}
};
#endif

}  // namespace itn::tracer
