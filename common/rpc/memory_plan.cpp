#include "common/rpc/memory_plan.h"

#include <fmt/format.h>
#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>

#include "common/error.h"

namespace itn {
namespace {

constexpr uint64_t kMiB = uint64_t{1} << 20;
constexpr uint64_t kLeastForCalls = 64 * kMiB;

}  // namespace

MemoryPlan plan_memory(uint64_t total, uint64_t own_bytes, uint64_t max_message_bytes) {
  MemoryPlan plan{.message_bytes = std::min(max_message_bytes, total / 16),
                  .transport_bytes = total / 8,
                  .call_bytes = 0};
  // The listener closes connections when the last eighth is touched: it is left free.
  const uint64_t taken = own_bytes + plan.transport_bytes + total / 8;
  if (total < taken + kLeastForCalls) {
    throw Error(ErrorKind::kUsage, fmt::format("--max-memory-mb is {}; it must be at least {}",
                                               total / kMiB, least_memory(own_bytes) / kMiB));
  }
  plan.call_bytes = total - taken;
  return plan;
}

uint64_t least_memory(uint64_t own_bytes) {
  // A quarter is for messages that arrive, or left free.
  const uint64_t rest = own_bytes + kLeastForCalls;
  return (rest * 4 + 3 * kMiB - 1) / (3 * kMiB) * kMiB;
}

uint64_t default_memory() {
  uint64_t most =
      static_cast<uint64_t>(sysconf(_SC_PHYS_PAGES)) * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
  uint64_t group = 0;
  if (std::ifstream file("/sys/fs/cgroup/memory.max"); file >> group) most = std::min(most, group);
  most = std::min(4096 * kMiB, most / 4 * 3);
  rlimit limit = {};
  if (getrlimit(RLIMIT_AS, &limit) == 0) most = std::min<uint64_t>(most, limit.rlim_cur / 2);
  return most;
}

void return_freed_memory() {
  mallopt(M_MMAP_THRESHOLD, 1 << 20);
  mallopt(M_TRIM_THRESHOLD, 8 << 20);
  mallopt(M_ARENA_MAX, 4);
}

}  // namespace itn
