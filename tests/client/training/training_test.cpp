#include "client/training/training_run.h"

#include <cmath>
#include <csignal>
#include <fstream>
#include <numbers>
#include <numeric>
#include <optional>
#include <set>

#include <gmock/gmock.h>

#include "client/json.h"
#include "client/training/augmentation.h"
#include "client/training/camera_augmentation.h"
#include "client/training/noise_map.h"
#include "common/error.h"
#include "common/learning/checkpoint.h"
#include "common/learning/predictor.h"
#include "common/scene/scene_bytes.h"
#include "server/render/weighted_image_loss.h"
#include "tests/client/training/training_fixture.h"
#include "tests/support/bfloat16.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

TEST_F(TrainingTest, FitsCoordinatesAndScaleToTheTruth) {
  for (const auto parameterization : {v1::NAIVE, v1::SIMILARITY}) {
    const OutputSpace space(start(parameterization));
    MaterialCoordinates sum{}, squares{};
    for (const Material& truth : images_.truth) {
      const MaterialCoordinates z = space.standardized(truth);
      for (size_t i = 0; i < 3; ++i) {
        sum[i] += z[i] / kItems;
        squares[i] += z[i] * z[i] / kItems;
      }
    }
    for (size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(sum[i], 0, 1e-9);
      EXPECT_NEAR(squares[i], 1, 1e-9);
    }
  }
}

// The mean image loss as a function of the weights, against the gradient that reaches them.
TEST_F(TrainingTest, RenderGradientReachesTheWeights) {
  for (const auto parameterization : {v1::NAIVE, v1::SIMILARITY}) {
    v1::Model model = start(parameterization);
    model.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(2);
    const OutputSpace space(model);
    torch::manual_seed(3);
    const Encoder encoder = new_encoder(model);
    encoder->to(torch::kFloat64);
    {  // predictions well inside the bounds, where the loss is smooth
      const torch::NoGradGuard no_gradient;
      for (torch::Tensor& head : encoder->named_children()["head"]->parameters()) head *= 0.01;
    }
    const torch::Tensor inputs = network_input(model, inputs_->batch(all_items()));
    const torch::Tensor wide = inputs.to(torch::kFloat64);
    const auto losses = [&](const torch::Tensor& outputs, torch::Tensor* gradients) {
      double mean = 0;
      for (int64_t i = 0; i < kItems; ++i) {
        const double* z = outputs[i].data_ptr<double>();
        const MaterialCoordinates output{z[0], z[1], z[2]};
        const std::vector<RenderEstimate> estimates(2, render(space.material(output), 0, 0));
        const std::span<const float> weight(inputs[i][1].data_ptr<float>(), kPixels);
        const auto item = static_cast<size_t>(i);
        const LossWithGradient loss =
            weighted_image_loss(images_.read(item).radiance, weight, estimates);
        mean += loss.value / kItems;
        if (gradients != nullptr) {
          const std::vector<double>& d = loss.gradient;
          const MaterialCoordinates g = space.output_gradient(output, {d.at(0), d.at(1), d.at(2)});
          for (int64_t k = 0; k < 3; ++k) (*gradients)[i][k] = g[static_cast<size_t>(k)];
        }
      }
      return mean;
    };
    const torch::Tensor outputs = encoder->forward(wide);
    torch::Tensor gradients = torch::empty({kItems, 3}, torch::kFloat64);
    losses(outputs.detach(), &gradients);
    surrogate_loss(outputs, gradients).backward();
    const torch::NoGradGuard no_gradient;
    for (torch::Tensor& weights : encoder->parameters()) {
      const torch::Tensor direction = torch::randn_like(weights);
      const double expected = (weights.grad() * direction).sum().item<double>();
      constexpr double kStep = 1e-4;
      weights += kStep * direction;
      const double up = losses(encoder->forward(wide), nullptr);
      weights -= 2 * kStep * direction;
      const double down = losses(encoder->forward(wide), nullptr);
      weights += kStep * direction;
      const double measured = (up - down) / (2 * kStep);
      EXPECT_NEAR(measured, expected, 0.01 * std::abs(expected) + 2e-5);
    }
  }
}

double mean_of_20(const std::vector<double>& values, size_t first) {
  double sum = 0;
  for (size_t i = first; i < first + 20; ++i) sum += values.at(i) / 20;
  return sum;
}

TEST_F(TrainingTest, RegressionLearnsTheTruth) {
  std::vector<double> losses;
  TrainingRun r = run();
  r.report = [&](const v1::TrainingMetrics& m) { losses.push_back(m.regression_loss()); };
  train(config(v1::TrainingConfig::RN, 300), images_, *inputs_, start(), {}, r);
  EXPECT_LT(mean_of_20(losses, 280), 0.3 * mean_of_20(losses, 0));
}

