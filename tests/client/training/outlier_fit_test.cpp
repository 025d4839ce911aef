// A small network of its own, and what it says of images that it was not made for.
#include "client/training/outlier_fit.h"
#include "client/render_pool/render_pool.h"

#include <gmock/gmock.h>

#include <array>
#include <memory>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/dataset/dataset_config.h"
#include "client/dataset/dataset_render.h"
#include "client/dataset/plan.h"
#include "client/dataset/shape_set.h"
#include "client/training/augmentation.h"
#include "client/training/calibration_fit.h"
#include "client/training/evaluation.h"
#include "client/training/finalize_model.h"
#include "client/training/training_config.h"
#include "client/training/training_run.h"
#include "common/error.h"
#include "common/learning/checkpoint.h"
#include "common/learning/predictor.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

constexpr int kSide = 32;
constexpr PackedFormat kFormat{.resolution = kSide, .input = v1::RATIOS};

// Images in the set-up of the paper, of random shapes, of which each split has its own. (Of images
// that vary more, fewer are outliers.)
struct World {
  World() {
    v1::DatasetConfig config = paper_config(kSide);
    config.clear_spp();
    config.set_count(640);
    config.mutable_noise()->set_target(0.1);
    config.mutable_noise()->set_min_spp(4);
    config.mutable_noise()->set_max_spp(4096);
    config.mutable_noise()->set_pilot_spp(8);
    config.mutable_shapes()->mutable_random()->set_count(100);
    config.set_validation_fraction(0.45);
    config.set_test_fraction(0.15);
    RenderPool pool({});
    render_dataset(plan_dataset(config, shape_set(config.shapes()).shapes), folder.path("data"),
                   pool, [](const DatasetProgress&) {});
    dataset.emplace(folder.path("data"));
    training = images_of(*dataset, v1::SPLIT_TRAIN);
    validation = images_of(*dataset, v1::SPLIT_VALIDATION);
    test = images_of(*dataset, v1::SPLIT_TEST);
    training_inputs.emplace(training, kFormat, folder.path());
    validation_inputs.emplace(validation, kFormat, folder.path());
    test_inputs.emplace(test, kFormat, folder.path());
    model = trained();
  }

  v1::Model trained() {
    v1::TrainingConfig config = training_preset("residual");
    config.mutable_architecture()->mutable_residual_convolutions()->set_base_channels(8);
    v1::Interval& noise = *config.mutable_augmentation()->mutable_noise();
    noise.set_min(0.1);  // more hides more
    noise.set_max(0.1);
    config.set_steps(120);
    config.set_warmup_steps(12);
    config.set_torch_threads(1);
    TrainingRun run;
    run.folder = folder.path("run");
    std::filesystem::create_directories(run.folder);
    run.complete = [&](v1::Model& now) {
      finalize_model(source_of(*training_inputs), {source_of(*validation_inputs), validation.truth},
                     now);
    };
    const v1::Model start = fit_model(training, training_inputs->mean_radiance(),
                                      material_range(dataset->manifest().config()), config);
    train(config, training, *training_inputs, start, nullptr, run);
    return read_checkpoint(run.folder).model();
  }

  testing::TemporaryFolder folder;
  std::optional<DatasetReader> dataset;
  LabelledImages training, validation, test;
  std::optional<PackedInputs> training_inputs, validation_inputs, test_inputs;
  v1::Model model;
};

class OutlierFit : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    set_torch_threads(1);
    world_ = new World;
  }
  static void TearDownTestSuite() { delete world_; }

  static ImageBatch test_images() {
    std::vector<uint32_t> items(world_->test.items.size());
    for (size_t i = 0; i < items.size(); ++i) items[i] = static_cast<uint32_t>(i);
    return world_->test_inputs->batch(items);
  }

  // The images with another luminance.
  template <typename Change>
  static ImageBatch changed(const Change& change) {
    ImageBatch images = test_images();
    images.luminance = change(images.luminance);
    return images;
  }

  static double part_outliers(const ImageBatch& images) {
    Predictor predictor(world_->model);
    double outliers = 0;
    const std::vector<MaterialEstimate> estimates = predictor.estimate(images);
    for (const MaterialEstimate& e : estimates) outliers += e.outlier->is_outlier ? 1 : 0;
    return outliers / static_cast<double>(estimates.size());
  }

  // Images as bright as a photograph's white.
  static torch::Tensor white(const ImageBatch& images) {
    return (images.luminance * images.mask).flatten(1).quantile(0.99, 1).view({-1, 1, 1});
  }

  static inline World* world_ = nullptr;
};

TEST_F(OutlierFit, ProperImagesOfOtherShapesAreFamiliar) {
  EXPECT_LE(part_outliers(test_images()), 0.03);
  const double noise = world_->model.noise();
  EXPECT_LE(part_outliers(with_noise(test_images(), noise, 1)), 0.03);
}

TEST_F(OutlierFit, BlackAndWhiteAreOutliers) {
  EXPECT_EQ(part_outliers(changed([](auto y) { return 0 * y; })), 1) << "black";
  const double usual = 1 / world_->model.image_scale();
  EXPECT_EQ(part_outliers(changed([&](auto y) { return usual * torch::ones_like(y); })), 1)
      << "white";
}

// Encoded for a screen: white stays white, and noise becomes less as contrast does (if it did not,
// it would tell). Many such images could be of softer materials.
TEST_F(OutlierFit, MostEncodedImagesAreOutliers) {
  ImageBatch images = test_images();
  const torch::Tensor w = white(images);
  images.luminance = w * (images.luminance / w).pow(1 / 2.2);
  images.noise = images.noise / 2.2;
  EXPECT_GE(part_outliers(images), 0.5);
}

