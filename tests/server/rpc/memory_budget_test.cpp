#include "server/rpc/memory_budget.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/error.h"
#include "common/rpc/status.h"
#include "itn/v1/render.pb.h"

namespace itn {
namespace {

TEST(MemoryBudget, IsSharedAndGivenBack) {
  MemoryBudget budget(100);
  MemoryBudget::Share one(budget);
  one.resize(60);
  {
    MemoryBudget::Share other(budget);
    other.resize(40);
    EXPECT_EQ(budget.used(), 100U);
    EXPECT_THROW(other.resize(41), StatusError);
    EXPECT_EQ(other.bytes(), 40U);
    other.resize(10);
    EXPECT_EQ(budget.used(), 70U);
  }
  EXPECT_EQ(budget.used(), 60U);
  one.resize(100);
  EXPECT_EQ(budget.used(), 100U);
}

TEST(MemoryBudget, TellsWhatWillNeverFitFromWhatDoesNotFitNow) {
  MemoryBudget budget(100);
  MemoryBudget::Share one(budget), other(budget);
  one.resize(60);
  try {
    other.resize(101);
    FAIL() << "fits";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kLimit);
  }
  try {
    other.resize(41);
    FAIL() << "fits";
  } catch (const StatusError& error) {
    EXPECT_EQ(error.status().error_code(), grpc::UNAVAILABLE);
    v1::Busy details;
    ASSERT_TRUE(details.ParseFromString(error.status().error_details()));
    EXPECT_GT(details.retry_after_seconds(), 0);
  }
}

TEST(MemoryBudget, WithoutALimitHasNone) {
  MemoryBudget budget(0);
  MemoryBudget::Share one(budget);
  one.resize(uint64_t{1} << 60);
  EXPECT_EQ(budget.used(), uint64_t{1} << 60);
}

}  // namespace
}  // namespace itn
