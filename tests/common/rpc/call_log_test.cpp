#include "common/rpc/call_log.h"

#include <gtest/gtest.h>

#include <chrono>

namespace itn {
namespace {

using namespace std::chrono_literals;

TEST(CallLog, WritesSoManyLinesASecondAndSaysHowManyItLeftOut) {
  CallLog log;
  const CallLog::Clock::time_point start = CallLog::Clock::time_point() + 1h;
  uint64_t left_out = 0;
  for (int i = 0; i < CallLog::kLinesPerSecond; ++i) EXPECT_TRUE(log.admits(left_out, start));
  for (int i = 0; i < 7; ++i) EXPECT_FALSE(log.admits(left_out, start + 900ms));
  EXPECT_TRUE(log.admits(left_out, start + 1s));
  EXPECT_EQ(left_out, 7U);
  EXPECT_TRUE(log.admits(left_out, start + 1s));
  EXPECT_EQ(left_out, 0U);
}

}  // namespace
}  // namespace itn