TEST_F(TrainingTest, ImageTermAloneLowersTheImageLoss) {
  const std::vector<double> losses =
      image_losses_alone(config(v1::TrainingConfig::ITN, 300), start());
  EXPECT_LT(mean_of_20(losses, 280), 0.3 * mean_of_20(losses, 0));
}

TEST_F(TrainingTest, BothTermsPullAboutEquallyHard) {
  std::vector<double> lambdas;
  TrainingRun r = run();
  r.report = [&](const v1::TrainingMetrics& m) { lambdas.push_back(m.lambda()); };
  train(config(v1::TrainingConfig::ITN), images_, *inputs_, start(), render_batch, r);
  const v1::TrainingState state = checkpoint().training();
  EXPECT_EQ(state.balance_steps(), 10);
  EXPECT_DOUBLE_EQ(lambdas[9] * state.image_gradient(), state.regression_gradient());
  for (size_t i = 10; i < lambdas.size(); ++i) EXPECT_EQ(lambdas[i], lambdas[9]);
}

class ResumeTest : public TrainingTest,
                   public ::testing::WithParamInterface<v1::TrainingConfig::Loss> {};

// Stops in the middle, in steps 1 (nothing saved but by the stop), 6 (while lambda is measured) and
// 13.
TEST_P(ResumeTest, AfterAStopEndsWithTheSameWeights) {
  train(config(GetParam()), images_, *inputs_, start(), render_batch, run());
  const std::string straight = digest();
  const std::vector<std::string> straight_metrics = metrics();
  begin_anew();
  for (const uint64_t stop_at : {1, 6, 13}) {
    std::stop_source stop;
    TrainingRun r = run();
    r.stop = stop.get_token();
    r.report = [&](const v1::TrainingMetrics& m) {
      if (m.step() >= stop_at) stop.request_stop();
    };
    EXPECT_THROW(train(config(GetParam()), images_, *inputs_, start(), render_batch, r), Error);
    EXPECT_EQ(checkpoint().training().step(), stop_at);
  }
  train(config(GetParam()), images_, *inputs_, start(), render_batch, run());
  EXPECT_EQ(digest(), straight);
  EXPECT_EQ(metrics(), straight_metrics);
}

// Killed without warning: the process ends between two checkpoints.
TEST_P(ResumeTest, AfterAKillEndsWithTheSameWeights) {
  ::testing::GTEST_FLAG(death_test_style) = "threadsafe";
  train(config(GetParam()), images_, *inputs_, start(), render_batch, run());
  const std::string straight = digest();
  const std::vector<std::string> straight_metrics = metrics();
  begin_anew();
  TrainingRun r = run();
  r.report = [&](const v1::TrainingMetrics& m) {
    if (m.step() == 11) std::raise(SIGKILL);
  };
  EXPECT_EXIT(train(config(GetParam()), images_, *inputs_, start(), render_batch, r),
              ::testing::KilledBySignal(SIGKILL), "");
  EXPECT_EQ(checkpoint().training().step(), 8);
  EXPECT_EQ(metrics().size(), 11);
  train(config(GetParam()), images_, *inputs_, start(), render_batch, run());
  EXPECT_EQ(digest(), straight);
  EXPECT_EQ(metrics(), straight_metrics);
}

INSTANTIATE_TEST_SUITE_P(Losses, ResumeTest,
                         ::testing::Values(v1::TrainingConfig::RN, v1::TrainingConfig::ITN),
                         [](const auto& test) {
                           return v1::TrainingConfig::Loss_Name(test.param);
                         });

// What is trained with three labels depends on the truth of these, and on no other.
TEST_F(TrainingTest, TruthWithoutALabelTellsNothing) {
  keep_labels(3, 1, images_);
  ASSERT_EQ(images_.labelled.size(), 3U);
  std::vector<uint32_t> others = all_items();
  for (const uint32_t i : images_.labelled) std::erase(others, i);
  for (const auto loss : {v1::TrainingConfig::RN, v1::TrainingConfig::ITN}) {
    const auto trained_with = [&](const LabelledImages& images) {
      begin_anew();
      const PackedInputs inputs(images, kPaperFormat, folder_);
      const v1::TrainingConfig c = config(loss, 6);
      train(c, images, inputs, fit_model(images, inputs.mean_radiance(), range_, c),
            loss == v1::TrainingConfig::ITN ? render_batch : RerenderingEvaluator(), run());
      return digest();
    };
    LabelledImages other = images_;  // the same images
    const std::string digest = trained_with(images_);
    for (const uint32_t i : others) other.truth[i].albedo = 0.5;
    EXPECT_EQ(trained_with(other), digest);
    other.truth[images_.labelled[1]].albedo = 0.5;
    EXPECT_NE(trained_with(other), digest);
  }
}

