// A small training: images that tell their material, a renderer that is a formula, a folder.
#pragma once

#include <gtest/gtest.h>
#include <torch/utils.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/training/training_run.h"
#include "common/learning/checkpoint.h"
#include "common/scene/scene_bytes.h"
#include "server/render/weighted_image_loss.h"

namespace itn {

inline constexpr int kSize = 16;
inline constexpr size_t kPixels = kSize * kSize;
inline constexpr int kItems = 12;
inline constexpr PackedFormat kPaperFormat{.resolution = kSize, .input = v1::LUMINANCE_AND_WEIGHT};

// A renderer that is a smooth function of the material, pixel by pixel.
inline double radiance(const Material& m, size_t p) {
  const double u = static_cast<double>(p % kSize) / kSize;
  const double v = static_cast<double>(p / kSize) / kSize;
  return 0.2 + 2 * m.albedo * u + 3 * m.g * v * v + m.sigma_t / 100 * u * v;
}
inline MaterialCoordinates derivatives(size_t p) {
  const double u = static_cast<double>(p % kSize) / kSize;
  const double v = static_cast<double>(p / kSize) / kSize;
  return {u * v / 100, 2 * u, 3 * v * v};
}

inline RenderEstimate render(const Material& m, double noise, uint64_t seed) {
  SplitMix random(seed);
  RenderEstimate estimate;
  estimate.derivatives.resize(3);
  for (size_t p = 0; p < kPixels; ++p) {
    const double error = noise * (random.uniform() - 0.5);
    estimate.radiance.push_back(static_cast<float>(radiance(m, p) + error));
    for (size_t i = 0; i < 3; ++i) {
      estimate.derivatives[i].push_back(static_cast<float>(derivatives(p)[i] * (1 + error)));
    }
  }
  return estimate;
}

inline std::vector<LossWithGradient> render_batch(std::span<const RenderQuery> queries) {
  std::vector<LossWithGradient> result;
  for (const RenderQuery& q : queries) {
    const std::vector<RenderEstimate> estimates{render(q.material, 0.2, derive_seed(q.seed, {0})),
                                                render(q.material, 0.2, derive_seed(q.seed, {1}))};
    result.push_back(weighted_image_loss(q.image, q.weight, estimates));
  }
  return result;
}

// A silhouette for the weight map, and some noise.
inline void add_object(DatasetImage& image) {
  image.mask.resize(kPixels);
  for (size_t p = 0; p < kPixels; ++p) {
    image.mask[p] = p % kSize < 2 ? 0.0F : 1.0F;
    image.standard_error.push_back(0.02F * image.radiance[p]);
  }
}

class TrainingTest : public ::testing::Test {
 protected:
  TrainingTest() {
    torch::set_num_threads(1);
    std::filesystem::remove_all(folder_);
    images_.resolution = kSize;
    items_.resize(kItems);
    SplitMix random(1);
    for (v1::DatasetItem& item : items_) {
      const Material m{30 + 240 * random.uniform(), 0.4 + 0.5 * random.uniform(),
                       0.8 * random.uniform()};
      images_.items.push_back(&item);
      images_.truth.push_back(m);
    }
    images_.read = [this](size_t i) {
      DatasetImage image{
          .radiance = render(images_.truth[i], 0, 0).radiance, .mask = {}, .standard_error = {}};
      add_object(image);
      return image;
    };
    images_.derivatives = [this](size_t i) {
      const RenderEstimate exact = render(images_.truth[i], 0, 0);
      DerivativeImages images;
      for (auto& estimate : images) std::ranges::copy(exact.derivatives, estimate.begin());
      return images;
    };
    images_.scene = [](size_t) { return nullptr; };
    std::filesystem::create_directories(folder_);
    inputs_.emplace(images_, kPaperFormat, folder_);
    range_.mutable_sigma_t()->set_min(30);
    range_.mutable_sigma_t()->set_max(276);
    range_.mutable_albedo()->set_min(0.39);
    range_.mutable_albedo()->set_max(0.95);
    range_.mutable_g()->set_max(0.8);
  }
  ~TrainingTest() override { std::filesystem::remove_all(folder_); }

  static v1::TrainingConfig config(v1::TrainingConfig::Loss loss, uint64_t steps = 20) {
    v1::TrainingConfig config;
    config.set_loss(loss);
    config.set_parameterization(v1::SIMILARITY);
    config.mutable_architecture()->mutable_plain_convolutions()->set_base_channels(8);
    config.set_output(v1::POINT);
    config.set_input(v1::LUMINANCE_AND_WEIGHT);
    config.set_exposure(v1::EXPOSURE_KNOWN);
    config.set_optimizer(v1::TrainingConfig::ADAM);
    config.set_schedule(v1::TrainingConfig::CONSTANT);
    config.set_steps(steps);
    config.set_batch(5);
    config.set_learning_rate(1e-3);
    config.set_seed(7);
    config.set_spp(8);
    config.set_estimates(2);
    return config;
  }

  v1::Model start(v1::Parameterization parameterization = v1::SIMILARITY) const {
    v1::TrainingConfig c = config(v1::TrainingConfig::RN);
    c.set_parameterization(parameterization);
    return fit_model(images_, inputs_->mean_radiance(), range_, c);
  }

  TrainingRun run() const {
    TrainingRun result;
    result.folder = folder_;
    result.checkpoint_every = 4;
    return result;
  }

  // Losses of the steps of a training with the image term alone: the network finds materials that
  // reproduce the images.
  std::vector<double> image_losses_alone(v1::TrainingConfig c, const v1::Model& from) const {
    c.set_lambda(1e6);
    std::vector<double> losses;
    TrainingRun r = run();
    r.report = [&](const v1::TrainingMetrics& m) { losses.push_back(m.image_loss()); };
    train(c, images_, *inputs_, from, render_batch, r);
    return losses;
  }

  v1::Checkpoint checkpoint() const { return read_checkpoint(folder_); }

  void begin_anew() const {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }

  static std::vector<uint32_t> all_items() {
    std::vector<uint32_t> items(kItems);
    std::iota(items.begin(), items.end(), 0U);
    return items;
  }

  // In hexadecimal: the bytes themselves are no help in a failure's message.
  std::string digest() const { return to_hex(sha256(checkpoint().SerializeAsString())); }

  std::vector<std::string> metrics() const {
    std::ifstream file(folder_ / "metrics.jsonl");
    std::vector<std::string> lines;
    for (std::string line; std::getline(file, line);) {
      // Time is the one thing that differs.
      lines.push_back(line.substr(0, line.find("\"seconds\"")));
    }
    return lines;
  }

  // The same in the process that a death test begins.
  static std::filesystem::path own_folder() {
    const ::testing::TestInfo& test = *::testing::UnitTest::GetInstance()->current_test_info();
    return std::filesystem::path(::testing::TempDir()) / test.test_suite_name() / test.name();
  }
  std::filesystem::path folder_ = own_folder();
  std::vector<v1::DatasetItem> items_;
  LabelledImages images_;
  std::optional<PackedInputs> inputs_;
  v1::MaterialRange range_;
};

}  // namespace itn
