// The memory of this process.
#pragma once

#include <cstdint>

namespace itn {

// In bytes, resident.
uint64_t resident_memory();

// In bytes: what was allocated and not freed. The rest of the resident memory is the program
// itself, and what the heap keeps for later: that moves in steps, and may grow for hours before it
// has its size. Growth of this is a leak. (0 under sanitizers, which have a heap of their own.)
uint64_t allocated_memory();

// From now on large arrays go back to the system when they are freed, so that what is resident is
// what is in use; and threads share a few heaps, as each reserves address space. Call it first in
// main().
void return_freed_memory();

}  // namespace itn
