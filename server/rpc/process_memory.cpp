#include "server/rpc/process_memory.h"

#include <malloc.h>
#include <unistd.h>

#include <fstream>

namespace itn {

uint64_t resident_memory() {
  std::ifstream file("/proc/self/statm");
  uint64_t size = 0, resident = 0;
  file >> size >> resident;
  return resident * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
}

uint64_t allocated_memory() {
  const struct mallinfo2 heaps = mallinfo2();
  return heaps.uordblks + heaps.hblkhd;
}

void return_freed_memory() {
  mallopt(M_MMAP_THRESHOLD, 1 << 20);
  mallopt(M_TRIM_THRESHOLD, 8 << 20);
  mallopt(M_ARENA_MAX, 4);
}

}  // namespace itn
