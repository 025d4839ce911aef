#include "client/training/stream_batches.h"

#include <gmock/gmock.h>
#include <torch/utils.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "client/dataset/dataset_config.h"
#include "client/training/training_config.h"
#include "client/training/training_run.h"
#include "common/error.h"
#include "common/image/image.h"
#include "common/learning/checkpoint.h"
#include "common/scene/material_proto.h"
#include "common/scene/scene_bytes.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using testing::expect_error;
using ::testing::Ge;
using ::testing::Gt;
using ::testing::Lt;

constexpr uint32_t kBatch = 4;
constexpr int kSize = 16;

// Small images of few samples, whose numbers follow from pilots.
v1::Stream small_stream() {
  v1::Stream stream;
  stream.set_capacity(12);
  stream.set_first(8);
  stream.set_reuse(2);
  v1::DatasetConfig& images = *stream.mutable_images();
  images.set_resolution(kSize);
  images.mutable_noise()->set_target(0.5);
  images.mutable_noise()->set_max_spp(16);
  complete(stream, kBatch);
  return stream;
}

constexpr PackedFormat kFormat{.resolution = kSize, .input = v1::RATIOS};

class StreamTest : public ::testing::Test {
 protected:
  std::unique_ptr<StreamBatches> batches(uint64_t step) {
    return std::make_unique<StreamBatches>(small_stream(), kFormat, step, kBatch, 1, pool_,
                                           folder_.path(), std::stop_token());
  }

  testing::TemporaryFolder folder_;
  RenderPool pool_{RenderPoolOptions()};
};

TEST_F(StreamTest, AnImageIsAFunctionOfItsNumber) {
  std::map<uint64_t, StreamedImage> images;
  {
    RenderStream stream(small_stream().images(), pool_, 0);
    for (uint64_t n = 0; n < 8; ++n) {
      images[n] = stream.next({});
      EXPECT_EQ(images[n].number, n);
      EXPECT_EQ(images[n].image.radiance.size(), size_t{kSize} * kSize);
    }
  }
  RenderStream later(small_stream().images(), pool_, 5);
  for (uint64_t n = 5; n < 8; ++n) {
    const StreamedImage again = later.next({});
    EXPECT_EQ(again.number, n);
    EXPECT_EQ(again.item.SerializeAsString(), images[n].item.SerializeAsString());
    EXPECT_EQ(again.image.radiance, images[n].image.radiance);
    EXPECT_EQ(again.image.spp, images[n].image.spp);
  }
}

// The next images of a small stream of these.
std::vector<StreamedImage> streamed(v1::DatasetConfig images, RenderPool& pool, uint64_t count) {
  v1::Stream stream;
  images.set_resolution(kSize);
  images.mutable_noise()->set_target(0.5);
  images.mutable_noise()->set_max_spp(16);
  *stream.mutable_images() = std::move(images);
  complete(stream, kBatch);
  RenderStream renders(stream.images(), pool, 0);
  std::vector<StreamedImage> result;
  while (result.size() < count) result.push_back(renders.next({}));
  return result;
}

TEST_F(StreamTest, EveryPresetIsOne) {
  for (const DatasetPreset& preset : dataset_presets()) {
    v1::DatasetConfig images = preset_config(preset.name);
    images.clear_spp();
    std::set<v1::ItemLight::KindCase> lights;
    for (const StreamedImage& streamed : streamed(images, pool_, 8)) {
      lights.insert(streamed.item.light().kind_case());
      EXPECT_THAT(streamed.image.radiance, Contains(Gt(0.F))) << preset.name;
    }
    EXPECT_EQ(lights.size(), preset.name == "any" ? 3U : 1U) << preset.name;
  }
}