TEST_F(OutlierFit, IsAFunctionOfItsArguments) {
  const auto measured = [] {
    return measure_outlier_model(world_->model, source_of(*world_->training_inputs),
                                 source_of(*world_->validation_inputs));
  };
  EXPECT_EQ(measured()->SerializeAsString(), measured()->SerializeAsString());
  EXPECT_EQ(measured()->SerializeAsString(), world_->model.outlier_model().SerializeAsString());
  EXPECT_LT(measured()->ByteSizeLong(), 100'000);  // of a model of megabytes
}

TEST_F(OutlierFit, DoesWithoutHeldOutImages) {
  const std::optional<v1::OutlierModel> outlier_model =
      measure_outlier_model(world_->model, source_of(*world_->training_inputs), {});
  ASSERT_TRUE(outlier_model);
  EXPECT_FALSE(measure_outlier_model(world_->model, {.count = 31, .batch = {}}, {}));
}

// Held-out images of which noise hides nearly everything are none.
TEST_F(OutlierFit, DoesWithoutNoisyImages) {
  ImageSource noisy = source_of(*world_->validation_inputs);
  noisy.batch = [proper = noisy.batch](std::span<const uint32_t> numbers) {
    ImageBatch images = proper(numbers);
    images.noise = torch::ones_like(images.noise);
    return images;
  };
  const ImageSource training = source_of(*world_->training_inputs);
  EXPECT_EQ(measure_outlier_model(world_->model, training, noisy)->SerializeAsString(),
            measure_outlier_model(world_->model, training, {})->SerializeAsString());
}

// The widths are those of the 288 validation images, which are enough.
TEST_F(OutlierFit, ACompleteModelKnowsItsWidthsToo) {
  ASSERT_TRUE(world_->model.has_calibration());
  v1::Model again = world_->model;
  const HeldOutImages validation{source_of(*world_->validation_inputs), world_->validation.truth};
  finalize_model(source_of(*world_->training_inputs), validation, again);
  EXPECT_EQ(again.SerializeAsString(), world_->model.SerializeAsString());
  // The truth is likelier with them than without.
  v1::Model without = world_->model;
  without.clear_calibration();
  const auto likelihood = [&](const v1::Model& model) {
    Predictor predictor(model);
    v1::Evaluation::Row row;
    set_likelihood(predictor,
                   estimate_all(predictor, world_->validation, noise_of_level(model.noise())),
                   world_->validation, row);
    return row.log_likelihood();
  };
  EXPECT_GT(likelihood(world_->model), likelihood(without));
  // What is usual, and how wide answers must be, is another thing of photographs.
  v1::Model photographer = world_->model;
  photographer.mutable_camera()->set_blur(4);
  finalize_model(source_of(*world_->training_inputs), validation, photographer);
  EXPECT_NE(photographer.calibration().SerializeAsString(),
            world_->model.calibration().SerializeAsString());
  EXPECT_NE(photographer.outlier_model().SerializeAsString(),
            world_->model.outlier_model().SerializeAsString());
  // Too few images change nothing.
  HeldOutImages few = validation;
  few.images.count = 255;
  EXPECT_FALSE(measure_calibration(world_->model, few));
  finalize_model(source_of(*world_->training_inputs), few, again);
  EXPECT_EQ(again.calibration().SerializeAsString(),
            world_->model.calibration().SerializeAsString());
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW(measure_calibration(world_->model, validation, stop.get_token()), Error);
}

// From twice as many images, half are for the intervals' levels: nine of ten of those truths are
// inside.
TEST_F(OutlierFit, IntervalsHoldNineOfTenOfTheImagesThatTheirLevelsComeFrom) {
  EXPECT_EQ(world_->model.calibration().interval_level_size(), 0);
  const auto count = static_cast<uint32_t>(world_->validation.truth.size());
  // Each image twice, once for either half.
  HeldOutImages twice{source_of(*world_->validation_inputs), {}};
  twice.images = {.count = 2 * size_t{count}, .batch = [&](std::span<const uint32_t> numbers) {
                    std::vector<uint32_t> of(numbers.begin(), numbers.end());
                    for (uint32_t& number : of) number /= 2;
                    return world_->validation_inputs->batch(of);
                  }};
  std::vector<Material> truth;
  for (const Material& m : world_->validation.truth) truth.insert(truth.end(), 2, m);
  twice.truth = truth;
  v1::Model model = world_->model;
  const auto calibration = measure_calibration(model, twice);
  ASSERT_TRUE(calibration);
  ASSERT_EQ(calibration->interval_level_size(), static_cast<int>(kPosteriorNumbers));
  *model.mutable_calibration() = *calibration;
  const Predictor predictor(model);
  std::array<int, 3> inside{};
  std::vector<uint32_t> all(count);
  std::iota(all.begin(), all.end(), 0U);
  const auto estimates = predictor.estimate(world_->validation_inputs->batch(all));
  for (uint32_t i = 0; i < count; ++i) {
    const Material& m = world_->validation.truth[i];
    const auto& parameters = estimates[i].posterior->material.parameters;
    const std::array<double, 3> values{m.sigma_t, m.albedo, m.g};
    for (size_t k = 0; k < 3; ++k) {
      inside[k] += parameters[k].low <= values[k] && values[k] <= parameters[k].high ? 1 : 0;
    }
  }
  // The rank is of n + 1 places; a quantile lies between two points.
  for (const int held : inside) EXPECT_NEAR(held, 0.9 * (count + 1), 3);
}

}  // namespace
}  // namespace itn
