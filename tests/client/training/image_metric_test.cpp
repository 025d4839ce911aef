#include "client/training/image_metric.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "common/learning/weight_map.h"
#include "tests/client/training/training_fixture.h"
#include "tests/support/expect_error.h"
#include "tests/support/statistics.h"

namespace itn {
namespace {

const Material kTruth{100, 0.7, 0.3};
const std::vector<float> kWeight(kPixels, 0.5F);

DerivativeImages derivatives_of(const RenderEstimate& a, const RenderEstimate& b) {
  DerivativeImages result;
  for (size_t i = 0; i < 3; ++i) {
    result[0][i] = a.derivatives[i];
    result[1][i] = b.derivatives[i];
  }
  return result;
}

// The formula in the place of the renderer is linear in the material, so that "to first order" is
// exact.
TEST(ImageMetric, IsTheImageTermAroundTheTruth) {
  const RenderEstimate truth = render(kTruth, 0, 0);
  const ImageMetric m = image_metric(truth.radiance, kWeight, derivatives_of(truth, truth));
  for (const Triple& d : {Triple{20, 0, 0}, {0, 0.2, 0}, {0, 0, -0.3}, {-30, 0.1, 0.2}}) {
    const Material other{kTruth.sigma_t + d[0], kTruth.albedo + d[1], kTruth.g + d[2]};
    const std::vector<RenderEstimate> estimates(2, render(other, 0, 0));
    double expected = 0;
    for (size_t i = 0; i < 3; ++i) {
      for (size_t j = 0; j < 3; ++j) expected += d[i] * m[i][j] * d[j];
    }
    const double loss = rendering_loss(truth.radiance, kWeight, estimates).value;
    EXPECT_NEAR(loss, expected, 1e-5 * expected);
  }
}

// With noise as large as the derivatives themselves; the product of an estimate with itself is off
// by a fifth and more, which this many would show.
TEST(ImageMetric, NoiseOfTheDerivativesIsNoBias) {
  const RenderEstimate truth = render(kTruth, 0, 0);
  const ImageMetric exact = image_metric(truth.radiance, kWeight, derivatives_of(truth, truth));
  std::vector<ImageMetric> noisy, squared;
  for (uint64_t seed = 0; seed < 400; ++seed) {
    const RenderEstimate a = render(kTruth, 2, 2 * seed + 1), b = render(kTruth, 2, 2 * seed + 2);
    noisy.push_back(image_metric(truth.radiance, kWeight, derivatives_of(a, b)));
    squared.push_back(image_metric(truth.radiance, kWeight, derivatives_of(a, a)));
  }
  const auto entry = [](const std::vector<ImageMetric>& all, size_t i, size_t j) {
    std::vector<double> values;
    for (const ImageMetric& m : all) values.push_back(m[i][j]);
    return testing::over_batches(values);
  };
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j <= i; ++j) {
      const std::string what = "M " + std::to_string(i) + std::to_string(j);
      testing::expect_equal(entry(noisy, i, j), {exact[i][j], 0}, 6, what);
      testing::expect_resolution(entry(noisy, i, j), exact[i][j], 0.05, what);
      EXPECT_GT(entry(squared, i, j).mean, 1.2 * exact[i][j]);
      EXPECT_EQ(noisy[0][i][j], noisy[0][j][i]);
    }
  }
}

TEST(ImageMetric, RefusesImagesOfAnotherSizeAndBlackOnes) {
  const RenderEstimate truth = render(kTruth, 0, 0);
  DerivativeImages small = derivatives_of(truth, truth);
  small[1][2].pop_back();
  testing::expect_error(ErrorKind::kInvalidInput, {"do not have the size of the image"},
                        [&] { image_metric(truth.radiance, kWeight, small); });
  testing::expect_error(ErrorKind::kInvalidInput, {"black"}, [&] {
    image_metric(std::vector<float>(kPixels), kWeight, derivatives_of(truth, truth));
  });
}

TEST(ImageWeights, AreTheMaskOrTheWeightMap) {
  DatasetImage image{.radiance = render(kTruth, 0, 0).radiance,
                     .mask = std::vector<float>(kPixels, 0.75F),
                     .standard_error = {}};
  EXPECT_EQ(image_weights(image, kSize, v1::TrainingConfig::UNIFORM), image.mask);
  EXPECT_EQ(image_weights(image, kSize, v1::TrainingConfig::WEIGHT_MAP),
            weight_map(kSize, kSize, image.radiance, image.mask));
  EXPECT_EQ(image_weights(image, kSize, v1::TrainingConfig::IMAGE_WEIGHTS_UNSPECIFIED),
            weight_map(kSize, kSize, image.radiance, image.mask));
}

}  // namespace
}  // namespace itn
