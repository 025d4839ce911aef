#include "server/rpc/process_memory.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace itn {
namespace {

// Memory that is free, but kept by the heap, is not allocated.
TEST(ProcessMemory, TellsWhatIsAllocatedFromWhatIsKept) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "sanitizers have a heap of their own";
#endif
  constexpr size_t kBlock = 10'000, kBlocks = 2000;  // each too small to be mapped alone
  const uint64_t before = allocated_memory();
  std::vector<std::unique_ptr<char[]>> blocks;
  for (size_t i = 0; i < kBlocks; ++i) blocks.push_back(std::make_unique<char[]>(kBlock));
  const auto above = [&](uint64_t now) { return static_cast<double>(now - before); };
  EXPECT_NEAR(above(allocated_memory()), kBlock * kBlocks, 0.02 * kBlock * kBlocks);
  EXPECT_GT(resident_memory(), allocated_memory());
  // The last block stays: what is below it in the heap cannot go back to the system.
  blocks.erase(blocks.begin(), blocks.end() - 1);
  EXPECT_LT(above(allocated_memory()), 0.02 * kBlock * kBlocks);
  EXPECT_GT(resident_memory(), kBlock * kBlocks);
}

}  // namespace
}  // namespace itn
