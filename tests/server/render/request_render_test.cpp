#include "server/render/request_render.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

#include "common/error.h"
#include "common/scene/scene_bytes.h"
#include "common/scene/wire_array.h"
#include "tests/support/expect_error.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

// No service, no queue, no channel.
class RequestRenderTest : public ::testing::Test {
 protected:
  v1::RenderGradReply render(const v1::RenderGradRequest& request,
                             const std::stop_token& stop = {}) {
    RequestRender render(means_, [this](uint64_t bytes, uint64_t) { reserved_.push_back(bytes); });
    EXPECT_TRUE(render.accept(request, request.ByteSizeLong()));
    EXPECT_EQ(render.activity(), "building the scene");
    v1::RenderGradReply reply = render.render(stop);
    EXPECT_EQ(render.paths(), uint64_t{16} * 12 * request.spp());
    return reply;
  }

  SceneCache cache_{size_t{64} << 20};
  const RenderMeans means_{.limits = {}, .threads = 2, .max_seconds = 0, .cache = cache_};
  const std::string scene_ = testing::cube_scene().SerializeAsString();
  std::vector<uint64_t> reserved_;
};

TEST_F(RequestRenderTest, RendersASceneThatIsSentOrHeld) {
  v1::RenderGradRequest request = testing::small_request();
  request.set_scene_digest(sha256(scene_));
  RequestRender early(means_, [](uint64_t, uint64_t) {});
  EXPECT_FALSE(early.accept(request, 0));
  request.set_scene(scene_);
  const v1::RenderGradReply sent = render(request);
  EXPECT_GT(reserved_.size(), 1U);
  request.clear_scene();
  const v1::RenderGradReply held = render(request);
  EXPECT_EQ(testing::deterministic_bytes(sent), testing::deterministic_bytes(held));
}

TEST_F(RequestRenderTest, SaysWhatIsWrongAndStops) {
  v1::RenderGradRequest request = testing::small_request();
  request.set_scene(scene_);
  request.set_scene_digest(std::string(32, 'x'));
  testing::expect_error(ErrorKind::kInvalidInput, {"scene_digest is not the SHA-256"},
                        [&] { render(request); });
  request.clear_scene_digest();
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW(render(request, stop.get_token()), Error);
}

}  // namespace
}  // namespace itn
