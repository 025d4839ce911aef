// When the calls of an open loop are due.
#pragma once

#include <cstdint>

#include "common/random.h"

namespace itn {

enum class ArrivalDistribution {
  kConstant,  // one every 1 / rate seconds
  kPoisson,   // independent of each other, as those of many clients who know nothing of each other
};

// An endless sequence of times, which nothing that a server does changes.
class Arrivals {
 public:
  // `rate` in calls per second, > 0. `seed`: of those that are random.
  Arrivals(double rate, ArrivalDistribution distribution, uint64_t seed)
      : rate_(rate), distribution_(distribution), random_(seed) {}

  // In seconds from the beginning, each no sooner than the one before it.
  double next();

 private:
  const double rate_;
  const ArrivalDistribution distribution_;
  SplitMix random_;
  uint64_t count_ = 0;
  double last_ = 0;
};

}  // namespace itn
