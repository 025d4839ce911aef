#include "client/render/local_renderer.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <future>
#include <string>
#include <vector>

#include "common/error.h"
#include "common/scene/wire_array.h"
#include "tests/support/expect_error.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using testing::deterministic_bytes;

RenderJob small_job(uint64_t seed, uint32_t spp = 8) {
  RenderJob job;
  job.scene = serialize(testing::cube_scene());
  job.request = testing::small_request(spp);
  job.request.set_seed(seed);
  return job;
}

std::vector<std::string> render_all(LocalRenderer& renderer, int count) {
  std::vector<std::future<v1::RenderGradReply>> pending;
  for (int i = 0; i < count; ++i) pending.push_back(renderer.submit(small_job(i)));
  std::vector<std::string> replies;
  for (auto& reply : pending) replies.push_back(deterministic_bytes(reply.get()));
  return replies;
}

class LocalRendererTest : public ::testing::Test {
 protected:
  SceneCache cache_{size_t{64} << 20};
};

TEST_F(LocalRendererTest, AnswersTheSameByAnyNumberOfThreads) {
  LocalRenderer one(cache_, 1), three(cache_, 3);
  EXPECT_EQ(one.parallelism(), 1);
  EXPECT_EQ(three.parallelism(), 3);
  const std::vector<std::string> expected = render_all(one, 12);
  EXPECT_EQ(render_all(three, 12), expected);
  EXPECT_EQ(cache_.misses(), 1U);
  EXPECT_NE(expected[0], expected[1]);
}

TEST_F(LocalRendererTest, AddsGradientsOfTilesUp) {
  LocalRenderer renderer(cache_, 2);
  RenderJob job = small_job(1, 1024);
  job.scene = serialize(testing::cube_scene(50, 40));
  std::vector<float> weights(50 * 40);
  for (size_t i = 0; i < weights.size(); ++i) weights[i] = std::sin(static_cast<float>(i));
  job.request.mutable_gradient()->set_weight(to_bytes(weights));
  const v1::RenderGradReply whole = renderer.submit(job).get(), split = renderer.render_split(job);
  ASSERT_EQ(split.estimates_size(), whole.estimates_size());
  for (int k = 0; k < whole.estimates_size(); ++k) {
    const auto& expected = whole.estimates(k).gradient();
    ASSERT_EQ(split.estimates(k).gradient_size(), expected.size());
    for (int i = 0; i < expected.size(); ++i) {
      EXPECT_NEAR(split.estimates(k).gradient(i), expected[i], 1e-4 * std::abs(expected[i]) + 1e-3);
    }
  }
}

TEST_F(LocalRendererTest, PutsTilesTogetherBitForBit) {
  LocalRenderer renderer(cache_, 2);
  RenderJob job = small_job(1, 1024);
  job.scene = serialize(testing::cube_scene(50, 40));
  job.request.mutable_material()->set_albedo(0.2);
  std::vector<double> fractions;
  const v1::RenderGradReply split =
      renderer.render_split(job, [&](double fraction) { fractions.push_back(fraction); });
  EXPECT_EQ(deterministic_bytes(split), deterministic_bytes(renderer.submit(job).get()));
  EXPECT_EQ(fractions.back(), 1);
}

TEST_F(LocalRendererTest, SaysWhatIsWrongAndGoesOn) {
  LocalRenderer renderer(cache_, 2);
  RenderJob wrong = small_job(1);
  wrong.request.mutable_material()->set_albedo(2);
  std::future<v1::RenderGradReply> failed = renderer.submit(wrong);
  std::future<v1::RenderGradReply> other = renderer.submit(small_job(1));
  testing::expect_error(ErrorKind::kInvalidInput, {"albedo"}, [&] { failed.get(); });
  EXPECT_EQ(other.get().width(), 16U);
}

TEST_F(LocalRendererTest, CancelsWhatIsUnderWayAndWhatWaits) {
  std::vector<std::future<v1::RenderGradReply>> pending;
  {
    LocalRenderer renderer(cache_, 2);
    for (int i = 0; i < 4; ++i) {
      RenderJob job = small_job(1);
      job.request = testing::endless_request();
      pending.push_back(renderer.submit(job));
    }
    EXPECT_EQ(pending[0].wait_for(std::chrono::milliseconds(100)), std::future_status::timeout);
  }
  for (auto& reply : pending) {
    testing::expect_error(ErrorKind::kCancelled, {}, [&] { reply.get(); });
  }
}

TEST_F(LocalRendererTest, GivesUpWhereProgressThrows) {
  LocalRenderer renderer(cache_, 2);
  RenderJob job = small_job(1);
  job.request = testing::endless_request();
  testing::expect_error(ErrorKind::kCancelled, {"enough"}, [&] {
    renderer.render_split(job, [](double) { throw Error(ErrorKind::kCancelled, "enough"); });
  });
}

}  // namespace
}  // namespace itn
