// Scenes in parts: poses, what scenes share, and stopping while parts are compiled.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>
#include <latch>
#include <limits>
#include <memory>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "common/error.h"
#include "common/part_cache.h"
#include "server/tracer/render.h"
#include "server/tracer/scene/compiled_scene.h"
#include "server/tracer/scene/object_pixels.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

struct Number {
  int value;
  size_t memory() const { return sizeof(*this); }
};

std::shared_ptr<const Number> number(int value) {
  return std::make_shared<const Number>(Number{value});
}

// Returns when others wait for the part that is being built.
void until_someone_asks(const std::atomic<int>& asking, int how_many) {
  while (asking < how_many) std::this_thread::yield();
}

TEST(PartCache, TakesOverFromABuilderThatWasCancelled) {
  PartCache cache(1 << 20);
  std::latch building(1), asked(1);
  std::jthread first([&] {
    EXPECT_THROW(cache.get<Number>("n", {},
                                   [&]() -> std::shared_ptr<const Number> {
                                     building.count_down();
                                     asked.wait();
                                     throw Error(ErrorKind::kCancelled, "stopped");
                                   }),
                 Error);
  });
  building.wait();
  std::jthread second([&] {
    asked.count_down();
    EXPECT_EQ(cache.get<Number>("n", {}, [] { return number(2); })->value, 2);
  });
  second.join();
  EXPECT_EQ(cache.find<Number>("n")->value, 2);
}

TEST(PartCache, WaitingForABuildCanBeStopped) {
  PartCache cache(1 << 20);
  std::latch building(1), stopped(1);
  std::jthread first([&] {
    cache.get<Number>("n", {}, [&] {
      building.count_down();
      stopped.wait();
      return number(1);
    });
  });
  building.wait();
  std::stop_source stop;
  std::atomic<int> asking = 0;
  std::jthread second([&] {
    ++asking;
    EXPECT_THROW(cache.get<Number>("n", stop.get_token(), [] { return number(2); }), Error);
    stopped.count_down();
  });
  until_someone_asks(asking, 1);
  stop.request_stop();
  first.join();
  EXPECT_EQ(cache.find<Number>("n")->value, 1);
}

TEST(PartCache, ForgetsTheLeastRecentlyUsed) {
  PartCache cache(std::numeric_limits<size_t>::max());
  cache.get<Number>("a", {}, [] { return number(1); });
  const size_t each = cache.memory();
  PartCache small(2 * each);
  for (const char* key : {"a", "b"}) small.get<Number>(key, {}, [] { return number(1); });
  small.touch(std::vector<std::string>{"a"});
  small.get<Number>("c", {}, [] { return number(1); });
  EXPECT_NE(small.find<Number>("a"), nullptr);
  EXPECT_EQ(small.find<Number>("b"), nullptr);
  EXPECT_LE(small.memory(), 2 * each);
}

// 4096 x 4096 pixels are looked at for seconds, unless that is stopped.
TEST(ObjectPixelsTest, AreNotLookedForAfterAStop) {
  const Scene scene(studio("sphere", {ConstantLight{1}}, -1, 4096));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW(scene.compiled().object_pixels(1, stop.get_token()), Error);
}

// They are the pixels that any of their rays shows to see the object, whatever was tried first and
// by whom.
TEST(ObjectPixelsTest, AreThoseOfWhichARaySeesTheObject) {
  const Scene scene(studio("knot", {ConstantLight{1}}, 0.5F, 24));
  const ObjectPixels one(scene.compiled(), 1, {}), many(scene.compiled(), 3, {});
  EXPECT_EQ(one.pixels, many.pixels);
  std::vector<uint32_t> expected;
  for (uint32_t pixel = 0; pixel < 24 * 24; ++pixel) {
    bool sees = false;
    for (int ray = 0; ray < 16; ++ray) {
      const CameraRay from = scene.compiled().camera_ray(pixel % 24 + (ray % 4 + 0.5) / 4,
                                                         pixel / 24 + (ray / 4 + 0.5) / 4);
      sees =
          sees ||
          scene.compiled().geometry().follow({from.origin, false, {}}, from.direction, 0).entered;
    }
    if (sees) expected.push_back(pixel);
  }
  std::vector<uint32_t> different;
  std::set_symmetric_difference(one.pixels.begin(), one.pixels.end(), expected.begin(),
                                expected.end(), std::back_inserter(different));
  EXPECT_LE(different.size(), 1U);  // rounding decides where a ray grazes the object
  EXPECT_GT(expected.size(), 100U);
  EXPECT_LT(expected.size(), 24U * 24);
}

