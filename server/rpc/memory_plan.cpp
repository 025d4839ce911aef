#include "server/rpc/memory_plan.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>

#include "common/error.h"

namespace itn {
namespace {

constexpr uint64_t kMiB = uint64_t{1} << 20;
constexpr uint64_t kMinForCalls = 64 * kMiB;

}  // namespace

MemoryPlan plan_memory(uint64_t total, uint64_t own_bytes, uint64_t max_message_bytes) {
  MemoryPlan plan{.message_bytes = std::min(max_message_bytes, total / 16),
                  .transport_bytes = total / 8,
                  .call_bytes = 0};
  // The listener closes connections when the last eighth is touched: it is left free.
  const uint64_t taken = own_bytes + plan.transport_bytes + total / 8;
  if (total < taken + kMinForCalls) {
    throw Error(ErrorKind::kUsage, fmt::format("--max-memory-mb is {}; it must be at least {}",
                                               total / kMiB, least_memory(own_bytes) / kMiB));
  }
  plan.call_bytes = total - taken;
  return plan;
}

uint64_t least_memory(uint64_t own_bytes) {
  // A quarter is for messages that arrive, or left free.
  const uint64_t rest = own_bytes + kMinForCalls;
  return (rest * 4 + 3 * kMiB - 1) / (3 * kMiB) * kMiB;
}

uint64_t least_group_limit(std::istream& groups, const std::filesystem::path& root) {
  uint64_t least = std::numeric_limits<uint64_t>::max();
  // Lines are ID:CONTROLLERS:PATH, without controllers: version 2.
  for (std::string id, controllers, path; std::getline(groups, id, ':') &&
                                          std::getline(groups, controllers, ':') &&
                                          std::getline(groups, path);) {
    if (!controllers.empty()) continue;
    // In a container the path may be the host's, which is not there: the group is then the root.
    for (auto group = std::filesystem::path(path).relative_path();; group = group.parent_path()) {
      std::ifstream file(root / group / "memory.max");
      if (uint64_t limit = 0; file >> limit) least = std::min(least, limit);  // or "max"
      if (group.empty()) break;
    }
  }
  return least;
}

uint64_t default_memory() {
  uint64_t most =
      static_cast<uint64_t>(sysconf(_SC_PHYS_PAGES)) * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
  std::ifstream groups("/proc/self/cgroup");
  most = std::min(most, least_group_limit(groups, "/sys/fs/cgroup"));
  most = std::min(4096 * kMiB, most / 4 * 3);
  rlimit limit = {};
  if (getrlimit(RLIMIT_AS, &limit) == 0) most = std::min<uint64_t>(most, limit.rlim_cur / 2);
  return most;
}

}  // namespace itn
