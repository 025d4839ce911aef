#include "client/training/first_order_augmentation.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "tests/client/training/training_fixture.h"
#include "tests/support/expect_error.h"
#include "tests/support/statistics.h"

namespace itn {
namespace {

class MovedMaterialsTest : public TrainingTest {
 protected:
  MovedMaterialsTest() {
    // Estimates that only their mean is right of.
    images_.derivatives = [exact = images_.derivatives](size_t i) {
      DerivativeImages images = exact(i);
      for (size_t k = 0; k < 3; ++k) {
        for (float& d : images[0][k]) d *= 1.5F;
        for (float& d : images[1][k]) d *= 0.5F;
      }
      return images;
    };
    derivatives_.emplace(images_, kSize, folder_);
  }

  FirstOrderAugmentation moved(double step, uint64_t seed = 1) {
    return {std::make_unique<DatasetBatches>(images_, *inputs_, 3), *derivatives_, bounds_, step,
            seed};
  }

  v1::MaterialRange bounds_ = prediction_bounds(range_);
  std::optional<PackedDerivatives> derivatives_;
};

// The formula in the place of the renderer is linear in the material, so that "to first order" is
// exact.
TEST_F(MovedMaterialsTest, ImagesAreThoseOfTheNewTruth) {
  FirstOrderAugmentation batches = moved(0.3);
  const TrainingImages taken = batches.batch_at(5, kItems);
  for (size_t i = 0; i < taken.items.size(); ++i) {
    const std::vector<float> expected = render(taken.truth[i], 0, 0).radiance;
    const torch::Tensor image = taken.images.luminance[static_cast<int64_t>(i)].flatten();
    for (size_t p = 0; p < kPixels; ++p) {
      EXPECT_NEAR(image[static_cast<int64_t>(p)].item<float>(), std::max(expected[p], 0.0F), 1e-4);
    }
  }
}

// A step that stays inside of the bounds is a normal number in each coordinate.
TEST_F(MovedMaterialsTest, StepsAreAsLongAsTheyShouldBeAndEndInsideOfTheBounds) {
  constexpr double kStep = 0.05;
  FirstOrderAugmentation batches = moved(kStep);
  const Box box = to_box(bounds_);
  std::array<std::vector<double>, 3> squares;
  for (uint64_t step = 0; step < 400; ++step) {
    const TrainingImages taken = batches.batch_at(step, kItems);
    for (size_t i = 0; i < taken.items.size(); ++i) {
      const Material &from = images_.truth[taken.items[i]], &to = taken.truth[i];
      EXPECT_GE(to.sigma_t, box.min[0]);
      EXPECT_LE(to.g, box.max[2]);
      const MaterialCoordinates a = to_coordinates(v1::UNBOUNDED, from, g_interval(bounds_));
      const MaterialCoordinates b = to_coordinates(v1::UNBOUNDED, to, g_interval(bounds_));
      if (a == b) continue;
      for (size_t k = 0; k < 3; ++k) squares[k].push_back(std::pow((b[k] - a[k]) / kStep, 2));
    }
  }
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_GT(squares[k].size(), 4000U);
    // Steps outwards of the few materials near a bound are missing: a hundredth of all at most.
    testing::expect_equal(testing::over_batches(squares[k]), {1, 0.01}, 5,
                          "coordinate " + std::to_string(k));
  }
}

TEST_F(MovedMaterialsTest, AFunctionOfSeedAndStep) {
  FirstOrderAugmentation first = moved(0.3), again = moved(0.3), other = moved(0.3, 2);
  const TrainingImages a = first.batch_at(2, kItems), b = again.batch_at(2, kItems);
  EXPECT_TRUE(torch::equal(a.images.luminance, b.images.luminance));
  EXPECT_FALSE(torch::equal(a.images.luminance, other.batch_at(2, kItems).images.luminance));
  EXPECT_FALSE(torch::equal(a.images.luminance, first.batch_at(3, kItems).images.luminance));
  EXPECT_TRUE(torch::equal(a.images.mask,
                           DatasetBatches(images_, *inputs_, 3).batch_at(2, kItems).images.mask));
}

TEST_F(MovedMaterialsTest, TakesTheRegressionLoss) {
  v1::TrainingConfig rn = config(v1::TrainingConfig::RN), itn = config(v1::TrainingConfig::ITN);
  rn.mutable_augmentation()->set_first_order_step(0.3);
  itn.mutable_augmentation()->set_first_order_step(0.3);
  // The weight map would be that of the image before.
  testing::expect_error(ErrorKind::kInvalidInput, {"first_order_step", "RATIOS"},
                        [&] { validate(rn); });
  rn.set_input(v1::RATIOS);
  itn.set_input(v1::RATIOS);
  EXPECT_NO_THROW(validate(rn));
  testing::expect_error(ErrorKind::kInvalidInput, {"first_order_step", "RN"},
                        [&] { validate(itn); });
}

}  // namespace
}  // namespace itn