TEST_F(TrainingTest, TheModelKnowsHowItsMaterialsAreCorrelated) {
  const v1::TrainingConfig c = config(v1::TrainingConfig::RN);
  const v1::Model model = fit_model(images_, inputs_->mean_radiance(), range_, c);
  const AnswerSpace space(model);
  ASSERT_EQ(model.correlation_size(), 9);
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j < 3; ++j) {
      double sum = 0;
      for (size_t k = 0; k < images_.items.size(); ++k) {
        const std::vector<double> z = space.standardized(images_.truth_of(k));
        sum += z[i] * z[j] / static_cast<double>(images_.items.size());
      }
      EXPECT_NEAR(model.correlation(static_cast<int>(3 * i + j)), sum, 1e-9);
    }
  }
}

// Half of an ITN's batch has labels, and half has none; each image comes once before any comes
// again.
TEST_F(TrainingTest, BatchesOfFewLabelsAreHalfOfThose) {
  keep_labels(4, 1, images_);
  DatasetBatches batches(images_, *inputs_, 3, false);
  std::multiset<uint32_t> with, without;
  for (uint64_t step = 0; step < 4; ++step) {
    const TrainingImages taken = batches.batch_at(step, 4);
    ASSERT_EQ(taken.items.size(), 4U);
    ASSERT_EQ(taken.truth.size(), 2U);
    with.insert(taken.items.begin(), taken.items.begin() + 2);
    without.insert(taken.items.begin() + 2, taken.items.end());
  }
  for (const uint32_t i : all_items()) {
    const bool is_labelled = std::ranges::count(images_.labelled, i) > 0;
    EXPECT_EQ(with.count(i), is_labelled ? 2U : 0U);
    EXPECT_EQ(without.count(i), is_labelled ? 0U : 1U);
  }
  DatasetBatches labelled(images_, *inputs_, 3, true);
  for (const uint32_t i : labelled.batch_at(0, 4).items) {
    EXPECT_EQ(std::ranges::count(images_.labelled, i), 1);
  }
  testing::expect_error(ErrorKind::kInvalidInput, {"labels is 13", "12 images"},
                        [&] { keep_labels(13, 1, images_); });
}

TEST_F(TrainingTest, AFailedStepChangesNothing) {
  const v1::TrainingConfig c = config(v1::TrainingConfig::ITN);
  bool fail = false;
  Trainer trainer(c, images_, *inputs_, start(), [&](std::span<const RenderQuery> queries) {
    if (fail) throw Error(ErrorKind::kUnavailable, "no worker answers");
    return render_batch(queries);
  });
  trainer.step();
  const std::string before = sha256(trainer.checkpoint().SerializeAsString());
  fail = true;
  EXPECT_THROW(trainer.step(), Error);
  EXPECT_EQ(sha256(trainer.checkpoint().SerializeAsString()), before);
}

TEST_F(TrainingTest, WarmStartKeepsWeightsAndCoordinates) {
  train(config(v1::TrainingConfig::RN), images_, *inputs_, start(), {}, run());
  const v1::Model trained = checkpoint().model();
  Trainer trainer(config(v1::TrainingConfig::ITN), images_, *inputs_, trained, render_batch);
  EXPECT_EQ(weights_sha256(trainer.checkpoint().model()), weights_sha256(trained));
  EXPECT_EQ(trainer.checkpoint().model().mean(0), trained.mean(0));
  EXPECT_EQ(trainer.checkpoint().model().name(), trained.name());  // unless its run names it
  EXPECT_EQ(trainer.steps_taken(), 0);
}

void expect_error(const std::vector<std::string>& parts, const std::function<void()>& action) {
  try {
    action();
    ADD_FAILURE() << "no error; expected: " << parts.front();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kInvalidInput);
    for (const std::string& part : parts) EXPECT_THAT(error.what(), HasSubstr(part));
  }
}

TEST_F(TrainingTest, SaysWhyItDoesNotContinue) {
  const v1::TrainingConfig c = config(v1::TrainingConfig::RN);
  train(c, images_, *inputs_, start(), {}, run());
  v1::TrainingConfig other = c;
  other.set_batch(6);
  expect_error({"batch: 5 -> 6", "--resume"},
               [&] { train(other, images_, *inputs_, start(), {}, run()); });
  other = c;
  other.set_steps(19);
  expect_error({"has taken 20 steps; 19 are fewer"},
               [&] { train(other, images_, *inputs_, start(), {}, run()); });
  // The same again has nothing to do, and changes nothing.
  const std::string before = digest();
  train(c, images_, *inputs_, start(), {}, run());
  EXPECT_EQ(digest(), before);
}

TEST_F(TrainingTest, KeepsTheCheckpointBefore) {
  train(config(v1::TrainingConfig::RN, 9), images_, *inputs_, start(), {}, run());
  EXPECT_EQ(checkpoint().training().step(), 9);
  EXPECT_EQ(read_checkpoint(folder_ / kPreviousCheckpointName).training().step(), 8);
}

