#include "client/dataset/sampler.h"

#include <algorithm>
#include <set>

#include <gmock/gmock.h>

namespace itn {
namespace {

TEST(Sampler, EveryEpochShowsEveryItemOnce) {
  EpochSampler sampler(10, 1);
  std::vector<uint32_t> shown;
  for (uint64_t step = 0; step < 10; ++step) {  // 3 epochs in batches of 3
    std::ranges::copy(sampler.batch(step, 3), std::back_inserter(shown));
  }
  for (int epoch = 0; epoch < 3; ++epoch) {
    EXPECT_EQ(std::set(shown.begin() + 10 * epoch, shown.begin() + 10 * (epoch + 1)).size(), 10);
  }
  EXPECT_FALSE(std::equal(shown.begin(), shown.begin() + 10, shown.begin() + 10));
}

TEST(Sampler, ABatchDependsOnItsStepAlone) {
  EpochSampler straight(7, 5);
  for (uint64_t step = 0; step < 6; ++step) {
    EpochSampler restarted(7, 5);
    EXPECT_EQ(straight.batch(step, 4), restarted.batch(step, 4));
  }
}

TEST(Sampler, ABatchMayBeLargerThanTheSet) {
  EpochSampler sampler(3, 5);
  const std::vector<uint32_t> batch = sampler.batch(0, 7);
  for (uint32_t item = 0; item < 3; ++item) EXPECT_GE(std::ranges::count(batch, item), 2);
}

}  // namespace
}  // namespace itn
