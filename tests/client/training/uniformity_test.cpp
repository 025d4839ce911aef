#include "client/training/uniformity.h"

#include <gtest/gtest.h>

#include <cmath>

#include "common/random.h"

namespace itn {
namespace {

// Of tests of what is uniform as many parts are below p as p says, with few numbers and with many.
TEST(Uniformity, PValuesOfUniformNumbersAreUniform) {
  SplitMix random(1);
  for (const size_t count : {8, 200}) {
    constexpr int kTests = 4000;
    int below[2] = {};
    for (int test = 0; test < kTests; ++test) {
      std::vector<double> numbers(count);
      for (double& number : numbers) number = random.uniform();
      const double p = uniformity_p_value(numbers);
      below[0] += p < 0.05 ? 1 : 0;
      below[1] += p < 0.5 ? 1 : 0;
    }
    // Five standard deviations, and what the limit is off for few numbers.
    EXPECT_NEAR(below[0], 0.05 * kTests, 5 * std::sqrt(0.05 * 0.95 * kTests) + 0.005 * kTests);
    EXPECT_NEAR(below[1], 0.5 * kTests, 5 * std::sqrt(0.25 * kTests) + 0.02 * kTests);
  }
}

TEST(Uniformity, WhatIsNotUniformIsTold) {
  std::vector<double> narrow, shifted;
  for (int i = 0; i < 400; ++i) {
    const double u = (i + 0.5) / 400;
    narrow.push_back(0.5 + 0.8 * (u - 0.5));
    shifted.push_back(std::pow(u, 1.4));
  }
  EXPECT_LT(uniformity_p_value(narrow), 1e-3);
  EXPECT_LT(uniformity_p_value(shifted), 1e-3);
  EXPECT_EQ(uniformity_p_value({}), 1);
  EXPECT_GT(uniformity_p_value({0.25, 0.75}), 0.99);
}

}  // namespace
}  // namespace itn