// --- The residual network and its Gaussian ---

class ResidualTrainingTest : public TrainingTest {
 protected:
  ResidualTrainingTest() {
    inputs_.emplace(images_, PackedFormat{.resolution = kSize, .input = v1::RATIOS}, folder_);
  }

  static v1::TrainingConfig residual(v1::TrainingConfig::Loss loss, uint64_t steps = 20) {
    v1::TrainingConfig c = config(loss, steps);
    auto& sizes = *c.mutable_architecture()->mutable_residual_convolutions();
    sizes.set_base_channels(8);
    sizes.set_blocks(1);
    c.set_output(v1::GAUSSIAN);
    c.set_parameterization(v1::UNBOUNDED);
    c.set_input(v1::RATIOS);
    c.set_learning_rate(3e-3);
    return c;
  }
  v1::Model residual_start() const {
    return fit_model(images_, inputs_->mean_radiance(), range_, residual(v1::TrainingConfig::RN));
  }
  // The regression losses of the steps of a training.
  std::vector<double> losses_of(const v1::TrainingConfig& c, const v1::Model& from) const {
    std::vector<double> losses;
    TrainingRun r = run();
    r.report = [&](const v1::TrainingMetrics& m) { losses.push_back(m.regression_loss()); };
    train(c, images_, *inputs_, from, {}, r);
    return losses;
  }
};

// It fits a mixture, which says more than one Gaussian where there is something to say.
TEST_F(ResidualTrainingTest, LearnsAMixture) {
  v1::TrainingConfig c = residual(v1::TrainingConfig::RN, 150);
  c.set_components(3);
  const v1::Model model = fit_model(images_, inputs_->mean_radiance(), range_, c);
  EXPECT_EQ(model.components(), 3U);
  const std::vector<double> losses = losses_of(c, model);
  EXPECT_LT(losses.back(), losses.front() - 1);
  const Predictor predictor(checkpoint().model());
  std::vector<uint32_t> first{0};
  const MaterialEstimate estimate = predictor.estimate(inputs_->batch(first)).front();
  EXPECT_EQ(estimate.outputs.size(), mixture_outputs(3, 3));
  EXPECT_LT(estimate.posterior->material.parameters[1].low, estimate.material.albedo);
}

// Products of less precision change each step a little, and what is learned not.
TEST_F(ResidualTrainingTest, LearnsWithLessPrecision) {
  if (!testing::has_bfloat16()) GTEST_SKIP() << "oneDNN is kept from bfloat16";
  const auto losses_with = [&](v1::TrainingConfig::Precision precision) {
    v1::TrainingConfig c = residual(v1::TrainingConfig::RN, 300);
    c.set_precision(precision);
    std::vector<double> losses = losses_of(c, residual_start());
    begin_anew();
    return losses;
  };
  const std::vector<double> full = losses_with(v1::TrainingConfig::FLOAT32);
  const std::vector<double> less = losses_with(v1::TrainingConfig::BFLOAT16);
  // The first answer is 0 whatever the precision.
  EXPECT_NE(less[1], full[1]);
  EXPECT_NEAR(less[1], full[1], 0.05);
  const double start = mean_of_20(full, 0);
  EXPECT_LT(mean_of_20(full, 280), start - 0.5);
  EXPECT_LT(mean_of_20(less, 280), start - 0.5);
}

// --- In colour ---

// The images of the fixture as green, beside two others of the same g.
class ColourTrainingTest : public ResidualTrainingTest {
 protected:
  ColourTrainingTest() {
    std::vector<Material> truth;
    SplitMix random(2);
    for (const Material& green : images_.truth) {
      truth.push_back({30 + 240 * random.uniform(), 0.4 + 0.5 * random.uniform(), green.g});
      truth.push_back(green);
      truth.push_back({30 + 240 * random.uniform(), 0.4 + 0.5 * random.uniform(), green.g});
    }
    images_.channels = 3;
    images_.truth = truth;
    images_.read_colours = [this](size_t i) {
      std::vector<DatasetImage> channels;
      for (const Material& colour : images_.truth_of(i)) {
        channels.push_back({render(colour, 0, 0).radiance, {}, {}, 0, 1});
        add_object(channels.back());
      }
      return channels;
    };
    inputs_.emplace(images_, PackedFormat{.resolution = kSize, .input = v1::RATIOS, .channels = 3},
                    folder_);
  }
};

