// How long renders take, and hence when one is late.
#pragma once

#include <chrono>
#include <cstddef>
#include <deque>

namespace itn {

class RenderTimes {
 public:
  void add(std::chrono::steady_clock::duration time);

  // A render is late after several times the median of the latest ones, which tells a worker that
  // is held from renders that differ. As long as none is known: after some seconds.
  std::chrono::steady_clock::duration late_after() const;

 private:
  std::deque<std::chrono::steady_clock::duration> latest_;
};

}  // namespace itn
