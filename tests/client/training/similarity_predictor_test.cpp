#include "client/training/similarity_predictor.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "client/dataset/distribution.h"
#include "client/training/evaluation.h"
#include "common/learning/parameterization.h"
#include "common/random.h"

namespace itn {
namespace {

v1::MaterialChoice paper_materials() {
  v1::MaterialChoice materials;
  *materials.mutable_sigma_t() = log_uniform(30, 276);
  *materials.mutable_albedo() = uniform(0.39, 0.95);
  *materials.mutable_g() = uniform(0, 0.8);
  return materials;
}

LabelledImages drawn(const v1::MaterialChoice& materials, size_t count) {
  SplitMix random(7);
  LabelledImages images;
  for (size_t i = 0; i < count; ++i) {
    images.truth.push_back({quantile(materials.sigma_t(), random.uniform()),
                            quantile(materials.albedo(), random.uniform()),
                            quantile(materials.g(), random.uniform())});
  }
  return images;
}

std::array<double, 3> as_array(const Material& m) {
  return {m.sigma_t, m.albedo, m.g};
}

// Mean of the values over its standard error.
double z_of(const std::vector<double>& values) {
  double sum = 0, squares = 0;
  for (const double v : values) {
    sum += v;
    squares += v * v;
  }
  const auto n = static_cast<double>(values.size());
  const double mean = sum / n;
  return mean / std::sqrt((squares / n - mean * mean) / n);
}

// The error of a conditional mean is uncorrelated with everything that it was conditioned on. The
// tests are twelve, so one of |z| > 4.5 is there once in 10^4.
TEST(SimilarityPredictor, IsTheMeanOfAllMaterialsThatShareTheReducedParameters) {
  const v1::MaterialChoice materials = paper_materials();
  const LabelledImages images = drawn(materials, 60000);
  const std::vector<Material> predictions = similarity_predictions(images, materials).value();
  for (size_t k = 0; k < 3; ++k) {
    std::array<std::vector<double>, 4> products;
    std::vector<double> larger;  // errors of answers that are 1 % larger
    for (size_t i = 0; i < predictions.size(); ++i) {
      const double error = as_array(predictions[i])[k] - as_array(images.truth[i])[k];
      const MaterialCoordinates reduced = to_coordinates(v1::SIMILARITY, images.truth[i]);
      products[0].push_back(error);
      products[1].push_back(error * reduced[0]);
      products[2].push_back(error * reduced[1]);
      products[3].push_back(error * reduced[0] * reduced[1]);
      larger.push_back(error + 0.01 * as_array(predictions[i])[k]);
    }
    for (size_t f = 0; f < products.size(); ++f) {
      EXPECT_LT(std::abs(z_of(products[f])), 4.5) << "parameter " << k << ", product " << f;
    }
    EXPECT_GT(z_of(larger), 4.5) << "parameter " << k << ": 1 % would not have shown";
  }
}

TEST(SimilarityPredictor, SharesTheReducedParametersOnlyWhereNothingElseIsLeft) {
  const v1::MaterialChoice materials = paper_materials();
  LabelledImages images;
  images.truth = {{276, 0.6, 0},     // what is similar to it has a larger sigma_t: there is none
                  {120, 0.8, 0.4}};  // to this there are many
  const std::vector<Material> predictions = similarity_predictions(images, materials).value();
  EXPECT_NEAR(predictions[0].sigma_t, 276, 1);
  EXPECT_NEAR(predictions[0].albedo, 0.6, 2e-3);
  EXPECT_NEAR(predictions[0].g, 0, 2e-3);
  EXPECT_GT(std::abs(predictions[1].sigma_t - 120), 1);
}

TEST(SimilarityPredictor, IsBeyondListsAndGrids) {
  v1::MaterialChoice materials = paper_materials();
  const LabelledImages images = drawn(materials, 10);
  EXPECT_TRUE(similarity_predictions(images, materials).has_value());
  materials.set_sampling(v1::MaterialChoice::GRID);
  EXPECT_FALSE(similarity_predictions(images, materials).has_value());
  materials = paper_materials();
  *materials.mutable_g() = fixed(0.3);
  EXPECT_FALSE(similarity_predictions(images, materials).has_value());
}

}  // namespace
}  // namespace itn
