#include "client/training/evaluation.h"
#include "client/render_pool/render_pool.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>

#include <gmock/gmock.h>

#include "client/dataset/dataset_config.h"
#include "client/dataset/dataset_render.h"
#include "client/dataset/plan.h"
#include "client/training/augmentation.h"
#include "client/training/shifts.h"
#include "common/error.h"
#include "common/geometry/shapes.h"
#include "common/learning/combination.h"
#include "tests/common/learning/model_for_tests.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

LabelledImages three() {
  LabelledImages images;
  images.truth = {{100, 0.4, 0}, {200, 0.6, 0.3}, {300, 0.8, 0.6}};
  return images;
}

TEST(Evaluation, ErrorsAreRootMeanSquare) {
  v1::Evaluation::Row row;
  set_errors(std::vector<Material>{{110, 0.4, 0}, {190, 0.7, 0.3}, {300, 0.8, 0.3}}, three(), row);
  EXPECT_DOUBLE_EQ(row.sigma_t(), std::sqrt(200.0 / 3));
  EXPECT_DOUBLE_EQ(row.albedo(), std::sqrt(0.01 / 3));
  EXPECT_DOUBLE_EQ(row.g(), std::sqrt(0.09 / 3));
  EXPECT_NEAR(row.ln_sigma_t(),
              std::sqrt((std::pow(std::log(1.1), 2) + std::pow(std::log(0.95), 2)) / 3), 1e-12);
  EXPECT_DOUBLE_EQ(row.sigma_a(), std::sqrt((36 + 23 * 23) / 3.0));  // 66, 57, 60 of 60, 80, 60
  EXPECT_DOUBLE_EQ(row.sigma_s(), std::sqrt((16 + 13 * 13) / 3.0));  // 44, 133, 240
  // 44, 93.1, 168 of 40, 84, 96.
  EXPECT_NEAR(row.sigma_s_reduced(), std::sqrt((16 + 9.1 * 9.1 + 72 * 72) / 3), 1e-12);
}

// A re-rendering shows what the dataset's image shows: the object, and nothing where that is dark.
// With 64 samples no pixel differs, at the edge either (none of 15,360 in 60 images); with 4 the
// paths of one in seven that the object covers are all absorbed or miss the lights.
TEST(Evaluation, RerendersTheSamePixels) {
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "rerender";
  std::filesystem::remove_all(folder);
  v1::DatasetConfig config = paper_config(16);
  config.set_spp(64);
  config.set_count(4);
  std::vector<Shape> shapes;
  for (const char* name : {"cube", "torus", "sphere"}) {
    shapes.push_back(describe_shape(name, make_shape(name)));
  }
  RenderPool pool({});
  render_dataset(plan_dataset(config, shapes), folder, pool, [](const DatasetProgress&) {});
  DatasetReader dataset(folder);
  const v1::DatasetItem& item = *dataset.items(v1::SPLIT_TEST)[0];
  const Material truth{item.material().sigma_t(), item.material().albedo(), item.material().g()};
  const std::vector<float> image = dataset.image(item).radiance;
  const std::vector<float> again = rerender(dataset, pool, item, truth, 64, {});
  int lit = 0;
  for (size_t p = 0; p < image.size(); ++p) {
    EXPECT_EQ(again[p] > 0, image[p] > 0) << p;
    lit += image[p] > 0 ? 1 : 0;
  }
  EXPECT_GT(lit, 10);
  EXPECT_LT(lit, 250);
  // Who is right is nearer to the image than who is not, and as near as its noise.
  const LabelledImages images = images_of(dataset, v1::SPLIT_TEST);
  std::vector<Material> wrong = images.truth;
  for (Material& m : wrong) m.albedo /= 2;
  const std::vector<uint32_t> chosen = spread(images.truth.size(), images.truth.size());
  size_t calls = 0;
  const auto errors_of = [&](const std::vector<Material>& predictions) {
    return image_errors(dataset, pool, images, chosen, predictions, 64, [&] { ++calls; });
  };
  const ImageErrors right = errors_of(images.truth), off = errors_of(wrong);
  EXPECT_EQ(calls, 2 * chosen.size());
  EXPECT_LT(right.relative, off.relative);
  EXPECT_LT(right.dissimilarity, off.dissimilarity);
  EXPECT_GT(right.dissimilarity, 0);
  EXPECT_LT(off.dissimilarity, 1);
  std::filesystem::remove_all(folder);
}

