// How the memory that a server may use is divided.
#pragma once

#include <cstdint>
#include <filesystem>
#include <istream>

namespace itn {

struct MemoryPlan {
  uint64_t message_bytes;    // largest request and largest reply
  uint64_t transport_bytes;  // messages that arrive, in gRPC's hands
  uint64_t call_bytes;       // calls that were accepted, and what is kept for the next ones
};

// Plans the memory of a process that may take `total` bytes, resident, of which `own_bytes` go to
// the program itself. A sixteenth is the largest message, unless `max_message_bytes` is less; an
// eighth is for messages that arrive, and an eighth is kept free (see Listener). Throws Error
// (kUsage) if `total` leaves too little for anything.
MemoryPlan plan_memory(uint64_t total, uint64_t own_bytes, uint64_t max_message_bytes);

// The least `total` that plan_memory() accepts, in whole MiB.
uint64_t least_memory(uint64_t own_bytes);

// What a server may take unless it is told otherwise: 4 GiB, but no more than three quarters of
// what the machine or its control groups have, nor half of its limit of address space (ulimit -v),
// of which threads reserve more than they use.
uint64_t default_memory();

// The least limit in bytes of the control groups of a process, those they are part of included;
// the largest number if there is none. `groups`: its /proc/PID/cgroup; `root`: where they are
// mounted, of either version (cgroups(7)).
uint64_t least_group_limit(std::istream& groups, const std::filesystem::path& root);

}  // namespace itn
