// The numbers below 2^-126, which processors compute many times slower.
#pragma once

#ifdef __SSE__
#include <xmmintrin.h>
#endif

namespace itn::tracer {

// While it lives, they count as 0 in this thread, on processors of x86.
class DenormalsAsZero {
 public:
  DenormalsAsZero() { set(before_ | kBits); }
  ~DenormalsAsZero() { set(before_); }
  DenormalsAsZero(const DenormalsAsZero&) = delete;
  DenormalsAsZero& operator=(const DenormalsAsZero&) = delete;

 private:
  static constexpr unsigned kBits = 0x8040;  // FTZ and DAZ: what comes out, and what goes in
#ifdef __SSE__
  static unsigned get() {
    return _mm_getcsr();
  }
  static void set(unsigned bits) {
    _mm_setcsr(bits);
  }
#else
  static unsigned get() {
    return 0;
  }
  static void set(unsigned /*bits*/) {}
#endif

  const unsigned before_ = get();
};

}  // namespace itn::tracer