TEST(Evaluation, NoConstantBeatsTheMeanOfTheTruth) {
  const LabelledImages images = three();
  const std::vector<Material> best = constant_predictions(images);
  v1::Evaluation::Row row;
  set_errors(best, images, row);
  for (const double shift : {-20.0, -1.0, 1.0, 20.0}) {
    std::vector<Material> other = best;
    for (Material& m : other) {
      m.sigma_t += shift;
      m.albedo += shift / 100;
      m.g += shift / 100;
    }
    v1::Evaluation::Row worse;
    set_errors(other, images, worse);
    EXPECT_GT(worse.sigma_t(), row.sigma_t());
    EXPECT_GT(worse.albedo(), row.albedo());
    EXPECT_GT(worse.g(), row.g());
  }
}

TEST(Evaluation, RelativeErrorsAreThoseOverTheConstantPredictors) {
  const MaterialCoordinates half = relative_errors(
      std::vector<Material>{{150, 0.5, 0.15}, {200, 0.6, 0.3}, {250, 0.7, 0.45}}, three());
  for (const double ratio : half) EXPECT_DOUBLE_EQ(ratio, 0.5);
  LabelledImages one;
  one.truth = {{100, 0.4, 0.2}};  // the constant predictor is right
  for (const double ratio : relative_errors(std::vector<Material>{{100, 0.5, 0.2}}, one)) {
    EXPECT_EQ(ratio, HUGE_VAL);
  }
}

// 90 images of three shapes. On the last shape the estimates are as bad as the constant
// predictor's, on the others twice as good; intervals hold the truth of sigma_t always, of albedo
// never.
TEST(Evaluation, DetailsAreThoseOfEstimatesThatAreKnown) {
  LabelledImages images;
  std::vector<v1::DatasetItem> items(90);
  for (size_t i = 0; i < items.size(); ++i) {
    items[i].set_shape(std::string(1, static_cast<char>('a' + i % 3)));
    images.items.push_back(&items[i]);
    images.truth.push_back({100.0 + static_cast<double>(i), 0.5 + 0.001 * static_cast<double>(i),
                            0.002 * static_cast<double>(i)});
  }
  const std::vector<Material> constant = constant_predictions(images);
  std::vector<MaterialEstimate> estimates;
  for (size_t i = 0; i < items.size(); ++i) {
    const double pull = i % 3 == 2 ? 0 : 0.5;  // from the constant to the truth
    const Material &c = constant[i], &t = images.truth[i];
    MaterialEstimate estimate;
    estimate.material = {c.sigma_t + pull * (t.sigma_t - c.sigma_t),
                         c.albedo + pull * (t.albedo - c.albedo), c.g + pull * (t.g - c.g)};
    estimate.posterior.emplace();
    auto& p = estimate.posterior->material.parameters;
    // The median of sigma_t is right within 1 / mm, that of the albedo never, that of g always.
    p[0] = {.standard_deviation = 1, .median = t.sigma_t + 1, .low = 0, .high = 1000};
    p[1] = {.standard_deviation = 1, .median = 0, .low = 2, .high = 3};
    p[2] = {.standard_deviation = 1, .median = t.g, .low = 0, .high = 0.0881};  // half of them
    estimate.posterior->diffuse_albedo.mean = diffuse_albedo(t) + (i % 2 == 0 ? 0.03 : -0.03);
    estimate.posterior->diffusion_length.median = 1.2 * diffusion_length(t);
    estimates.push_back(estimate);
  }
  v1::Evaluation::Row row;
  set_details(estimates, images, row);
  EXPECT_NEAR(row.relative().sigma_t(), std::sqrt((0.25 + 0.25 + 1) / 3), 0.01);
  // Some draws of three shapes have only the last, and more only the others.
  EXPECT_NEAR(row.relative_sigma_t().min(), 0.5, 1e-9);
  EXPECT_GT(row.relative_sigma_t().max(), 0.85);
  // Of the truths, 1 apart, the median is 22.5 from each on average.
  EXPECT_NEAR(row.relative_absolute().sigma_t(), 1 / 22.5, 1e-9);
  EXPECT_NEAR(row.relative_absolute().albedo(), 0.5445 / 0.0225, 1e-9);
  // Some draws have one shape alone.
  EXPECT_NEAR(row.relative_absolute_albedo().min(), 0.5435 / 0.0225, 1e-9);
  EXPECT_NEAR(row.relative_absolute_albedo().max(), 0.5455 / 0.0225, 1e-9);
  EXPECT_EQ(row.relative_absolute().g(), 0);
  EXPECT_NEAR(row.diffuse_albedo(), 0.03, 1e-12);
  EXPECT_NEAR(row.ln_diffusion_length(), std::log(1.2), 1e-12);
  EXPECT_EQ(row.coverage().sigma_t(), 1);
  EXPECT_EQ(row.coverage().albedo(), 0);
  EXPECT_NEAR(row.coverage().g(), 0.5, 1e-9);
  ASSERT_EQ(row.terciles_size(), 3);
  const std::array<double, 3> inside{1, 0.5, 0};
  for (int third = 0; third < 3; ++third) {
    EXPECT_EQ(row.terciles(third).items(), 30);
    EXPECT_EQ(row.terciles(third).sigma_t().min(), 100 + 30 * third);
    EXPECT_EQ(row.terciles(third).sigma_t().max(), 129 + 30 * third);
    EXPECT_NEAR(row.terciles(third).coverage().g(), inside[static_cast<size_t>(third)], 1e-9);
  }
  // The middle third is where the constant is near the truth.
  EXPECT_LT(row.terciles(1).rmse().sigma_t(), 0.5 * row.terciles(0).rmse().sigma_t());
  std::vector<double> errors;
  for (size_t i = 0; i < items.size(); ++i) {
    errors.push_back(std::abs(estimates[i].material.sigma_t / images.truth[i].sigma_t - 1));
  }
  std::ranges::sort(errors);
  EXPECT_NEAR(row.median_relative_sigma_t(), errors[44], 1e-12);
}

