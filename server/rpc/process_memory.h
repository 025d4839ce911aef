// The memory of this process.
#pragma once

#include <cstdint>

namespace itn {

// In bytes, resident.
uint64_t resident_memory();

// In bytes: what was allocated and not freed, whether it was written to or not. Growth of this for
// days is a leak; resident memory, which has also what the heap keeps for later, may grow in steps
// for hours before it has its size. Takes milliseconds where much is free. (0 under sanitizers,
// which have a heap of their own.)
uint64_t allocated_memory();

// From now on large arrays go back to the system when they are freed, so that what is resident is
// what is in use; and threads share a few heaps, as each reserves address space. Call it first in
// main().
void return_freed_memory();

}  // namespace itn
