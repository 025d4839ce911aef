#include "client/training/training_run.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "client/presets/presets.h"
#include "client/training/learning_rate.h"
#include "client/training/training_config.h"
#include "client/training/validation.h"
#include "common/error.h"
#include "common/learning/checkpoint.h"
#include "common/learning/encoder.h"
#include "common/learning/predictor.h"
#include "tests/client/training/training_fixture.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::vector<std::string> lines_of(const fs::path& path) {
  std::ifstream file(path);
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  return lines;
}

v1::ValidationMetrics all_of(double error) {
  v1::ValidationMetrics metrics;
  metrics.set_sigma_t(error);
  metrics.set_albedo(error);
  metrics.set_g(error);
  return metrics;
}

// Length of a tensor of the model.
double norm(const v1::Tensor& tensor) {
  double squares = 0;
  for (size_t i = 0; i < tensor.data().size(); i += sizeof(float)) {
    float value;
    std::memcpy(&value, tensor.data().data() + i, sizeof value);
    squares += static_cast<double>(value) * value;
  }
  return std::sqrt(squares);
}

class TrainingRunTest : public TrainingTest {
 protected:
  // With every means that there is.
  static v1::TrainingConfig everything(uint64_t steps = 20) {
    v1::TrainingConfig c = config(v1::TrainingConfig::RN, steps);
    c.set_schedule(v1::TrainingConfig::COSINE);
    c.set_warmup_steps(3);
    c.set_weight_decay(0.05);
    c.set_max_gradient_norm(2);
    c.set_weight_average_decay(0.9);
    v1::Augmentation& augmentation = *c.mutable_augmentation();
    augmentation.set_mirror(true);
    augmentation.set_shift(1);
    augmentation.set_exposure(0.1);
    augmentation.mutable_noise()->set_min(0.05);
    augmentation.mutable_noise()->set_max(0.1);
    return c;
  }

  void train_rn(const v1::TrainingConfig& c, const TrainingRun& r) {
    end_ = train(c, images_, *inputs_, start(), {}, r);
  }

  // The n-th validation gives the n-th of these errors, from then on the last.
  TrainingRun validated_run(std::vector<double> errors, uint64_t every) {
    TrainingRun r = run();
    r.validate_every = every;
    r.validate = [this, errors](const v1::Model& model) {
      validated_.push_back(model.step());
      return all_of(errors.at(std::min(validated_.size(), errors.size()) - 1));
    };
    return r;
  }

  v1::Model best() const { return read_checkpoint(folder_ / kBestCheckpointName).model(); }

  TrainingEnd end_;
  std::vector<uint64_t> validated_;  // steps
};

TEST_F(TrainingRunTest, WithEverythingEndsAfterAStopWithTheSameWeights) {
  const auto validated = [this] {
    TrainingRun r = run();
    r.validate_every = 5;
    r.validate = [](const v1::Model& model) { return all_of(model.step() == 5 ? 0.5 : 1); };
    return r;
  };
  train_rn(everything(), validated());
  const std::string straight = digest();
  begin_anew();
  std::stop_source stop;
  TrainingRun r = validated();
  r.stop = stop.get_token();
  r.report = [&](const v1::TrainingMetrics& m) {
    if (m.step() == 7) stop.request_stop();
  };
  EXPECT_THROW(train_rn(everything(), r), Error);
  EXPECT_EQ(checkpoint().training().step(), 7U);
  train_rn(everything(), validated());
  EXPECT_EQ(digest(), straight);
}