TEST_F(ColourTrainingTest, LearnsSevenNumbers) {
  v1::TrainingConfig c = residual(v1::TrainingConfig::RN, 600);
  c.set_batch(8);
  c.set_mean_weight(2);  // as the preset residual
  const v1::Model start = residual_start();
  EXPECT_EQ(start.channels(), 3);
  EXPECT_EQ(start.mean_size(), 7);
  const std::vector<double> losses = losses_of(c, start);
  // The first answer is the Gaussian of all truths: of seven standardised coordinates.
  const double constant = 3.5 * std::log(2 * std::numbers::pi) + 3.5;
  EXPECT_NEAR(losses.front(), constant, 1);
  EXPECT_LT(mean_of_20(losses, 580), constant - 6);
  Predictor predictor = Predictor::load(folder_);
  const std::vector<MaterialEstimate> estimates = predictor.estimate(inputs_->batch(all_items()));
  ASSERT_EQ(estimates.size(), images_.truth.size());
  double error = 0, prior = 0, mean = 0;
  for (const Material& m : images_.truth) mean += m.albedo / (3 * kItems);
  for (size_t i = 0; i < estimates.size(); ++i) {
    error += std::pow(estimates[i].material.albedo - images_.truth[i].albedo, 2);
    prior += std::pow(mean - images_.truth[i].albedo, 2);
  }
  EXPECT_LT(error, 0.25 * prior);
}

TEST_F(ColourTrainingTest, ChannelsMustBeThoseOfTheNetwork) {
  const PackedFormat gray{.resolution = kSize, .input = v1::RATIOS};
  testing::expect_error(ErrorKind::kInvalidInput, {"one channel", "three"},
                        [&] { PackedInputs(images_, gray, folder_); });
}

// Colours of an image are moved together, and have noise of their own.
TEST_F(ColourTrainingTest, AugmentationKeepsColoursTogether) {
  images_.truth[1] = images_.truth[0];  // green of the first image as red
  inputs_.emplace(images_, PackedFormat{.resolution = kSize, .input = v1::RATIOS, .channels = 3},
                  folder_);
  const ImageBatch batch = inputs_->batch(all_items());
  ASSERT_EQ(batch.size(), kItems);
  ASSERT_EQ(batch.planes(), 3 * kItems);
  v1::Augmentation augmentation;
  augmentation.set_mirror(true);
  augmentation.set_shift(3);
  augmentation.set_exposure(0.5);
  *augmentation.mutable_camera() = default_camera_augmentation();
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const ImageBatch moved = augmented(batch, augmentation, seed);
    EXPECT_EQ(moved.channels, 3);
    EXPECT_TRUE(torch::equal(moved.luminance[0], moved.luminance[1])) << seed;
    EXPECT_TRUE(torch::equal(moved.mask[0], moved.mask[2])) << seed;
    EXPECT_FALSE(torch::equal(moved.luminance[0], moved.luminance[2])) << seed;
  }
  augmentation.set_white_balance(0.1);
  const ImageBatch tinted = augmented(batch, augmentation, 1);
  EXPECT_FALSE(torch::equal(tinted.luminance[0], tinted.luminance[1]));
  v1::Augmentation noisy;
  noisy.mutable_noise()->set_min(0.2);
  noisy.mutable_noise()->set_max(0.2);
  const ImageBatch noise = augmented(batch, noisy, 1);
  EXPECT_FALSE(torch::equal(noise.luminance[0], noise.luminance[1]));
  EXPECT_TRUE(torch::equal(noise.mask[0], noise.mask[1]));
}

// What predictions must know of the training is the training's, whatever the model began as.
TEST_F(ResidualTrainingTest, AModelSaysHowItWasTrained) {
  v1::TrainingConfig c = residual(v1::TrainingConfig::RN, 2);
  c.mutable_augmentation()->set_mirror(true);
  c.mutable_augmentation()->mutable_noise()->set_max(0.12);
  c.mutable_augmentation()->mutable_camera()->set_blur(1);
  train(c, images_, *inputs_, residual_start(), {}, run());
  EXPECT_TRUE(checkpoint().model().mirrored());
  EXPECT_EQ(checkpoint().model().noise(), 0.12);
  EXPECT_EQ(checkpoint().model().camera().blur(), 1);
  const v1::Model first = checkpoint().model();
  begin_anew();
  train(residual(v1::TrainingConfig::RN, 2), images_, *inputs_, first, {}, run());
  EXPECT_FALSE(checkpoint().model().mirrored());
  EXPECT_EQ(checkpoint().model().noise(), 0);
  EXPECT_FALSE(checkpoint().model().has_camera());
}

