#include "server/render/scene_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>
#include <vector>

#include "server/render/scene_builder.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

SceneCache::ScenePtr build() {
  return std::make_shared<const tracer::Scene>(build_scene(testing::cube_scene(), RenderLimits()));
}

TEST(SceneCache, FindsWhatWasBuilt) {
  SceneCache cache(size_t{1} << 30);
  EXPECT_EQ(cache.find("a"), nullptr);
  const auto scene = cache.get_or_build("a", build);
  EXPECT_EQ(cache.find("a"), scene);
  EXPECT_EQ(cache.get_or_build("a", [] { return SceneCache::ScenePtr(); }), scene);
}

TEST(SceneCache, ForgetsTheLeastRecentlyUsed) {
  const size_t each = build()->memory() + 1;
  SceneCache cache(2 * each);
  cache.get_or_build("a", build);
  cache.get_or_build("b", build);
  cache.find("a");
  cache.get_or_build("c", build);
  EXPECT_NE(cache.find("a"), nullptr);
  EXPECT_EQ(cache.find("b"), nullptr);
  EXPECT_NE(cache.find("c"), nullptr);
}

TEST(SceneCache, KeepsTheLastOneWhateverItsSize) {
  SceneCache cache(0);
  cache.get_or_build("a", build);
  EXPECT_NE(cache.find("a"), nullptr);
  cache.get_or_build("b", build);
  EXPECT_EQ(cache.find("a"), nullptr);
  EXPECT_NE(cache.find("b"), nullptr);
}

TEST(SceneCache, BuildsOnceForAllWhoAskAtTheSameTime) {
  SceneCache cache(size_t{1} << 30);
  std::atomic<int> builds = 0;
  std::vector<SceneCache::ScenePtr> scenes(4);
  {
    std::vector<std::jthread> threads;
    for (auto& scene : scenes) {
      threads.emplace_back([&] {
        scene = cache.get_or_build("a", [&] {
          ++builds;
          std::this_thread::sleep_for(std::chrono::milliseconds(50));
          return build();
        });
      });
    }
  }
  EXPECT_EQ(builds, 1);
  for (const auto& scene : scenes) EXPECT_EQ(scene, scenes[0]);
}

TEST(SceneCache, AFailedBuildLeavesNothingBehind) {
  SceneCache cache(size_t{1} << 30);
  EXPECT_THROW(
      cache.get_or_build("a", []() -> SceneCache::ScenePtr { throw std::runtime_error("no"); }),
      std::runtime_error);
  EXPECT_EQ(cache.find("a"), nullptr);
  EXPECT_NE(cache.get_or_build("a", build), nullptr);
}

}  // namespace
}  // namespace itn