// Truths that come from the answers' distributions, and answers that are twice as sure as that.
TEST(Evaluation, RanksTellAnswersThatAreTooSure) {
  const v1::Model model = residual_model();
  const Predictor predictor(model);
  const OutputSpace space(model);
  std::vector<v1::DatasetItem> items(300);
  LabelledImages images;
  torch::manual_seed(5);
  const torch::Tensor z = 0.25 * torch::randn({300, 3}, torch::kFloat64);
  for (int64_t i = 0; i < 300; ++i) {
    v1::DatasetItem& item = items[static_cast<size_t>(i)];
    item.set_shape(std::to_string(i));
    images.items.push_back(&item);
    images.truth.push_back(
        space.material({z[i][0].item<double>(), z[i][1].item<double>(), z[i][2].item<double>()}));
  }
  const auto row_with = [&](double deviation, size_t count = 300) {
    MaterialEstimate estimate;
    const double l = -std::log(deviation);
    estimate.outputs = {0, 0, 0, l, l, l, 0, 0, 0};
    v1::Evaluation::Row row;
    set_likelihood(predictor, std::vector(count, estimate), images, row);
    return row;
  };
  const v1::Evaluation::Row right = row_with(0.25), sure = row_with(0.125);
  ASSERT_EQ(right.rank_tests_size(), 4);
  EXPECT_EQ(right.rank_tests(0).quantity(), "reduced sigma_t");
  EXPECT_EQ(right.rank_tests(3).quantity(), "all together");
  for (const v1::Evaluation::RankTest& test : right.rank_tests()) EXPECT_GT(test.p_value(), 1e-3);
  for (const v1::Evaluation::RankTest& test : sure.rank_tests()) EXPECT_LT(test.p_value(), 1e-5);
  EXPECT_NEAR(right.joint_coverage(), 0.9, 0.06);
  EXPECT_TRUE(right.has_constant_log_likelihood());
  images.items.resize(3);  // a Gaussian over three coordinates goes through three points
  images.truth.resize(3);
  EXPECT_FALSE(row_with(0.25, 3).has_constant_log_likelihood());
}