// The images tell the material, and the network finds out: how, and that it may be sure of it.
TEST_F(ResidualTrainingTest, LearnsTheTruthAndHowSureItMayBe) {
  v1::TrainingConfig c = residual(v1::TrainingConfig::RN, 600);
  c.set_batch(8);
  const std::vector<double> losses = losses_of(c, residual_start());
  // The first answer is the Gaussian of all truths: of three standardised coordinates.
  const double constant = 1.5 * std::log(2 * std::numbers::pi) + 1.5;
  EXPECT_NEAR(mean_of_20(losses, 0), constant, 1);
  EXPECT_LT(mean_of_20(losses, 580), constant - 3);
  // What is saved predicts as well, without a batch about it.
  Predictor predictor = Predictor::load(folder_);
  const std::vector<MaterialEstimate> estimates = predictor.estimate(inputs_->batch(all_items()));
  double error = 0, spread = 0, prior = 0, mean = 0;
  for (const Material& m : images_.truth) mean += m.albedo / kItems;
  for (size_t i = 0; i < kItems; ++i) {
    error += std::pow(estimates[i].material.albedo - images_.truth[i].albedo, 2);
    spread += std::pow(estimates[i].posterior->material.parameters[1].standard_deviation, 2);
    prior += std::pow(mean - images_.truth[i].albedo, 2);
  }
  EXPECT_LT(error, 0.25 * prior);
  EXPECT_LT(spread, 0.25 * prior);
}

TEST_F(ResidualTrainingTest, AfterAStopEndsWithTheSameWeights) {
  using C = v1::TrainingConfig;
  struct Kind {
    C::Loss loss;
    C::Optimizer optimizer;
    C::Precision precision;
  };
  for (const Kind& kind : {Kind{C::RN, C::ADAM, C::FLOAT32}, Kind{C::ITN, C::ADAM, C::FLOAT32},
                           Kind{C::RN, C::MUON, C::FLOAT32}, Kind{C::RN, C::MUON, C::BFLOAT16}}) {
    if (kind.precision == C::BFLOAT16 && !testing::has_bfloat16()) continue;
    v1::TrainingConfig c = residual(kind.loss);
    c.set_optimizer(kind.optimizer);
    c.set_precision(kind.precision);
    c.mutable_augmentation()->mutable_noise()->set_min(0.1);
    c.mutable_augmentation()->mutable_noise()->set_max(
        0.1);  // drawn afresh in each step, but the same in each run
    train(c, images_, *inputs_, residual_start(), render_batch, run());
    const std::string straight = digest();
    begin_anew();
    std::stop_source stop;
    TrainingRun r = run();
    r.stop = stop.get_token();
    r.report = [&](const v1::TrainingMetrics& m) {
      if (m.step() == 6) stop.request_stop();
    };
    EXPECT_THROW(train(c, images_, *inputs_, residual_start(), render_batch, r), Error);
    train(c, images_, *inputs_, residual_start(), render_batch, run());
    EXPECT_EQ(digest(), straight);
    begin_anew();
  }
}

// The image term moves the centre of the Gaussian.
TEST_F(ResidualTrainingTest, ImageTermAloneLowersTheImageLoss) {
  const std::vector<double> losses =
      image_losses_alone(residual(v1::TrainingConfig::ITN, 150), residual_start());
  EXPECT_LT(mean_of_20(losses, 130), 0.5 * mean_of_20(losses, 0));
}

TEST_F(ResidualTrainingTest, AFailedStepLeavesTheRunningStatistics) {
  bool fail = false;
  Trainer trainer(residual(v1::TrainingConfig::ITN), images_, *inputs_, residual_start(),
                  [&](std::span<const RenderQuery> queries) {
                    if (fail) throw Error(ErrorKind::kUnavailable, "no worker answers");
                    return render_batch(queries);
                  });
  trainer.step();
  const std::string before = sha256(trainer.checkpoint().SerializeAsString());
  fail = true;
  EXPECT_THROW(trainer.step(), Error);
  EXPECT_EQ(sha256(trainer.checkpoint().SerializeAsString()), before);
}

// --- Divergence ---

TEST_F(TrainingTest, ThatDivergesEndsWithAnErrorAndNoCheckpoint) {
  for (const uint64_t steps : {1, 300}) {
    v1::TrainingConfig c = config(v1::TrainingConfig::RN, steps);
    c.set_learning_rate(1e15);
    TrainingRun r = run();
    r.checkpoint_every = 1;
    expect_error({"the training has diverged", "not finite", "1e+15", "No checkpoint was written"},
                 [&] { train(c, images_, *inputs_, start(), {}, r); });
    EXPECT_FALSE(fs::exists(folder_ / kCheckpointName));
  }
}

// The gradient of one render is not finite, by whatever fault.
TEST_F(TrainingTest, ThatDivergesKeepsTheLastGoodCheckpoint) {
  for (const double bad : {static_cast<double>(NAN), HUGE_VAL}) {
    uint64_t calls = 0;
    const auto spoiled = [&](std::span<const RenderQuery> queries) {
      std::vector<LossWithGradient> losses = render_batch(queries);
      if (++calls == 7) losses[2].gradient[1] = bad;
      return losses;
    };
    const v1::TrainingConfig c = config(v1::TrainingConfig::ITN);
    expect_error({"the training has diverged", "after step 6", "The checkpoint of step 4 is kept"},
                 [&] { train(c, images_, *inputs_, start(), spoiled, run()); });
    EXPECT_EQ(checkpoint().training().step(), 4);
    // From there the run goes on, and ends as one that nothing happened to.
    train(c, images_, *inputs_, start(), render_batch, run());
    const std::string continued = digest();
    begin_anew();
    train(c, images_, *inputs_, start(), render_batch, run());
    EXPECT_EQ(digest(), continued);
    begin_anew();
  }
}

