// Deadlines of calls.
#pragma once

#include <grpc/support/time.h>
#include <grpcpp/support/time.h>

#include <chrono>
#include <cstdint>

namespace itn {

// The deadline that lies `time` from now, for grpc::ClientContext::set_deadline(). It is of the
// monotonic clock: a jump of the time of day neither ends the call nor lets it go on.
inline gpr_timespec deadline_in(std::chrono::duration<double> time) {
  return gpr_time_add(gpr_now(GPR_CLOCK_MONOTONIC),
                      gpr_time_from_nanos(static_cast<int64_t>(1e9 * time.count()), GPR_TIMESPAN));
}

}  // namespace itn
