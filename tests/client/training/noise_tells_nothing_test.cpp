// At equal samples the noise of an image tells its material, and a network learns to read it, which
// is of no use with photographs. Training prevents it: as many samples for each image as give it
// the same noise, and fresh noise in each step up to a common level.
//
// Here a network is shown the noise of images and nothing else of them, where in the image it is
// included.
#include <gtest/gtest.h>
#include <torch/utils.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "client/dataset/dataset_config.h"
#include "client/dataset/dataset_render.h"
#include "client/dataset/distribution.h"
#include "client/render_pool/render_pool.h"
#include "client/training/augmentation.h"
#include "client/training/evaluation.h"
#include "client/training/training.h"
#include "client/training/training_config.h"
#include "common/geometry/shapes.h"
#include "common/random.h"
#include "common/scene/material_proto.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

constexpr int kSide = 16;
constexpr uint32_t kImages = 900;
constexpr double kTestFraction = 1.0 / 3;
constexpr double kTarget = 0.1;  // relative noise that the samples of an image are chosen for
constexpr double kLevel = 0.2;   // that training brings every pixel up to
constexpr uint32_t kEqualSpp = 16;
constexpr uint32_t kQuieter = 4;  // times the samples, of the quieter image
constexpr uint64_t kSteps = 500;

v1::DatasetConfig dataset_config() {
  v1::DatasetConfig config = paper_config(kSide);
  config.set_count(kImages);
  config.set_test_fraction(kTestFraction);
  config.set_validation_fraction(0);
  // Noise tells albedo as well: were that anything, it would hide some of g.
  *config.mutable_materials()->mutable_albedo() = uniform(0.85, 0.95);
  return config;
}

v1::DatasetConfig with_equal_samples() {
  v1::DatasetConfig config = dataset_config();
  config.set_spp(kEqualSpp);
  return config;
}

v1::DatasetConfig with_equal_noise() {
  v1::DatasetConfig config = dataset_config();
  config.clear_spp();
  config.mutable_noise()->set_target(kTarget);
  set_defaults(config);
  return config;
}

void render(const v1::DatasetConfig& config, const std::filesystem::path& folder,
            RenderPool& pool) {
  std::vector<Shape> shapes;
  for (const ShapeInfo& info : builtin_shapes()) {
    shapes.push_back(describe_shape(std::string(info.name), make_shape(info.name)));
  }
  render_dataset(plan_dataset(config, shapes), folder, pool, [](const DatasetProgress&) {});
}

struct QuietImage {
  std::vector<float> radiance;
  uint32_t spp = 0;
};
using QuietImages = std::map<std::string, QuietImage>;  // by the item's file

QuietImages quiet_images(DatasetReader& dataset, RenderPool& pool) {
  QuietImages images;
  for (const v1::DatasetItem& item : dataset.manifest().items()) {
    const uint32_t spp = kQuieter * dataset.image(item).spp;
    images[item.file()] = {rerender(dataset, pool, item, from_proto(item.material()), spp), spp};
  }
  return images;
}

// Root mean square of the object's radiance in the 3 x 3 pixels about each.
std::vector<double> local_radiance(const std::vector<float>& radiance,
                                   const std::vector<float>& mask) {
  std::vector<double> local(radiance.size());
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      double energy = 0, area = 0;
      for (int v = std::max(0, y - 1); v <= std::min(kSide - 1, y + 1); ++v) {
        for (int u = std::max(0, x - 1); u <= std::min(kSide - 1, x + 1); ++u) {
          const auto p = static_cast<size_t>(v * kSide + u);
          if (mask[p] > 0) {
            energy += static_cast<double>(radiance[p]) * radiance[p];
            area += 1;
          }
        }
      }
      local[static_cast<size_t>(y * kSide + x)] = area > 0 ? std::sqrt(energy / area) : 0;
    }
  }
  return local;
}

// The noise of an image: on its object a radiance of 1 and the differences to the quieter image,
// relative to the radiance nearby. What the quieter image's own noise adds to them is taken off
// again.
DatasetImage noise_alone(DatasetImage image, const QuietImage& quiet) {
  const std::vector<double> local = local_radiance(quiet.radiance, image.mask);
  const double both = std::sqrt(1 + static_cast<double>(image.spp) / quiet.spp);
  for (size_t p = 0; p < image.mask.size(); ++p) {
    if (!(local[p] > 0) || !(image.mask[p] > 0)) {
      image.mask[p] = image.standard_error[p] = 0;
      continue;
    }
    const double difference =
        (static_cast<double>(image.radiance[p]) - quiet.radiance[p]) / (local[p] * both);
    image.radiance[p] = static_cast<float>(std::max(0.0, 1 + difference));
    image.mask[p] = 1;
    image.standard_error[p] = static_cast<float>(image.standard_error[p] / local[p]);
  }
  return image;
}

