#include "client/bench/arrivals.h"

#include <cmath>

namespace itn {

double Arrivals::next() {
  if (distribution_ == ArrivalDistribution::kConstant) {
    return static_cast<double>(count_++) / rate_;
  }
  // The gaps of a Poisson process are exponentially distributed: by inversion.
  last_ += -std::log1p(-random_.uniform()) / rate_;
  return last_;
}

}  // namespace itn