TEST_F(TrainingRunTest, LearnsAtTheRateOfTheSchedule) {
  const v1::TrainingConfig c = everything();
  TrainingRun r = run();
  r.report = [&](const v1::TrainingMetrics& m) {
    EXPECT_EQ(m.learning_rate(), learning_rate(c, m.step() - 1));
  };
  train_rn(c, r);
  // Adam's first step moves each weight by the rate, whatever the gradient.
  begin_anew();
  v1::TrainingConfig one = config(v1::TrainingConfig::RN, 1);
  one.set_learning_rate(0.01);
  train_rn(one, run());
  const v1::Model fast = checkpoint().model();
  begin_anew();
  one.set_schedule(v1::TrainingConfig::COSINE);
  one.set_steps(100);
  one.set_warmup_steps(10);  // the first step: a tenth
  std::stop_source stop;
  TrainingRun first = run();
  first.stop = stop.get_token();
  first.report = [&](const v1::TrainingMetrics&) { stop.request_stop(); };
  EXPECT_THROW(train_rn(one, first), Error);
  const v1::Model slow = checkpoint().model();
  torch::manual_seed(derive_seed(one.seed(), {0}));
  v1::Model untrained = start();
  store_weights(*new_encoder(untrained), untrained);
  const auto moved = [&](const v1::Model& model) {
    double most = 0;
    for (int t = 0; t < model.weights_size(); ++t) {
      const std::string &a = model.weights(t).data(), &b = untrained.weights(t).data();
      for (size_t i = 0; i < a.size(); i += sizeof(float)) {
        float x, y;
        std::memcpy(&x, a.data() + i, sizeof x);
        std::memcpy(&y, b.data() + i, sizeof y);
        most = std::max(most, static_cast<double>(std::abs(x - y)));
      }
    }
    return most;
  };
  EXPECT_NEAR(moved(fast), 0.01, 1e-4);
  EXPECT_NEAR(moved(slow), 0.001, 1e-5);
}

TEST_F(TrainingRunTest, PredictsWithTheMeanOfTheWeights) {
  v1::TrainingConfig c = config(v1::TrainingConfig::RN);
  train_rn(c, run());
  const v1::Model without = checkpoint().model();
  EXPECT_EQ(checkpoint().training().weights_size(), 0);
  begin_anew();
  c.set_weight_average_decay(0.9);
  train_rn(c, run());
  const v1::Checkpoint with = checkpoint();
  // The descent is the same, and the model another.
  ASSERT_EQ(with.training().weights_size(), without.weights_size());
  for (int i = 0; i < without.weights_size(); ++i) {
    EXPECT_EQ(with.training().weights(i).data(), without.weights(i).data());
    EXPECT_NE(with.model().weights(i).data(), without.weights(i).data());
  }
}

TEST_F(TrainingRunTest, DecaysMatricesAndKernelsAlone) {
  v1::TrainingConfig c = config(v1::TrainingConfig::RN, 10);
  c.set_max_gradient_norm(1e-12);  // below Adam's epsilon: no descent to speak of
  train_rn(c, run());
  const v1::Model without = checkpoint().model();
  begin_anew();
  c.set_learning_rate(0.01);
  c.set_weight_decay(1);
  train_rn(c, run());
  const v1::Model with = checkpoint().model();
  for (int i = 0; i < with.weights_size(); ++i) {
    const v1::Tensor& tensor = with.weights(i);
    const double expected = tensor.shape_size() > 1 ? std::pow(0.99, 10) : 1;
    EXPECT_NEAR(norm(tensor), expected * norm(without.weights(i)), 1e-4) << tensor.name();
  }
}

TEST_F(TrainingRunTest, KeepsTheBestModel) {
  train_rn(config(v1::TrainingConfig::RN, 22), validated_run({0.9, 0.7, 0.8, NAN, 0.75}, 5));
  EXPECT_THAT(validated_, ElementsAre(5, 10, 15, 20, 22));
  EXPECT_EQ(best().step(), 10U);
  EXPECT_FALSE(end_.stopped_early);
  EXPECT_EQ(checkpoint().training().best_step(), 10U);
  EXPECT_DOUBLE_EQ(checkpoint().training().best_score(), 0.7);
  EXPECT_EQ(checkpoint().training().validations_since(), 3U);
  EXPECT_NO_THROW(Predictor::load(folder_ / kBestCheckpointName));
}

