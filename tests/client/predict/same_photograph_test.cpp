#include "client/predict/same_photograph.h"

#include <gmock/gmock.h>

#include <cmath>
#include <random>

#include "tests/support/expect_error.h"

namespace itn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// A ball lit from an angle, with noise of its own.
PredictInput ball(const std::string& name, double angle, unsigned seed, double noise = 0.05,
                  float exposure = 1) {
  constexpr int kBallSide = 128;
  PredictInput input;
  input.name = name;
  FramedPhotograph& photograph = input.photograph;
  photograph.side = kBallSide;
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(1, noise);
  for (int y = 0; y < kBallSide; ++y) {
    for (int x = 0; x < kBallSide; ++x) {
      const double u = 2.4 * x / kBallSide - 1.2, v = 2.4 * y / kBallSide - 1.2;
      const double light = 1 + u * std::cos(angle) + v * std::sin(angle);
      photograph.mask.push_back(u * u + v * v < 1 ? 1 : 0);
      photograph.pixels.push_back(exposure * static_cast<float>(light * normal(random)));
    }
  }
  return input;
}

TEST(SamePhotograph, ABurstCountsOnce) {
  const std::vector<PredictInput> photographs = {ball("a", 0, 1), ball("b", 0.02, 2, 0.05, 3),
                                                 ball("c", 1, 3)};
  std::vector<std::string> told;
  const auto different = different_photographs(photographs, told);
  ASSERT_EQ(different.size(), 2U);
  EXPECT_EQ(photographs[different[0]].name, "a");
  EXPECT_EQ(photographs[different[1]].name, "c");
  EXPECT_THAT(told, ElementsAre(HasSubstr("b is nearly the same photograph as a")));
}

TEST(SamePhotograph, TwiceTheSameIsRefused) {
  const std::vector<PredictInput> photographs = {ball("a", 0, 1), ball("b", 0, 1)};
  std::vector<std::string> told;
  testing::expect_error(ErrorKind::kInvalidInput, {"a and b are the same photograph"},
                        [&] { different_photographs(photographs, told); });
}

}  // namespace
}  // namespace itn
