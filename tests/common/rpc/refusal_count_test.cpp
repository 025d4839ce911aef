#include "common/rpc/refusal_count.h"

#include <gtest/gtest.h>

namespace itn {
namespace {

TEST(RefusalCount, TellsTheFirstAtOnceAndThoseAfterItTogether) {
  RefusalCount count;
  const RefusalCount::Clock::time_point start;
  EXPECT_EQ(count.add(start), 1U);
  EXPECT_EQ(count.add(start), std::nullopt);
  EXPECT_EQ(count.add(start + RefusalCount::kTellEvery / 2), std::nullopt);
  EXPECT_EQ(count.add(start + RefusalCount::kTellEvery), 3U);
  EXPECT_EQ(count.add(start + RefusalCount::kTellEvery), std::nullopt);
  EXPECT_EQ(count.add(start + 5 * RefusalCount::kTellEvery), 2U);
}

}  // namespace
}  // namespace itn