TEST_F(TrainingRunTest, TakesAStepAgainWhoseValidationFailed) {
  TrainingRun r = run();
  r.validate_every = 5;
  r.checkpoint_every = 3;
  bool fails = true;
  r.validate = [&](const v1::Model& model) {
    if (model.step() == 10 && std::exchange(fails, false)) {
      throw Error(ErrorKind::kIo, "no space left on device");
    }
    return all_of(model.step() == 10 ? 0.5 : 1);
  };
  try {
    train_rn(config(v1::TrainingConfig::RN, 12), r);
    FAIL() << "the validation did not fail";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("continues after step 9"));
  }
  train_rn(config(v1::TrainingConfig::RN, 12), r);
  const std::vector<std::string> lines = lines_of(folder_ / "metrics.jsonl");
  ASSERT_EQ(lines.size(), 12U) << "each step once";
  for (size_t step = 1; step <= 12; ++step) {
    EXPECT_EQ(lines[step - 1].find("validation") != std::string::npos, step % 5 == 0 || step == 12)
        << lines[step - 1];
  }
  EXPECT_EQ(best().step(), 10U);
}

TEST_F(TrainingRunTest, EndsEarlyWhenPatienceIsOver) {
  TrainingRun r = validated_run({0.9, 0.7, 0.8, 0.8, 0.6}, 5);
  r.patience = 2;
  train_rn(config(v1::TrainingConfig::RN, 100), r);
  EXPECT_TRUE(end_.stopped_early);
  EXPECT_EQ(checkpoint().training().step(), 20U);
  EXPECT_EQ(best().step(), 10U);
  // It has ended: the same again takes no step more.
  train_rn(config(v1::TrainingConfig::RN, 100), r);
  EXPECT_TRUE(end_.stopped_early);
  EXPECT_EQ(checkpoint().training().step(), 20U);
  // With more patience it goes on, and remembers what was best.
  r.patience = 0;
  train_rn(config(v1::TrainingConfig::RN, 25), r);
  EXPECT_EQ(best().step(), 25U);
}

TEST_F(TrainingRunTest, WritesItsStepsForSpreadsheetsAndDrawsThem) {
  std::stop_source stop;
  TrainingRun r = validated_run({0.9}, 4);
  r.stop = stop.get_token();
  r.report = [&](const v1::TrainingMetrics& m) {
    if (m.step() == 6) stop.request_stop();
  };
  EXPECT_THROW(train_rn(config(v1::TrainingConfig::RN, 8), r), Error);
  train_rn(config(v1::TrainingConfig::RN, 8), validated_run({0.9}, 4));
  const std::vector<std::string> csv = lines_of(folder_ / "metrics.csv");
  ASSERT_EQ(csv.size(), 9U);
  EXPECT_EQ(csv[0],
            "step,epoch,regression_loss,image_loss,lambda,learning_rate,seconds,"
            "validation_sigma_t,validation_albedo,validation_g");
  for (size_t step = 1; step <= 8; ++step) {
    EXPECT_EQ(csv[step].substr(0, csv[step].find(',')), std::to_string(step));
    EXPECT_EQ(std::ranges::count(csv[step], ','), 9);
    EXPECT_EQ(csv[step].ends_with("0.9,0.9,0.9"), step % 4 == 0);
  }
  EXPECT_GT(fs::file_size(folder_ / "curves.png"), 4000U);
}

TEST_F(TrainingRunTest, SaysWhichLineOfItsMetricsIsNotItsOwn) {
  train_rn(config(v1::TrainingConfig::RN, 4), run());
  std::ofstream(folder_ / "metrics.jsonl") << "{\"step\": 1}\nnonsense\n";
  try {
    train_rn(config(v1::TrainingConfig::RN, 8), run());
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kDataLoss);
    EXPECT_THAT(error.what(), HasSubstr("metrics.jsonl: line 2"));
  }
}

// --- Validation ---

