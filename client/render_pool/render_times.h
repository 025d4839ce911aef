// How long renders take, and hence when one is late, and when it will not be answered any more.
#pragma once

#include <chrono>
#include <cstddef>
#include <deque>

namespace itn {

class RenderTimes {
 public:
  // Adds the time of a render of so many samples, from when a worker was asked to its answer.
  void add(std::chrono::steady_clock::duration time, double samples);

  // A render is late after several times the median of the latest ones, which tells a worker that
  // is held from renders that differ. As long as none is known: after some seconds.
  std::chrono::steady_clock::duration straggler_after() const { return straggler_after_; }

  // What none of so many samples should exceed, for a worker that lives and never answers: many
  // times what the slowest of the latest renders would have taken. Zero as long as none is known.
  std::chrono::milliseconds deadline(double samples) const;

 private:
  struct Render {
    std::chrono::steady_clock::duration time;
    double seconds_per_sample;
  };

  std::deque<Render> latest_;
  std::chrono::steady_clock::duration straggler_after_ = std::chrono::seconds(5);
};

}  // namespace itn
