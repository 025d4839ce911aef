#include "server/rpc/memory_budget.h"

#include <fmt/format.h>

#include <algorithm>

#include "common/error.h"
#include "common/rpc/status.h"

namespace itn {
namespace {

uint64_t in_mb(uint64_t bytes) {
  return (bytes + (uint64_t{1} << 20) - 1) >> 20;
}

}  // namespace

MemoryBudget::Share::~Share() {
  const std::lock_guard lock(budget_.mutex_);
  budget_.used_ -= bytes_;
}

void MemoryBudget::Share::resize(uint64_t bytes, uint64_t own_beside) {
  const std::lock_guard lock(budget_.mutex_);
  const uint64_t total = budget_.total_;
  if (total > 0 && bytes > bytes_) {
    const uint64_t taken = budget_.used_ - bytes_ + budget_.hooks_.beside();
    if (bytes > total - std::min(total, own_beside)) {
      throw Error(ErrorKind::kLimit,
                  fmt::format("the request takes about {} MiB of memory; this server has {} MiB "
                              "for requests: ask for less, or start it with more --max-memory-mb",
                              in_mb(bytes + own_beside), in_mb(total)));
    }
    if (bytes > total - std::min(total, taken)) {
      throw busy(fmt::format("this server is busy: {} of the {} MiB of memory for requests are "
                             "taken, and this one takes {}",
                             in_mb(taken), in_mb(total), in_mb(bytes)),
                 budget_.hooks_.retry_after());
    }
  }
  budget_.used_ += bytes - bytes_;
  bytes_ = bytes;
}

uint64_t MemoryBudget::used() const {
  const std::lock_guard lock(mutex_);
  return used_ + hooks_.beside();
}

}  // namespace itn