// A turn about an axis (Rodrigues' formula).
Rotation<double> turn(Vec3d axis, double angle) {
  const Vec3d k = itn::normalize(axis);
  const double c = std::cos(angle), s = std::sin(angle), t = 1 - c;
  return {{c + t * k.x * k.x, t * k.x * k.y - s * k.z, t * k.x * k.z + s * k.y},
          {t * k.x * k.y + s * k.z, c + t * k.y * k.y, t * k.y * k.z - s * k.x},
          {t * k.x * k.z - s * k.y, t * k.y * k.z + s * k.x, c + t * k.z * k.z}};
}

// Scenes of an object share the normals of its boundary, which none of them counts as its own.
TEST(ScenePartsTest, NormalsAreShared) {
  PartCache parts(std::numeric_limits<size_t>::max());
  const auto scene_of = [&](const Boundary& boundary, float smooth_angle) {
    SceneDescription description = studio("smooth_star", {ConstantLight{1}});
    description.object_key = "a star";
    description.boundary = boundary;
    description.smooth_angle = smooth_angle;
    return std::make_unique<Scene>(std::move(description), parts);
  };
  const auto matched = scene_of(IndexMatched{}, 0);
  const size_t object = parts.memory();
  const auto rough = scene_of(RoughDielectric{1.5F, 0.3F}, 0.5F);
  const size_t with_normals = parts.memory();
  EXPECT_GT(with_normals, object + 1'000'000);
  EXPECT_LT(rough->memory(), matched->memory() + 1000);
  const auto again = scene_of(RoughDielectric{1.3F, 0.1F}, 0.5F);
  EXPECT_EQ(parts.memory(), with_normals);
}

EnvironmentMapLight striped_map() {
  EnvironmentMapLight map;
  map.width = 8;
  map.height = 4;
  for (int i = 0; i < map.width * map.height; ++i) {
    const auto v = static_cast<float>(1 + i % 8);
    map.rgb.insert(map.rgb.end(), {v, v, v});
  }
  map.rotate_y = 0.4;
  return map;
}

struct PoseRow {
  const char* name;
  Pose pose;
};

class PoseTest : public ::testing::TestWithParam<PoseRow> {};

// A pose does what turning and moving the mesh does: with every kind of light, with a ground that
// has a pattern, with both tracers.
TEST_P(PoseTest, IsWhereTheMeshStands) {
  SceneDescription posed =
      studio("figure",
             {paper_sun_sky(0.5), striped_map(), ConstantLight{5}, DirectionalLight{{1, 1, -1}, 30},
              PointLight{{1, 1.5, -1}, 1e-4}, SpotLight{{-1, 1.5, -1}, {0, 0.5, 0}, 1e-4},
              SphereLight{{1, 1, 1}, 0.2, 50},
              PanelLight{{-1, 0.8, 0.5}, {0.1, 0, 0.3}, {0.1, -0.3, 0}, 50}},
             0.5F, 16);
  posed.surfaces[0].reflectance =
      Checkerboard{.corner = {0.1, 0, 0}, .edge_u = {0.5, 0, 0}, .edge_v = {0.2, 0, 0.4}};
  posed.pose = GetParam().pose;
  SceneDescription moved = posed;
  moved.pose = {};
  for (Vec3f& v : moved.object.vertices) {
    v = static_cast<Vec3f>(posed.pose.to_scene(static_cast<Vec3d>(v)));
  }
  const Scene a(std::move(posed)), b(std::move(moved));
  for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
    RenderRequest request{.material = {10, 0.8, 0.3}, .sample_count = 16};
    request.tracer = tracer;
    const FilmEstimate one = estimate_film(a, request, 24, 1),
                       other = estimate_film(b, request, 24, 101);
    const std::string name = GetParam().name;
    expect_equal(one.radiance, other.radiance, 8, name);
    EXPECT_LT(other.radiance.standard_error, 0.02 * other.radiance.mean) << "too noisy to tell";
    EXPECT_EQ(one.counters.leaks, 0U);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Poses, PoseTest,
    ::testing::Values(PoseRow{"turned about y", {turn({0, 1, 0}, 1.1), {}}},
                      PoseRow{"lifted and turned", {turn({0, 1, 0}, -2), {0.1, 0.2, -0.1}}},
                      PoseRow{"tilted", {turn({1, 2, 3}, 0.9), {0.1, 0.7, 0.2}}}),
    [](const auto& row) {
      std::string name = row.param.name;
      std::replace(name.begin(), name.end(), ' ', '_');
      return name;
    });

}  // namespace
}  // namespace itn::testing
