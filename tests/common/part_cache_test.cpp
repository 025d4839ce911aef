// Memory that runs out while a part is built, at every place where it may.
#include "common/part_cache.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <new>
#include <string>

namespace {

// Counts of this thread: allocations until one fails (below 0: none does), and those not yet freed.
thread_local int allocations_left = -1;
thread_local int allocations_held = 0;

}  // namespace

void* operator new(size_t size) {
  if (allocations_left == 0) throw std::bad_alloc();
  if (allocations_left > 0) --allocations_left;
  void* const memory = std::malloc(size);
  if (memory == nullptr) throw std::bad_alloc();
  ++allocations_held;
  return memory;
}
void operator delete(void* memory) noexcept {
  if (memory != nullptr) --allocations_held;
  std::free(memory);
}
void operator delete(void* memory, size_t /*size*/) noexcept {
  operator delete(memory);
}

namespace itn::tracer {
namespace {

struct Part {
  size_t memory() const { return sizeof *this; }
};

TEST(PartCache, WithoutMemoryForAPartIsAsBefore) {
  PartCache cache(0);
  const std::string key(100, 'k');
  const auto build = [] { return std::make_shared<const Part>(); };
  cache.get<Part>("first", {}, build);  // the table's own memory stays
  cache.trim();
  std::shared_ptr<const Part> built;
  int failures = 0;
  for (; !built; ++failures) {
    ASSERT_LT(failures, 100);
    const int before = allocations_held;
    allocations_left = failures;
    try {
      built = cache.get<Part>(key, {}, build);
    } catch (const std::bad_alloc&) {
    }
    allocations_left = -1;
    if (!built) {
      EXPECT_EQ(allocations_held, before) << "where allocation " << failures << " fails";
      EXPECT_EQ(cache.find<Part>(key), nullptr);
      EXPECT_EQ(cache.memory(), 0U);
    }
  }
  EXPECT_GE(failures, 4);  // of two tables and a part at least
  EXPECT_EQ(cache.find<Part>(key), built);
}

TEST(PartCache, BuildsAgainWhatFailedForWantOfMemory) {
  PartCache cache(size_t{1} << 20);
  EXPECT_THROW(
      cache.get<Part>("a", {}, []() -> std::shared_ptr<const Part> { throw std::bad_alloc(); }),
      std::bad_alloc);
  EXPECT_NE(cache.get<Part>("a", {}, [] { return std::make_shared<const Part>(); }), nullptr);
}

}  // namespace
}  // namespace itn::tracer
