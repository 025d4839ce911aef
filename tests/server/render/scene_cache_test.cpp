#include "server/render/scene_cache.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <new>
#include <stdexcept>
#include <thread>
#include <vector>

#include "common/scene/scene_bytes.h"
#include "server/scene_compiler/scene_builder.h"
#include "server/tracer/render.h"
#include "server/tracer/scene/compiled_scene.h"
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

TEST(SceneCache, CountsScenesThatWereThereAndThoseThatWereBuilt) {
  SceneCache cache(size_t{1} << 30);
  EXPECT_EQ(cache.find("a"), nullptr);
  EXPECT_EQ(cache.hits() + cache.misses(), 0U) << "it is asked for again when it has been sent";
  cache.get_or_build("a", build);
  EXPECT_EQ(cache.misses(), 1U);
  cache.find("a");
  cache.get_or_build("a", build);
  EXPECT_EQ(cache.hits(), 2U);
  EXPECT_THROW(cache.get_or_build("b", []() -> SceneCache::ScenePtr { throw std::bad_alloc(); }),
               std::bad_alloc);
  EXPECT_EQ(cache.hits(), 2U);
  EXPECT_EQ(cache.misses(), 1U);
}

TEST(SceneCache, ForgetsTheLeastRecentlyUsed) {
  const size_t each = build()->memory() + 1;
  SceneCache cache(2 * each + 1024);  // and what entries cost
  cache.get_or_build("a", build);
  cache.get_or_build("b", build);
  cache.find("a");
  cache.get_or_build("c", build);
  EXPECT_NE(cache.find("a"), nullptr);
  EXPECT_EQ(cache.find("b"), nullptr);
  EXPECT_NE(cache.find("c"), nullptr);
}