LabelledImages noise_of(DatasetReader& dataset, v1::Split split, const QuietImages& quiet) {
  LabelledImages images = images_of(dataset, split);
  std::vector<DatasetImage> noise;
  for (size_t i = 0; i < images.items.size(); ++i) {
    const v1::DatasetItem& item = *images.items[i];
    noise.push_back(noise_alone(images.read(i), quiet.at(item.file())));
  }
  images.read = [noise = std::move(noise)](size_t i) { return noise.at(i); };
  return images;
}

// The preset `residual`, small, with this noise added up to a level.
v1::TrainingConfig training_config(double level) {
  v1::TrainingConfig config = training_preset("residual");
  config.mutable_architecture()->mutable_residual_convolutions()->set_base_channels(8);
  config.set_steps(kSteps);
  config.set_warmup_steps(kSteps / 10);
  config.set_weight_average_decay(0.99);
  config.mutable_augmentation()->mutable_noise()->set_min(level);
  config.mutable_augmentation()->mutable_noise()->set_max(level);
  return config;
}

// What a network that has learned from the noise of the training images says of that of the others.
struct Answers {
  LabelledImages images;
  std::vector<Material> materials;
  double louder = 0;  // part of the object's pixels that is noisier than the level
};

Answers answers(DatasetReader& dataset, const QuietImages& quiet, double level) {
  const v1::TrainingConfig config = training_config(level);
  const LabelledImages learned = noise_of(dataset, v1::SPLIT_TRAIN, quiet);
  Answers result{noise_of(dataset, v1::SPLIT_TEST, quiet), {}, 0};
  const PackedFormat format{.resolution = dataset.resolution(), .input = config.input()};
  const PackedInputs inputs(learned, format, dataset.folder());
  const PackedInputs others(result.images, format, dataset.folder());
  Trainer trainer(config, learned, inputs,
                  fit_model(learned, inputs.mean_radiance(),
                            material_range(dataset.manifest().config()), config),
                  {});
  while (trainer.steps_taken() < kSteps) trainer.step();
  std::vector<uint32_t> items(result.images.items.size());
  std::iota(items.begin(), items.end(), 0U);
  const ImageBatch batch = others.batch(items);
  Predictor predictor(trainer.model());
  for (const MaterialEstimate& estimate : predictor.estimate(with_noise(batch, level, 1))) {
    result.materials.push_back(estimate.material);
  }
  result.louder = (batch.noise > level).sum().item<double>() / batch.mask.sum().item<double>();
  return result;
}

// Over the constant predictor's.
double error_of_g(const Answers& answers) {
  return relative_errors(answers.materials, answers.images)[2];
}

// By how many standard errors the mean squared error of g is above that of the constant predictor.
double z_of_g(const Answers& answers) {
  const std::vector<Material> constant = constant_predictions(answers.images);
  const auto count = static_cast<double>(constant.size());
  double mean = 0, mean_square = 0;
  for (size_t i = 0; i < constant.size(); ++i) {
    const double truth = answers.images.truth[i].g;
    const double difference =
        std::pow(answers.materials[i].g - truth, 2) - std::pow(constant[i].g - truth, 2);
    mean += difference / count;
    mean_square += difference * difference / count;
  }
  return mean / std::sqrt((mean_square - mean * mean) / count);
}

// If a network knows nothing of g, z is a standard normal number, or above it as far as it has
// learned the training images by heart: below kSignificant once in 2,000 times. At equal samples
// the logarithm of the noise has a correlation of .75 with g (measured): whoever reads it has
// squared errors that are smaller by about half the variance of g, with a standard deviation of .85
// of it from image to image, which makes z -10 for 300 images.
constexpr double kSignificant = -3.3;

TEST(Noise, TellsNothingOfGOnceItIsEqualInEachPixel) {
  torch::set_num_threads(1);
  RenderPool pool({});
  const testing::TemporaryFolder folder;
  const std::string equal_noise = folder.path("equal_noise");
  const std::string equal_samples = folder.path("equal_samples");
  render(with_equal_noise(), equal_noise, pool);
  render(with_equal_samples(), equal_samples, pool);
  DatasetReader noise_dataset(equal_noise), samples_dataset(equal_samples);
  const QuietImages quiet = quiet_images(noise_dataset, pool);  // of the scenes of both

  const Answers of_equal_samples = answers(samples_dataset, quiet, 0);
  EXPECT_LT(z_of_g(of_equal_samples), kSignificant);
  EXPECT_LT(error_of_g(of_equal_samples), 0.85);

  const Answers of_equal_pixels = answers(noise_dataset, quiet, kLevel);
  EXPECT_LT(of_equal_pixels.louder, 0.01);
  EXPECT_GT(z_of_g(of_equal_pixels), kSignificant) << "error " << error_of_g(of_equal_pixels);
}

}  // namespace
}  // namespace itn
