#include "common/rpc/memory_budget.h"

#include <fmt/format.h>

#include "common/error.h"
#include "common/rpc/status.h"

namespace itn {
namespace {

// When memory that others hold may be free again is anyone's guess.
constexpr double kRetryAfterSeconds = 1;

uint64_t in_mb(uint64_t bytes) {
  return (bytes + (uint64_t{1} << 20) - 1) >> 20;
}

}  // namespace

void MemoryBudget::Share::resize(uint64_t bytes) {
  const std::lock_guard lock(budget_.mutex_);
  const uint64_t others = budget_.used_ - bytes_, total = budget_.total_;
  if (total > 0 && bytes > bytes_) {
    if (bytes > total) {
      throw Error(ErrorKind::kLimit,
                  fmt::format("the request takes about {} MiB of memory; this server has {} MiB "
                              "for requests: ask for less, or start it with more --max-memory-mb",
                              in_mb(bytes), in_mb(total)));
    }
    if (bytes > total - others) {
      throw busy(fmt::format("this server is busy: {} of the {} MiB of memory for requests are "
                             "taken, and this one takes {}",
                             in_mb(others), in_mb(total), in_mb(bytes)),
                 kRetryAfterSeconds);
    }
  }
  budget_.used_ = others + bytes;
  bytes_ = bytes;
}

uint64_t MemoryBudget::used() const {
  const std::lock_guard lock(mutex_);
  return used_;
}

}  // namespace itn
