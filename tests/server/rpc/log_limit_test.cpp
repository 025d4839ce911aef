#include "server/rpc/log_limit.h"

#include <gtest/gtest.h>

#include <chrono>

namespace itn {
namespace {

using namespace std::chrono_literals;

TEST(LogLimit, AdmitsSoManyLinesAndSaysHowManyItLeftOut) {
  LogLimit limit(3, 10s);
  const LogLimit::Clock::time_point start;
  for (int i = 0; i < 3; ++i) EXPECT_EQ(limit.admit(start), 0U);
  for (int i = 0; i < 7; ++i) EXPECT_EQ(limit.admit(start + 9s), std::nullopt);
  EXPECT_EQ(limit.admit(start + 10s), 7U);
  EXPECT_EQ(limit.admit(start + 10s), 0U);
}

}  // namespace
}  // namespace itn