TEST_F(TrainingRunTest, ValidatesByErrorsOverTheConstantPredictors) {
  v1::Model model = start();
  store_weights(*new_encoder(model), model);
  const v1::ValidationMetrics metrics = Validation(images_, *inputs_, 0).measure(model);
  Predictor predictor(model);
  const std::vector<MaterialEstimate> estimates = predictor.estimate(inputs_->batch(all_items()));
  double error = 0, mean = 0, spread = 0;
  for (const Material& truth : images_.truth) mean += truth.albedo / kItems;
  for (size_t i = 0; i < kItems; ++i) {
    error += std::pow(estimates[i].material.albedo - images_.truth[i].albedo, 2);
    spread += std::pow(mean - images_.truth[i].albedo, 2);
  }
  EXPECT_NEAR(metrics.albedo(), std::sqrt(error / spread), 1e-6);
  EXPECT_NEAR(score(metrics), (metrics.sigma_t() + metrics.albedo() + metrics.g()) / 3, 1e-12);
  // The noise is the same each time, and makes a difference.
  const v1::ValidationMetrics noisy = Validation(images_, *inputs_, 0.5).measure(model);
  EXPECT_EQ(noisy.albedo(), Validation(images_, *inputs_, 0.5).measure(model).albedo());
  EXPECT_NE(noisy.albedo(), metrics.albedo());
}

// --- Configurations ---

TEST(TrainingConfigTest, PresetsAreValid) {
  for (const Preset& preset : training_presets()) {
    v1::TrainingConfig c = training_preset(preset.name);
    c.set_steps(1000);
    EXPECT_NO_THROW(validate(c)) << preset.name;
  }
  EXPECT_THROW(training_preset("nothing"), Error);
}

TEST(TrainingConfigTest, AZeroThatWasSaidIsAsGoodAsOneThatWasNot) {
  v1::TrainingState existing;
  *existing.mutable_config() = training_preset("paper");
  v1::TrainingConfig wanted = existing.config();
  wanted.set_weight_decay(0);
  wanted.set_warmup_steps(0);
  wanted.mutable_augmentation()->set_mirror(false);
  wanted.mutable_augmentation()->mutable_camera()->set_blur(0);
  EXPECT_NO_THROW(require_same_config(existing, wanted, "run"));
  wanted.set_weight_decay(0.1);
  EXPECT_THROW(require_same_config(existing, wanted, "run"), Error);
}

TEST(TrainingConfigTest, AFileSaysWhatDiffersFromThePreset) {
  const fs::path file = fs::path(::testing::TempDir()) / "config.textproto";
  std::ofstream(file)
      << "batch: 7\narchitecture { residual_convolutions { base_channels: 12 } }\n"
         "augmentation { mirror: false shift: 3 }\nmean_weight: 0\nweight_decay: 0\n";
  const v1::TrainingConfig c = read_training_config(file, training_preset("residual"));
  EXPECT_EQ(c.batch(), 7U);
  EXPECT_EQ(c.architecture().residual_convolutions().base_channels(), 12U);
  EXPECT_EQ(c.augmentation().shift(), 3U);
  EXPECT_EQ(c.learning_rate(), 4e-3);
  // Zero is a value, too.
  const v1::TrainingConfig preset = training_preset("residual");
  EXPECT_TRUE(preset.augmentation().mirror() && !c.augmentation().mirror());
  EXPECT_TRUE(preset.mean_weight() > 0 && c.mean_weight() == 0);
  EXPECT_TRUE(preset.weight_decay() > 0 && c.weight_decay() == 0);
  std::ofstream(file) << "augmentation { noise { min: 0 max: 0.3 } }\n";
  const v1::Interval noise =
      read_training_config(file, training_preset("residual")).augmentation().noise();
  EXPECT_EQ(noise.min(), 0);
  EXPECT_EQ(noise.max(), 0.3);
  std::ofstream(file) << "bacth: 7\n";
  try {
    read_training_config(file, training_preset("paper"));
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("config.textproto:1:"));
  }
  fs::remove(file);
}

}  // namespace
}  // namespace itn