TEST_F(StreamTest, PanoramasAreThoseOfTheirFolder) {
  const testing::TemporaryFolder panoramas;
  v1::DatasetConfig images = preset_config("studio");
  v1::PanoramaChoice& choice = *images.mutable_lights(0)->mutable_panoramas();
  choice.set_folder(panoramas.path().string());
  expect_error(ErrorKind::kInvalidInput, {panoramas.path().string() + " holds no EXR file"},
               [&] { streamed(images, pool_, 1); });
  Image map{.width = 8, .height = 4, .channels = {}, .attributes = {}};
  map.channels["Y"].assign(32, 1);
  write_exr(panoramas.path("a.exr"), map);
  write_exr(panoramas.path("b.exr"), map);
  std::set<std::string> names;
  for (const StreamedImage& streamed : streamed(images, pool_, 4)) {
    names.insert(streamed.item.light().panorama().name());
  }
  EXPECT_THAT(names, ElementsAre("a", "b"));
}

TEST_F(StreamTest, StopsWhileItWaits) {
  RenderStream stream(small_stream().images(), pool_, 0);
  std::stop_source stop;
  stop.request_stop();
  // What is ready is given all the same.
  try {
    for (;;) stream.next(stop.get_token());
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kCancelled);
  }
}

TEST(StreamShapes, ComeAndGo) {
  const v1::DatasetConfig config = small_stream().images();
  std::map<uint64_t, int> images;  // by shape
  constexpr uint64_t kCount = 6000;
  for (uint64_t n = 0; n < kCount; ++n) {
    const uint64_t shape = stream_shape(config, n);
    const uint64_t oldest = n / RenderStream::kImagesOfShape;
    EXPECT_THAT(shape, AllOf(Ge(oldest), Lt(oldest + RenderStream::kShapesAtATime)));
    ++images[shape];
  }
  // A shape has kImagesOfShape on average: the number of those there were says it.
  const double shapes = static_cast<double>(kCount) / RenderStream::kImagesOfShape;
  EXPECT_NEAR(static_cast<double>(images.size()), shapes, RenderStream::kShapesAtATime);
  // None of them is in a dataset of this seed.
  EXPECT_NE(stream_shapes(config), config.shapes().random().seed());
}

TEST(StreamShapes, MaterialsFillTheirRanges) {
  const v1::DatasetConfig config = small_stream().images();
  std::vector<int> albedos(4);
  for (uint64_t n = 0; n < 400; ++n) {
    const double albedo = stream_item(config, n).material().albedo();
    ++albedos.at(static_cast<size_t>(4 * (albedo - 0.39) / 0.5600001));
  }
  for (const int count : albedos) {
    EXPECT_NEAR(count, 100, 10);
  }
}

TEST_F(StreamTest, ABatchIsDrawnFromTheNewestImages) {
  const auto stream = batches(0);
  EXPECT_EQ(stream->truth().size(), 8U);
  EXPECT_GT(stream->mean_radiance(), 0);
  std::set<std::pair<double, double>> seen;
  for (uint64_t step = 0; step < 12; ++step) {
    const uint64_t count = 8 + step * kBatch / 2;
    EXPECT_EQ(stream->images_until(step), count);
    const TrainingImages drawn = stream->of_step(step, kBatch);
    std::set<double> held;
    for (uint64_t n = count - std::min<uint64_t>(count, 12); n < count; ++n) {
      held.insert(from_proto(stream_item(small_stream().images(), n).material()).sigma_t);
    }
    ASSERT_EQ(drawn.truth.size(), kBatch);
    EXPECT_TRUE(drawn.items.empty());
    for (const Material& truth : drawn.truth) {
      EXPECT_TRUE(held.contains(truth.sigma_t)) << "step " << step;
      seen.emplace(truth.sigma_t, truth.g);
    }
    EXPECT_EQ(drawn.images.size(), kBatch);
    EXPECT_GT(drawn.images.noise.amax({1, 2}).min().item<float>(), 0);
  }
  EXPECT_GT(seen.size(), 12U);  // new ones came
  EXPECT_EQ(stream->truth().size(), 12U);
}