TEST(SceneCache, KeepsWhatIsTooLargeForItAsLongAsItIsInUse) {
  SceneCache cache(0);
  auto first = cache.get_or_build("a", build);
  auto second = cache.get_or_build("b", build);
  auto again = cache.find("a");
  EXPECT_EQ(again, first);
  EXPECT_GE(cache.excess(), first->memory() + second->memory());
  first.reset();
  EXPECT_EQ(cache.find("a"), again);
  again.reset();
  EXPECT_EQ(cache.find("a"), nullptr);
  EXPECT_EQ(cache.find("b"), second);
  second.reset();
  EXPECT_EQ(cache.find("b"), nullptr);
  EXPECT_EQ(cache.memory(), 0U);
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

// A scene of a cube, turned and lit as asked, of its film's pixels few.
v1::Scene turned_cube(double size, double turn, double azimuth) {
  v1::Scene scene = testing::cube_scene(8, 8);
  v1::SunSky& sky = *scene.add_lights()->mutable_sun_sky();
  sky.set_sun_azimuth_degrees(static_cast<float>(azimuth));
  v1::Mesh& mesh = *scene.mutable_object()->mutable_mesh();
  v1::Vec3& factors = *mesh.add_transforms()->mutable_scale();
  factors.set_x(static_cast<float>(size));
  factors.set_y(1);
  factors.set_z(1);
  v1::Rotation& rotation = *mesh.add_transforms()->mutable_rotate();
  rotation.mutable_axis()->set_y(1);
  rotation.set_angle_degrees(static_cast<float>(turn));
  return scene;
}

SceneCache::ScenePtr build_in(SceneCache& cache, const v1::Scene& scene) {
  return cache.get_or_build(sha256(scene.SerializeAsString()), [&] {
    return std::make_shared<const tracer::Scene>(build_scene(scene, RenderLimits(), &cache.parts()),
                                                 cache.parts());
  });
}

tracer::FilmSums render(const tracer::Scene& scene, tracer::Tracer tracer) {
  tracer::RenderRequest request{.material = {8, 0.9, 0.3}, .sample_count = 4};
  request.tracer = tracer;
  request.pixels = tracer::Pixels::kObject;
  return tracer::render_grad(scene, request);
}

// A cube of another medium, both behind rough boundaries.
void add_other(v1::Scene& scene, double x) {
  scene.mutable_object()->mutable_rough_dielectric();
  v1::Object& other = *scene.add_other_objects();
  other.mutable_mesh()->set_builtin("cube");
  v1::Vec3& by = *other.mutable_mesh()->add_transforms()->mutable_translate();
  by.set_x(static_cast<float>(x));
  other.mutable_rough_dielectric();
  v1::Material& material = *other.add_material();
  material.set_sigma_t(3);
  material.set_albedo(0.5);
}

// An answer depends on the request alone, whatever of its scene was compiled for others.
TEST(SceneCache, RendersAreTheSameWhateverIsHeld) {
  SceneCache warm(size_t{1} << 30);
  // The last number says where another object stands, 0: none.
  for (const auto& [size, turn, azimuth, other_x] :
       {std::array{1.0, 0.0, 0.0, 0.0}, std::array{1.0, 40.0, 0.0, 0.0},
        std::array{1.0, 40.0, 70.0, 0.0}, std::array{2.0, 40.0, 70.0, 0.0},
        std::array{1.0, 0.0, 0.0, 0.0}, std::array{1.0, 40.0, 0.0, 2.0},
        std::array{1.0, 40.0, 0.0, 1.8}, std::array{1.0, 20.0, 0.0, 1.8}}) {
    v1::Scene scene = turned_cube(size, turn, azimuth);
    if (other_x > 0) add_other(scene, other_x);
    const auto shared = build_in(warm, scene);
    SceneCache cold(0);
    const auto alone = build_in(cold, scene);
    const tracer::Scene unshared(build_scene(scene, RenderLimits()));
    for (const auto tracer : {tracer::Tracer::kWavefront, tracer::Tracer::kReference}) {
      const tracer::FilmSums expected = render(unshared, tracer);
      for (const tracer::Scene* other : {shared.get(), alone.get()}) {
        const tracer::FilmSums sums = render(*other, tracer);
        EXPECT_EQ(sums.hits, expected.hits);
        EXPECT_EQ(sums.estimates[0].radiance, expected.estimates[0].radiance);
        EXPECT_EQ(sums.estimates[0].counts, expected.estimates[0].counts);
      }
    }
  }
}

// What is made when it is first asked for counts too.
TEST(SceneCache, StaysWithinItsBudget) {
  constexpr size_t kBudget = size_t{4} << 20;
  SceneCache cache(kBudget);
  size_t most = 0;
  for (int i = 0; i < 5000; ++i) {
    const auto scene = build_in(cache, turned_cube(1 + (i / 50) * 0.01, i * 0.01, i % 50));
    if (i % 5 == 0) {
      const size_t before = cache.memory();
      render(*scene, i % 100 == 0 ? tracer::Tracer::kReference : tracer::Tracer::kWavefront);
      if (i == 0) {
        EXPECT_GT(cache.memory(), before);
      }
    }
    most = std::max(most, cache.memory());
  }
  EXPECT_LE(most, kBudget);
  EXPECT_GT(most, kBudget / 2);
}

// A scene is what its parts are: they stay as long as it does, count as long, and go with it.
TEST(SceneCache, CountsThePartsOfWhatIsTooLargeForIt) {
  SceneCache cache(0);
  {
    const auto scene = build_in(cache, turned_cube(1, 0, 0));
    EXPECT_GE(cache.excess_of(*scene), scene->memory() + scene->compiled().object->memory());
    EXPECT_GE(cache.excess(), cache.excess_of(*scene));
    EXPECT_LE(cache.excess(), cache.excess_of(*scene) + 1024);  // what an entry costs
  }
  EXPECT_EQ(cache.memory(), 0U);
}

TEST(SceneCache, ForgetsThePartsOfASceneThatFailed) {
  SceneCache cache(0);
  EXPECT_THROW(cache.get_or_build("a",
                                  [&]() -> SceneCache::ScenePtr {
                                    const tracer::Scene complete(
                                        build_scene(turned_cube(1, 0, 0), {}, &cache.parts()),
                                        cache.parts());
                                    throw std::runtime_error("no");
                                  }),
               std::runtime_error);
  EXPECT_EQ(cache.memory(), 0U);
}

// The parts of a scene that is in use are not the first to go.
TEST(SceneCache, APartOutlivesTheScenesThatHoldIt) {
  SceneCache cache(size_t{1} << 30);
  const v1::Scene first = turned_cube(1, 0, 0);
  const auto scene = build_in(cache, first);
  build_in(cache, turned_cube(2, 0, 0));
  cache.find(sha256(first.SerializeAsString()));
  const auto turned = build_in(cache, turned_cube(1, 30, 0));
  EXPECT_EQ(turned->compiled().object, scene->compiled().object);
}

}  // namespace
}  // namespace itn