TEST_F(TrainingTest, OfAForeignCheckpointSaysWhatDoesNotFit) {
  const v1::TrainingConfig c = config(v1::TrainingConfig::RN);
  train(c, images_, *inputs_, start(), {}, run());
  const v1::Checkpoint good = checkpoint();
  struct Row {
    const char* message;
    std::function<void(v1::Checkpoint&)> spoil;
  };
  const Row rows[] = {
      {"optimizer's state is not that of this optimizer and network: there are 19 tensors",
       [](auto& k) { k.mutable_training()->mutable_optimizer()->mutable_tensors()->RemoveLast(); }},
      {"where \"exp_avg.convolutions.0.weight\" should be",
       [](auto& k) {
         k.mutable_training()->mutable_optimizer()->mutable_tensors()->SwapElements(0, 1);
       }},
      {"it must be [8, 2, 3, 3]",
       [](auto& k) {
         v1::Tensor& tensor = *k.mutable_training()->mutable_optimizer()->mutable_tensors(0);
         tensor.mutable_shape()->SwapElements(0, 1);
       }},
      {"holds nan",
       [](auto& k) {
         std::string& data =
             *k.mutable_training()->mutable_optimizer()->mutable_tensors(0)->mutable_data();
         data.replace(0, 4, std::string("\0\0\xc0\x7f", 4));
       }},
      {"the network is for 32 x 32 pixels; the images have 16 x 16",
       [](auto& k) {
         k.mutable_model()->set_resolution(32);
         k.mutable_model()->clear_weights();
         store_weights(*new_encoder(k.model()), *k.mutable_model());
       }},
  };
  for (const Row& row : rows) {
    v1::Checkpoint bad = good;
    row.spoil(bad);
    write_checkpoint(folder_ / kCheckpointName, bad);
    expect_error({row.message}, [&] {
      train(config(v1::TrainingConfig::RN, 30), images_, *inputs_, start(), {}, run());
    });
  }
}

// --- Inputs ---

TEST_F(TrainingTest, PackedInputsAreThoseOfTheImages) {
  const std::vector<uint32_t> items{7, 0, 7, 11};
  const PackedInputs ratios(images_, {.resolution = kSize, .input = v1::RATIOS}, folder_);
  for (const auto* inputs : std::initializer_list<const PackedInputs*>{&*inputs_, &ratios}) {
    const ImageBatch batch = inputs->batch(items);
    ASSERT_EQ(batch.luminance.sizes(), torch::IntArrayRef({4, kSize, kSize}));
    for (size_t i = 0; i < items.size(); ++i) {
      const DatasetImage image = images_.read(items[i]);
      const ImageBatch expected =
          resampled(kSize, image.radiance, image.mask, kSize, inputs->format().input);
      const auto row = static_cast<int64_t>(i);
      EXPECT_TRUE(torch::equal(batch.luminance[row], expected.luminance[0]));
      EXPECT_TRUE(torch::equal(batch.mask[row], expected.mask[0]));
      EXPECT_EQ(batch.weight.defined(), expected.weight.defined());
      if (batch.weight.defined()) {
        EXPECT_TRUE(torch::equal(batch.weight[row], expected.weight[0]));
      }
      EXPECT_TRUE(torch::equal(batch.noise[row], noise_map(image, kSize, kSize)[0]));
      EXPECT_GT(batch.noise[row].max().item<float>(), 0);
    }
  }
  // Nothing of them is to be seen.
  EXPECT_TRUE(fs::is_empty(folder_));
}

// A network of fewer pixels than the images sees their averages, which are quieter.
TEST_F(TrainingTest, PackedInputsOfAnotherResolutionAreAverages) {
  LabelledImages large = images_;
  large.resolution = 2 * kSize;
  large.read = [](size_t) {
    DatasetImage image{.radiance = std::vector<float>(4 * kPixels),
                       .mask = std::vector<float>(4 * kPixels, 1),
                       .standard_error = std::vector<float>(4 * kPixels, 0.2F)};
    for (size_t p = 0; p < image.radiance.size(); ++p) image.radiance[p] = p % 2 == 0 ? 1.0F : 3.0F;
    return image;
  };
  const PackedInputs inputs(large, {.resolution = kSize, .input = v1::RATIOS}, folder_);
  const ImageBatch batch = inputs.batch(std::vector<uint32_t>{3});
  EXPECT_TRUE(torch::equal(batch.luminance, torch::full({1, kSize, kSize}, 2.0F)));
  // A tenth of the radiance, of the mean over four pixels half of it; and part of what is measured.
  const float noise = 0.05F / std::sqrt(1 - 0.05F * 0.05F);
  EXPECT_TRUE(torch::allclose(batch.noise, torch::full({1, kSize, kSize}, noise)));
  expect_error({"the network is for 64 x 64 pixels; the images have 32 x 32"},
               [&] { PackedInputs(large, {.resolution = 64, .input = v1::RATIOS}, folder_); });
}

