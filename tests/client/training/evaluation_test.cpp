#include "client/training/evaluation.h"

#include <cmath>
#include <filesystem>

#include <gmock/gmock.h>

#include "client/dataset/dataset_config.h"
#include "client/dataset/dataset_render.h"
#include "client/dataset/plan.h"
#include "client/picture.h"
#include "common/geometry/shapes.h"

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
}

// A re-rendering shows what the dataset's image shows: the object, and nothing where that is dark.
TEST(Evaluation, RerendersTheSamePixels) {
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "rerender";
  std::filesystem::remove_all(folder);
  v1::DatasetConfig config = paper_config(16);
  config.set_spp(64);
  config.set_count(4);
  std::vector<Shape> shapes;
  for (const char* name : {"cube", "torus", "sphere"}) {
    shapes.push_back(describe_shape(name, [name] { return make_shape(name); }));
  }
  RenderPool pool({});
  render_dataset(plan_dataset(config, shapes), folder, pool, [](const DatasetProgress&) {});
  DatasetReader dataset(folder);
  const v1::DatasetItem& item = *dataset.items(v1::SPLIT_TEST)[0];
  const Material truth{item.material().sigma_t(), item.material().albedo(), item.material().g()};
  const auto [image, mask, noise, spp] = dataset.image(item);
  const std::vector<float> again = rerender(dataset, pool, item, truth, 64, {});
  int lit = 0;
  for (size_t p = 0; p < image.size(); ++p) {
    if (mask[p] > 0 && mask[p] < 0.25) continue;  // at the edge, samples may miss the object
    EXPECT_EQ(again[p] > 0, image[p] > 0) << p;
    lit += image[p] > 0 ? 1 : 0;
  }
  EXPECT_GT(lit, 10);
  EXPECT_LT(lit, 250);
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

TEST(Evaluation, ImageErrorIsRelativeAndOnTheObject) {
  const std::vector<float> image{2, 2, 9}, mask{1, 1, 0};
  EXPECT_DOUBLE_EQ(relative_image_error(image, image, mask), 0);
  EXPECT_DOUBLE_EQ(relative_image_error(image, std::vector<float>{3, 1, 0}, mask), 0.5);
}

TEST(Evaluation, SpreadTakesEvenlyAndNeverMoreThanThereAre) {
  EXPECT_THAT(spread(2, 10), testing::ElementsAre(0, 5));
  EXPECT_THAT(spread(5, 3), testing::ElementsAre(0, 1, 2));
  EXPECT_THAT(spread(0, 3), testing::IsEmpty());
}

TEST(Picture, IsWritten) {
  const auto path = std::filesystem::path(testing::TempDir()) / "comparison.png";
  std::filesystem::remove(path);
  const std::vector<float> dark(64, 0.2F), bright(64, 1);
  write_comparison(path, 8, std::vector<Comparison>{{bright, dark}, {dark, dark}});
  EXPECT_GT(std::filesystem::file_size(path), 100);
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace itn