TEST_F(StreamTest, GoesOnAfterAPauseWithTheSameBatches) {
  const auto straight = batches(0), resumed = batches(5);
  for (uint64_t step = 0; step < 9; ++step) {
    const TrainingImages expected = straight->of_step(step, kBatch);
    if (step < 5) continue;
    const TrainingImages again = resumed->of_step(step, kBatch);
    EXPECT_TRUE(again.images.luminance.equal(expected.images.luminance));
    EXPECT_TRUE(again.images.mask.equal(expected.images.mask));
    EXPECT_TRUE(again.images.noise.equal(expected.images.noise));
    for (size_t i = 0; i < kBatch; ++i) {
      EXPECT_EQ(again.truth[i].sigma_t, expected.truth[i].sigma_t);
    }
  }
  // The last step may be asked for again: its checkpoint is of a network that answers it.
  EXPECT_TRUE(straight->of_step(8, kBatch).images.luminance.equal(
      resumed->of_step(8, kBatch).images.luminance));
}

TEST_F(StreamTest, ATrainingThatIsStoppedEndsWithTheSameWeights) {
  torch::set_num_threads(1);
  v1::TrainingConfig config = training_preset("residual");
  config.clear_spp();
  config.clear_estimates();
  config.clear_pilot_spp();
  config.mutable_architecture()->mutable_residual_convolutions()->set_base_channels(4);
  config.set_batch(kBatch);
  config.set_steps(12);
  config.set_warmup_steps(2);
  *config.mutable_stream() = small_stream();
  const auto run_until = [&](const std::string& folder, uint64_t stop_after) {
    const std::optional<v1::Checkpoint> there = find_checkpoint(folder);
    auto source = batches(there ? there->training().step() : 0);
    v1::Model start;
    if (!there) {
      start = fit_model(source->truth(), kSize, source->mean_radiance(),
                        material_range(config.stream().images()), config);
    }
    std::stop_source stop;
    TrainingRun run;
    run.folder = folder;
    run.stop = stop.get_token();
    run.report = [&](const v1::TrainingMetrics& metrics) {
      EXPECT_EQ(metrics.images(), 8 + (metrics.step() - 1) * kBatch / 2);
      if (metrics.step() == stop_after) stop.request_stop();
    };
    train(config, std::move(source), start, run);
  };
  const std::string straight = folder_.path("straight"), stopped = folder_.path("stopped");
  std::filesystem::create_directories(straight);
  std::filesystem::create_directories(stopped);
  run_until(straight, 0);
  EXPECT_THROW(run_until(stopped, 5), Error);
  run_until(stopped, 0);
  EXPECT_EQ(to_hex(sha256(read_checkpoint(stopped).SerializeAsString())),
            to_hex(sha256(read_checkpoint(straight).SerializeAsString())));
}

TEST(StreamConfig, HasDefaultsAndRanges) {
  v1::Stream stream;
  complete(stream, 32);
  EXPECT_EQ(stream.capacity(), 8192U);
  EXPECT_EQ(stream.first(), 1024U);
  EXPECT_EQ(stream.reuse(), 8);
  EXPECT_TRUE(stream.images().shapes().has_random());
  const auto refuse = [](const char* what, const auto& change) {
    v1::Stream bad;
    change(bad);
    expect_error(ErrorKind::kInvalidInput, {what}, [&] { complete(bad, 32); });
  };
  refuse("stream.capacity", [](v1::Stream& s) { s.set_capacity(31); });
  refuse("stream.first", [](v1::Stream& s) { s.set_first(31); });
  refuse("stream.reuse", [](v1::Stream& s) { s.set_reuse(0.5); });
  refuse("stream.reuse", [](v1::Stream& s) { s.set_reuse(NAN); });
  refuse("grid", [](v1::Stream& s) {
    s.mutable_images()->mutable_materials()->set_sampling(v1::MaterialChoice::GRID);
  });
}

}  // namespace
}  // namespace itn
