#include "client/training/shuffled_colours.h"

#include <gtest/gtest.h>

#include <array>
#include <map>
#include <memory>
#include <vector>

#include "tests/support/statistics.h"

namespace itn {
namespace {

constexpr uint32_t kImages = 50;

// Plane p of a batch has the luminance p, the noise -p, and the truth sigma_t = p.
class NumberedPlanes final : public Batches {
 public:
  explicit NumberedPlanes(int64_t channels) : channels_(channels) {}

  TrainingImages batch_at(uint64_t, uint32_t size) override {
    TrainingImages result;
    const int64_t planes = size * channels_;
    const torch::Tensor number = torch::arange(planes, torch::kFloat32).view({-1, 1, 1});
    result.images.channels = channels_;
    result.images.luminance = number.expand({planes, 2, 2});
    result.images.noise = -result.images.luminance;
    result.images.mask = torch::ones({planes, 2, 2});
    for (int64_t p = 0; p < planes; ++p) {
      result.truth.push_back({.sigma_t = static_cast<double>(p), .albedo = 0.5, .g = 0});
    }
    for (uint32_t i = 0; i < size; ++i) result.items.push_back(i);
    return result;
  }
  int resolution() const override { return 2; }
  uint64_t image_count() const override { return kImages; }

 private:
  int64_t channels_;
};

ShuffledColours shuffled(int64_t channels, uint64_t seed = 1) {
  return {std::make_unique<NumberedPlanes>(channels), seed};
}

TEST(ShuffledColours, PlanesMoveWithTheirNoiseAndTruthAndStayInTheirImage) {
  const TrainingImages taken = shuffled(3).batch_at(7, kImages);
  ASSERT_EQ(taken.truth.size(), 3 * kImages);
  for (size_t p = 0; p < taken.truth.size(); ++p) {
    const auto plane = static_cast<int64_t>(p);
    const auto source = static_cast<float>(taken.truth[p].sigma_t);
    EXPECT_TRUE((taken.images.luminance[plane] == source).all().item<bool>());
    EXPECT_TRUE((taken.images.noise[plane] == -source).all().item<bool>());
    EXPECT_EQ(static_cast<size_t>(source) / 3, p / 3);
  }
}

TEST(ShuffledColours, EachOfTheSixOrdersComesOnceInSix) {
  ShuffledColours batches = shuffled(3);
  std::map<std::array<double, 3>, std::vector<double>> seen;
  constexpr uint64_t kSteps = 200;
  std::vector<std::array<double, 3>> orders;
  for (uint64_t step = 0; step < kSteps; ++step) {
    const TrainingImages taken = batches.batch_at(step, kImages);
    for (size_t i = 0; i < kImages; ++i) {
      std::array<double, 3> order;
      for (size_t k = 0; k < 3; ++k) {
        order[k] = taken.truth[3 * i + k].sigma_t - 3.0 * static_cast<double>(i);
      }
      orders.push_back(order);
      seen[order];
    }
  }
  ASSERT_EQ(seen.size(), 6U);
  for (auto& [order, times] : seen) {
    for (const auto& other : orders) times.push_back(order == other ? 1 : 0);
    testing::expect_equal(testing::over_batches(times), {1.0 / 6, 0}, 5, "an order");
  }
}

TEST(ShuffledColours, AFunctionOfSeedAndStep) {
  const auto colours = [](uint64_t seed, uint64_t step) {
    return shuffled(3, seed).batch_at(step, kImages).images.luminance;
  };
  EXPECT_TRUE(torch::equal(colours(1, 4), colours(1, 4)));
  EXPECT_FALSE(torch::equal(colours(1, 4), colours(1, 5)));
  EXPECT_FALSE(torch::equal(colours(1, 4), colours(2, 4)));
}

TEST(ShuffledColours, ImagesOfOnePlaneStayAsTheyAre) {
  const torch::Tensor before = NumberedPlanes(1).batch_at(0, kImages).images.luminance;
  EXPECT_TRUE(torch::equal(shuffled(1).batch_at(0, kImages).images.luminance, before));
}

}  // namespace
}  // namespace itn