TEST_F(TrainingTest, PackedInputsSayWhyTheyCannotBeMade) {
  LabelledImages broken = images_;
  broken.read = [this](size_t i) {
    if (i == 5) throw Error(ErrorKind::kDataLoss, "000005.exr is damaged");
    return images_.read(i);
  };
  try {
    const PackedInputs inputs(broken, kPaperFormat, folder_);
    ADD_FAILURE() << "was packed";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kDataLoss);
    EXPECT_THAT(error.what(), HasSubstr("000005.exr"));
  }
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW(PackedInputs(images_, kPaperFormat, folder_, stop.get_token()), Error);
  EXPECT_THROW(PackedInputs(images_, kPaperFormat, folder_ / "none"), Error);
}

TEST_F(TrainingTest, ContinuesForMoreSteps) {
  train(config(v1::TrainingConfig::RN, 20), images_, *inputs_, start(), {}, run());
  train(config(v1::TrainingConfig::RN, 30), images_, *inputs_, start(), {}, run());
  const std::string continued = digest();
  begin_anew();
  train(config(v1::TrainingConfig::RN, 30), images_, *inputs_, start(), {}, run());
  EXPECT_EQ(digest(), continued);
}

TEST(TrainingConfig, RefusesWhatCannotWork) {
  struct Row {
    const char* message;
    std::function<void(v1::TrainingConfig&)> spoil;
  };
  const Row rows[] = {
      {"loss", [](auto& c) { c.set_loss(v1::TrainingConfig::LOSS_UNSPECIFIED); }},
      {"parameterization", [](auto& c) { c.clear_parameterization(); }},
      {"steps", [](auto& c) { c.set_steps(0); }},
      {"batch", [](auto& c) { c.set_batch(0); }},
      {"architecture", [](auto& c) { c.clear_architecture(); }},
      {"output", [](auto& c) { c.clear_output(); }},
      {"UNBOUNDED", [](auto& c) { c.set_output(v1::GAUSSIAN); }},
      {"components", [](auto& c) { c.set_components(2); }},
      {"input", [](auto& c) { c.clear_input(); }},
      {"exposure", [](auto& c) { c.clear_exposure(); }},
      {"noise", [](auto& c) { c.mutable_augmentation()->mutable_noise()->set_max(NAN); }},
      {"camera.blur", [](auto& c) { c.mutable_augmentation()->mutable_camera()->set_blur(9); }},
      {"weight map", [](auto& c) { c.mutable_augmentation()->mutable_camera()->set_blur(1); }},
      {"warmup_steps", [](auto& c) { c.set_warmup_steps(c.steps()); }},
      {"weight_decay", [](auto& c) { c.set_weight_decay(-1); }},
      {"max_gradient_norm", [](auto& c) { c.set_max_gradient_norm(NAN); }},
      {"weight_average_decay", [](auto& c) { c.set_weight_average_decay(1); }},
      {"RATIOS",
       [](auto& c) {
         c.mutable_architecture()->mutable_residual_convolutions()->set_base_channels(8);
       }},
      {"optimizer", [](auto& c) { c.clear_optimizer(); }},
      {"schedule", [](auto& c) { c.clear_schedule(); }},
      {"learning rate", [](auto& c) { c.set_learning_rate(-1); }},
      {"learning rate", [](auto& c) { c.set_learning_rate(NAN); }},
      {"estimates", [](auto& c) { c.set_estimates(1); }},
      {"spp", [](auto& c) { c.set_spp(1); }},
      {"lambda", [](auto& c) { c.set_lambda(-1); }},
  };
  for (const Row& row : rows) {
    v1::TrainingConfig c;
    c.set_loss(v1::TrainingConfig::ITN);
    c.set_parameterization(v1::NAIVE);
    c.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(1);
    c.set_output(v1::POINT);
    c.set_input(v1::LUMINANCE_AND_WEIGHT);
    c.set_exposure(v1::EXPOSURE_KNOWN);
    c.set_optimizer(v1::TrainingConfig::ADAM);
    c.set_schedule(v1::TrainingConfig::CONSTANT);
    c.set_steps(1);
    c.set_batch(1);
    c.set_learning_rate(1e-4);
    c.set_spp(2);
    c.set_estimates(2);
    EXPECT_NO_THROW(validate(c));
    row.spoil(c);
    try {
      validate(c);
      ADD_FAILURE() << row.message;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(row.message));
    }
  }
}

}  // namespace
}  // namespace itn
