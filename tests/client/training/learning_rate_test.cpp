#include "client/training/learning_rate.h"

#include <gtest/gtest.h>

namespace itn {
namespace {

v1::TrainingConfig cosine(uint64_t steps, uint64_t warmup_steps) {
  v1::TrainingConfig config;
  config.set_schedule(v1::TrainingConfig::COSINE);
  config.set_steps(steps);
  config.set_warmup_steps(warmup_steps);
  config.set_learning_rate(0.01);
  return config;
}

TEST(LearningRateTest, IsConstantUnlessToldOtherwise) {
  v1::TrainingConfig config = cosine(100, 10);
  config.set_schedule(v1::TrainingConfig::CONSTANT);
  EXPECT_EQ(learning_rate(config, 0), 0.01);
  EXPECT_EQ(learning_rate(config, 99), 0.01);
}

TEST(LearningRateTest, RisesThenFallsAlongACosineToAHundredth) {
  const v1::TrainingConfig config = cosine(111, 10);
  EXPECT_DOUBLE_EQ(learning_rate(config, 0), 0.001);
  EXPECT_DOUBLE_EQ(learning_rate(config, 4), 0.005);
  EXPECT_DOUBLE_EQ(learning_rate(config, 10), 0.01);
  EXPECT_DOUBLE_EQ(learning_rate(config, 60), 0.01 * (0.01 + 0.99 / 2));
  EXPECT_DOUBLE_EQ(learning_rate(config, 110), 0.0001);
  for (uint64_t step = 11; step < 111; ++step) {
    EXPECT_LT(learning_rate(config, step), learning_rate(config, step - 1));
  }
}

TEST(LearningRateTest, IsPositiveForTheShortestRuns) {
  EXPECT_DOUBLE_EQ(learning_rate(cosine(1, 0), 0), 0.01);
  EXPECT_GT(learning_rate(cosine(2, 1), 1), 0);
}

}  // namespace
}  // namespace itn