TEST(Evaluation, TheOutlierAreaIsThePartOfPairsInOrder) {
  const auto with_scores = [](const std::vector<double>& scores) {
    std::vector<MaterialEstimate> estimates;
    for (const double score : scores) estimates.emplace_back().outlier.emplace().score = score;
    return estimates;
  };
  const std::vector<MaterialEstimate> usual = with_scores({1, 2, 3, 4});
  EXPECT_EQ(outlier_area(usual, usual), 0.5);
  EXPECT_EQ(outlier_area(usual, with_scores({5, 6})), 1);
  EXPECT_EQ(outlier_area(usual, with_scores({0})), 0);
  EXPECT_EQ(outlier_area(usual, with_scores({3.5, 0, 4})), (3 + 0 + 3.5) / 12);
}

TEST(Evaluation, EveryShiftChangesImages) {
  ImageBatch images;
  images.channels = 3;
  torch::manual_seed(1);
  images.luminance = 0.5 + torch::rand({6, 32, 32});
  images.mask = torch::zeros({6, 32, 32});
  images.mask.slice(1, 8, 24).slice(2, 8, 24).fill_(1);
  images.noise = torch::zeros({6, 32, 32});
  for (const Shift& shift : shifts()) {
    EXPECT_NO_THROW(validate(shift.change)) << shift.name;
    const ImageBatch changed = augmented(images, shift.change, 1);
    EXPECT_FALSE(changed.luminance.equal(images.luminance)) << shift.name;
  }
}

// Of two objects of the same shape the first has two images, and the other one.
TEST(Evaluation, CombinesTheImagesOfEachObject) {
  const v1::Model model = residual_model();
  const Predictor predictor(model);
  v1::DatasetItem item;
  item.set_shape("cube");
  LabelledImages images;
  images.items = {&item, &item, &item};
  images.truth = {{100, 0.4, 0}, {100, 0.4, 0}, {300, 0.8, 0.6}};
  std::vector<MaterialEstimate> estimates(3);
  for (size_t i = 0; i < 3; ++i) {
    estimates[i].outputs = {0.1 * static_cast<double>(i), -0.2, 0.1, 1.4, 1.3, 1.2, 0, 0, 0};
  }
  const std::vector<MaterialEstimate> together = combined(predictor, images, estimates);
  ASSERT_EQ(together.size(), 3);
  const std::vector<ImageAnswer> pair = {{estimates[0].outputs}, {estimates[1].outputs}};
  EXPECT_EQ(together[0].outputs, Combination(model)(pair));
  EXPECT_EQ(together[1].outputs, together[0].outputs);
  EXPECT_EQ(together[2].outputs, estimates[2].outputs);
  images.truth[1].g = 0.1;
  testing::expect_error(ErrorKind::kInvalidInput, {"no two images", "--views"},
                        [&] { combined(predictor, images, estimates); });
}

TEST(Evaluation, ImageErrorIsRelativeAndOnTheObject) {
  const std::vector<float> image{2, 2, 9}, mask{1, 1, 0};
  EXPECT_DOUBLE_EQ(relative_image_error(image, image, mask), 0);
  EXPECT_DOUBLE_EQ(relative_image_error(image, std::vector<float>{3, 1, 0}, mask), 0.5);
}

TEST(Evaluation, SpreadTakesEvenlyAndNeverMoreThanThereAre) {
  EXPECT_THAT(spread(2, 10), ::testing::ElementsAre(::testing::Lt(5), ::testing::Ge(5)));
  EXPECT_THAT(spread(5, 3), ::testing::ElementsAre(0, 1, 2));
  EXPECT_THAT(spread(0, 3), ::testing::IsEmpty());
}

// 24 scenes with the same 12 x 5 x 5 materials: a stride of 180 would see one value of g alone.
TEST(Evaluation, SpreadMeetsAllOfAGrid) {
  std::set<uint32_t> scenes, sigma_t, albedo, g;
  for (const uint32_t i : spread(40, 7200)) {
    scenes.insert(i / 300);
    sigma_t.insert(i / 25 % 12);
    albedo.insert(i / 5 % 5);
    g.insert(i % 5);
  }
  EXPECT_EQ(scenes.size(), 24U);
  EXPECT_GE(sigma_t.size(), 11U);
  EXPECT_EQ(albedo.size(), 5U);
  EXPECT_EQ(g.size(), 5U);
}

}  // namespace
}  // namespace itn
