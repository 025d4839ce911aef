// What a render promises: the same bits in every arrangement, sums of parts, cancellation, errors.
#include "server/tracer/simd/targets.h"
// After targets.h:
#include "server/tracer/render.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include <hwy/targets.h>

#include "common/error.h"
#include "tests/server/tracer/scenes.h"
#include "tests/support/expect_error.h"
#include "tests/support/process.h"

namespace itn::testing {
namespace {

using namespace tracer;

const Scene& mug_in_the_sun() {
  static const Scene scene(studio("mug", {paper_sun_sky()}, 0.5F, 24));
  return scene;
}

RenderRequest request() {
  return {.material = {60, 0.9, 0.4},
          .sample_count = 12,
          .seed = 42,
          .derivatives = medium_parameters(),
          .estimates = 3};
}

EnvironmentMapLight small_map() {
  EnvironmentMapLight map;
  map.width = 16;
  map.height = 8;
  for (int i = 0; i < 3 * map.width * map.height; ++i) {
    map.rgb.push_back(static_cast<float>(i * 13 % 31) / 10);
  }
  return map;
}

void expect_same(const FilmSums& a, const FilmSums& b) {
  ASSERT_EQ(a.estimates.size(), b.estimates.size());
  for (size_t k = 0; k < a.estimates.size(); ++k) {
    EXPECT_EQ(a.estimates[k].radiance, b.estimates[k].radiance);
    EXPECT_EQ(a.estimates[k].derivatives, b.estimates[k].derivatives);
    EXPECT_EQ(a.estimates[k].other_media, b.estimates[k].other_media);
    EXPECT_EQ(a.estimates[k].counts, b.estimates[k].counts);
  }
  EXPECT_EQ(a.squares, b.squares);
  EXPECT_EQ(a.hits, b.hits);
  EXPECT_EQ(a.counters.paths, b.counters.paths);
  EXPECT_EQ(a.counters.steps, b.counters.steps);
}

TEST(RenderTest, ThreadsDoNotMatter) {
  expect_same(render_grad(mug_in_the_sun(), request(), {.threads = 1}),
              render_grad(mug_in_the_sun(), request(), {.threads = 2}));
}

// The sums of a tile's pixels, and the same pixels' of the whole.
void expect_same_pixels(const FilmSums& part, const FilmSums& whole) {
  for (int y = 0; y < part.height; ++y) {
    for (int x = 0; x < part.width; ++x) {
      const auto pixel = static_cast<uint32_t>((part.y + y) * whole.width + part.x + x);
      const size_t i = part.index_of(pixel), j = whole.index_of(pixel);
      ASSERT_EQ(i, static_cast<size_t>(y * part.width + x));
      for (size_t k = 0; k < whole.estimates.size(); ++k) {
        const auto &a = part.estimates[k], &b = whole.estimates[k];
        EXPECT_EQ(a.counts[i], b.counts[j]);
        EXPECT_EQ(a.radiance[i], b.radiance[j]);
        for (size_t d = 0; d < b.derivatives.size(); ++d) {
          EXPECT_EQ(a.derivatives[d][i], b.derivatives[d][j]);
        }
      }
      EXPECT_EQ(part.squares[i], whole.squares[j]);
      EXPECT_EQ(part.hits[i], whole.hits[j]);
    }
  }
}

const Tile kTiles[] = {{0, 0, 24, 24}, {0, 0, 9, 7}, {9, 7, 15, 17}, {11, 12, 1, 1}, {20, 3, 4, 5}};

TEST(RenderTest, TilesAreTheirPartOfTheWhole) {
  for (const Pixels pixels : {Pixels::kAll, Pixels::kObject}) {
    RenderRequest s = request();
    s.pixels = pixels;
    const FilmSums whole = render_grad(mug_in_the_sun(), s);
    for (const Tile& tile : kTiles) {
      s.tile = tile;
      const FilmSums part = render_grad(mug_in_the_sun(), s);
      EXPECT_EQ(part.squares.size(), tile.width * tile.height);
      expect_same_pixels(part, whole);
    }
  }
}

// The pilot of a tile sees the pixels around it, so that its control variates are those of the
// whole.
TEST(RenderTest, TilesWithAPilotSeeTheirSurroundings) {
  RenderRequest s = request();
  s.pilot_spp = 2;
  const RenderOptions even{.switches = {.adaptive = false}};
  const FilmSums whole = render_grad(mug_in_the_sun(), s, even);
  for (const Tile& tile : kTiles) {
    s.tile = tile;
    expect_same_pixels(render_grad(mug_in_the_sun(), s, even), whole);
  }
}

// About as many samples as were asked for, spread within the tile.
TEST(RenderTest, TilesWithAPilotHaveTheirOwnSamples) {
  RenderRequest s = request();
  s.pilot_spp = 2;
  s.sample_count = 60;
  s.tile = {6, 4, 12, 16};
  const FilmSums part = render_grad(mug_in_the_sun(), s);
  const auto& counts = part.estimates[0].counts;
  const auto [least, most] = std::minmax_element(counts.begin(), counts.end());
  EXPECT_LT(*least, *most);
  const double paths = 12 * 16 * 60 + 16 * 20 * 2;
  EXPECT_NEAR(static_cast<double>(part.counters.paths), paths, 0.05 * paths);
}

TEST(RenderTest, TilesLieInTheFilm) {
  RenderRequest s = request();
  for (const Tile& tile : {Tile{0, 0, 0, 1}, Tile{0, 0, 1, 0}, Tile{0, 0, 25, 1}, Tile{24, 0, 1, 1},
                           Tile{0, 20, 1, 5}, Tile{UINT32_MAX, 0, 2, 1}}) {
    s.tile = tile;
    testing::expect_error(ErrorKind::kInvalidInput, {"tile is ", "lie in the film, 24 x 24"},
                          [&] { render_grad(mug_in_the_sun(), s); });
  }
}

// The same bits from vectors of every width, and from none.
TEST(RenderTest, InstructionSetsDoNotMatter) {
  RenderRequest s = request();
  s.pilot_spp = 4;
  s.albedos = {0.5};
  s.derivatives.push_back({Parameter::kReflectance, 0});
  s.derivatives.push_back({Parameter::kLightScale, 0});
  const Scene map_lit(studio("twist", {ConstantLight{0.2}, small_map()}, 0.5F, 16));
  const Scene lamp_lit(studio("cube", {PointLight{{1, 2, 0}, 4e-6}, ConstantLight{0.2}}, 0.5F, 16));
  for (const Scene* scene : {&mug_in_the_sun(), &map_lit, &lamp_lit}) {
    const FilmSums best = render_grad(*scene, s);
    int sets = 0;
    for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      expect_same(render_grad(*scene, s), best);
      hwy::SetSupportedTargetsForTest(0);
      ++sets;
    }
    EXPECT_GE(sets, 1);
    std::printf("  %d instruction sets\n", sets);
  }
}

// Sums hold the smallest lamp that the camera looks into beside the faintest light.
TEST(RenderTest, ALampInViewDropsNothing) {
  SceneDescription scene = studio("cube", {SphereLight{{0, 3, 0}, 1e-4, 1e9}, ConstantLight{1e-6}});
  scene.camera = {.origin = {0, 3, -1}, .target = {0, 3, 0}, .up = {0, 1, 0}, .fov = 1e-5};
  scene.film = {1, 1};
  const RenderRequest into_it{.material = {60, 0.9, 0}, .sample_count = 4, .estimates = 1};
  SceneDescription beside = scene;
  beside.camera.target = {0.1, 3, 0};
  for (const auto& [seen, radiance] : {std::pair{scene, 1e9F}, std::pair{beside, 1e-6F}}) {
    const FilmSums sums = render_grad(Scene(seen), into_it);
    EXPECT_EQ(sums.counters.invalid_samples, 0U);
    EXPECT_EQ(means(sums).estimates[0].radiance[0], radiance);
  }
}

// A triangle that is next to nothing hides next to nothing; one without an area nothing.
TEST(RenderTest, SmallTrianglesAreMetWhereTheyAre) {
  const SceneDescription open = studio("cube", {ConstantLight{1}}, -1, 16);
  const auto beside = [&](float size) {
    SceneDescription scene = open;
    scene.surfaces.push_back(
        {{{{0, -0.5F, 0}, {size, -0.5F, 0}, {0, -0.5F, size}}, {{0, 1, 2}}}, 0.0F});
    return means(render_grad(Scene(std::move(scene)), request()));
  };
  const RenderedImages expected = means(render_grad(Scene(open), request()));
  for (const float size : {0.0F, 1e-30F, 1e-8F, 1e-5F}) {
    EXPECT_EQ(beside(size).estimates[0].radiance, expected.estimates[0].radiance) << size;
  }
}

TEST(RenderTest, NormalsThatPointInwardsAreRefused) {
  SceneDescription scene = studio("cube", {ConstantLight{1}});
  scene.boundary = RoughDielectric{};
  scene.corner_normals.assign(scene.object.triangles.size(),
                              {Vec3f{0, 1, 0}, {0, 1, 0}, {0, 1, 0}});
  expect_error(ErrorKind::kInvalidInput, {"corner_normals", "does not point outwards"},
               [&] { Scene refused(std::move(scene)); });
}

// A direction along an axis, whatever the signs of its zeros.
TEST(RenderTest, ZerosHaveNoSign) {
  const auto image = [](Vec3d direction) {
    SceneDescription scene = studio("sphere", {DirectionalLight{direction, 3}});
    return means(render_grad(Scene(std::move(scene)), request()));
  };
  for (const Vec3d axis :
       {Vec3d{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}) {
    const auto signed_zero = [](double x) { return x == 0 ? -0.0 : x; };
    const RenderedImages expected = image(axis);
    const RenderedImages got =
        image({signed_zero(axis.x), signed_zero(axis.y), signed_zero(axis.z)});
    EXPECT_EQ(got.estimates[0].radiance, expected.estimates[0].radiance);
  }
}

// With the same roulette, walks are as long as those of the reference.
TEST(RenderTest, TheUsualRouletteWalksAsFarAsTheReference) {
  RenderRequest s = request();
  const RenderOptions usual{.switches = {.throughput_roulette = true}};
  std::vector<double> ratios;
  for (s.seed = 0; s.seed < 64; ++s.seed) {
    RenderRequest reference = s;
    reference.tracer = Tracer::kReference;
    reference.seed = s.seed + 1000;
    const Counters ours = render_grad(mug_in_the_sun(), s, usual).counters;
    const Counters theirs = render_grad(mug_in_the_sun(), reference, usual).counters;
    ratios.push_back(static_cast<double>(ours.steps) / static_cast<double>(theirs.steps));
  }
  expect_equal(over_batches(ratios), {1, 0}, 1, "steps");
  expect_resolution(over_batches(ratios), 1, 0.01, "steps");
}

TEST(RenderTest, SamplesGoToImportantPixels) {
  RenderRequest s = request();
  s.sample_count = 60;
  s.pilot_spp = 4;
  const size_t pixels = render_grad(mug_in_the_sun(), s).squares.size();
  s.sampling_weights.assign(pixels, 1);
  const FilmSums even = render_grad(mug_in_the_sun(), s);
  for (size_t p = 0; p < pixels; ++p) s.sampling_weights[p] = static_cast<float>(p % 3);
  const FilmSums sums = render_grad(mug_in_the_sun(), s);
  std::array<double, 3> ratio{};
  for (size_t p = 0; p < pixels; ++p) {
    ratio[p % 3] += sums.estimates[0].counts[p] / static_cast<double>(even.estimates[0].counts[p]);
  }
  EXPECT_EQ(ratio[0], 0);
  EXPECT_NEAR(ratio[2] / ratio[1], 2, 0.1);
}

// However important, and where nothing that is rendered is.
TEST(RenderTest, ExtremesOfImportance) {
  RenderRequest s = request();
  s.pilot_spp = 1;
  const size_t pixels = render_grad(mug_in_the_sun(), s).squares.size();
  s.sampling_weights.assign(pixels, 0);
  const FilmSums none = render_grad(mug_in_the_sun(), s);
  EXPECT_EQ(none.estimates[0].counts[pixels / 2], s.sample_count / s.estimates);
  s.sampling_weights[pixels / 2] = 1e30F;
  const FilmSums one = render_grad(mug_in_the_sun(), s);
  EXPECT_EQ(one.estimates[0].counts[pixels / 2], pixels * s.sample_count / s.estimates);
  EXPECT_EQ(one.counters.paths, pixels * (s.sample_count + 1));
}

// A camera in the mug: parts of the object's box lie behind it.
TEST(RenderTest, ObjectPixelsOfANearCamera) {
  SceneDescription near = studio("mug", {ConstantLight{1}}, 0.5F, 24);
  near.camera.origin = {0, 0.9, 0};
  near.camera.target = {0, 0.5, 0.4};
  near.camera.fov = 1.9;
  const Scene scene(std::move(near));
  RenderRequest s = request();
  const FilmSums all = render_grad(scene, s);
  s.pixels = Pixels::kObject;
  const FilmSums object = render_grad(scene, s);
  int seen = 0, missed = 0;
  for (size_t p = 0; p < all.hits.size(); ++p) {
    seen += all.hits[p] > 0 ? 1 : 0;
    missed += all.hits[p] > 2 && object.hits[p] == 0 ? 1 : 0;
  }
  EXPECT_GT(seen, 50);
  EXPECT_EQ(missed, 0);
}

TEST(RenderTest, APilotMovesSamplesToTheNoise) {
  RenderRequest s = request();
  s.sample_count = 64;
  s.pilot_spp = 8;
  const FilmSums sums = render_grad(mug_in_the_sun(), s);
  uint64_t total = 0;
  uint32_t least = UINT32_MAX, most = 0;
  for (size_t p = 0; p < sums.squares.size(); ++p) {
    uint32_t n = 0;
    for (const auto& estimate : sums.estimates) n += estimate.counts[p];
    total += n;
    least = std::min(least, n);
    most = std::max(most, n);
  }
  const auto pixels = static_cast<double>(sums.squares.size());
  EXPECT_NEAR(static_cast<double>(total) / pixels, 64, 2);
  EXPECT_GE(least, 15U);
  EXPECT_GT(10 * most, 13 * least);
}

TEST(RenderTest, ObjectPixelsAreThoseOfTheWhole) {
  RenderRequest object = request();
  object.pixels = Pixels::kObject;
  const FilmSums part = render_grad(mug_in_the_sun(), object);
  const FilmSums whole = render_grad(mug_in_the_sun(), request());
  int rendered = 0, missed = 0;
  for (size_t p = 0; p < whole.squares.size(); ++p) {
    const bool sees = part.estimates[0].counts[p] > 0;
    rendered += sees ? 1 : 0;
    EXPECT_EQ(part.estimates[0].radiance[p], sees ? whole.estimates[0].radiance[p] : 0);
    missed += !sees && whole.hits[p] > 2 ? 1 : 0;  // of 12 camera rays
  }
  EXPECT_GT(rendered, 100);
  EXPECT_LT(rendered, 24 * 24 - 50);
  EXPECT_EQ(missed, 0);
}

TEST(RenderTest, TheMaterialsOwnAlbedoIsTheImage) {
  RenderRequest s = request();
  s.albedos = {s.material.albedo, 0};
  const FilmSums sums = render_grad(mug_in_the_sun(), s);
  EXPECT_EQ(sums.estimates[1].other_media[0], sums.estimates[1].radiance);
  EXPECT_NE(sums.estimates[1].other_media[1], sums.estimates[1].radiance);
}

// But for the roulette, in which they count.
TEST(RenderTest, DerivativesDoNotChangeTheImage) {
  RenderRequest both = request(), image = request();
  const RenderOptions same{.tuning = {.shadow_ray_roulette = 0},
                           .switches = {.throughput_roulette = true}};
  image.derivatives = {};
  EXPECT_EQ(render_grad(mug_in_the_sun(), image, same).estimates[1].radiance,
            render_grad(mug_in_the_sun(), both, same).estimates[1].radiance);
}

TEST(RenderTest, EstimatesShareTheSamples) {
  RenderRequest several = request(), single = request();
  // Sequences belong to estimates.
  const RenderOptions independent{.switches = {.stratified = false}};
  single.estimates = 1;
  const FilmSums whole = render_grad(mug_in_the_sun(), single, independent);
  FilmSums shared = render_grad(mug_in_the_sun(), several, independent);
  for (size_t k = 1; k < shared.estimates.size(); ++k) {
    for (size_t p = 0; p < whole.squares.size(); ++p) {
      shared.estimates[0].radiance[p] += shared.estimates[k].radiance[p];
    }
  }
  EXPECT_EQ(shared.estimates[0].radiance, whole.estimates[0].radiance);
}

TEST(RenderTest, SamplesOfEstimate) {
  for (uint32_t count = 1; count < 12; ++count) {
    for (uint32_t k = 0; k < 3; ++k) {
      uint32_t expected = 0;
      for (uint32_t i = 0; i < count; ++i) expected += i % 3 == k ? 1 : 0;
      EXPECT_EQ(samples_of_estimate(count, k, 3), expected) << count << " " << k;
    }
  }
}

TEST(RenderTest, SeedsAreIndependent) {
  RenderRequest other = request();
  other.seed = 43;
  EXPECT_NE(render_grad(mug_in_the_sun(), other).estimates[0].radiance,
            render_grad(mug_in_the_sun(), request()).estimates[0].radiance);
}

// The standard error is that of the mean of independent samples: over many seeds, the mean of its
// square is the variance. Stratified samples do better than it claims.
double claimed_over_measured_variance(bool stratified) {
  const Scene scene(studio("cube", {paper_sun_sky()}, 0.5F, 8));
  RenderRequest s{.material = {30, 0.8, 0}, .sample_count = 32};
  const RenderOptions options{.switches = {.stratified = stratified}};
  constexpr int kSeeds = 200;
  std::vector<double> sum(64), squares(64), claimed(64);
  for (int seed = 0; seed < kSeeds; ++seed) {
    s.seed = static_cast<uint64_t>(seed);
    const RenderedImages images = means(render_grad(scene, s, options));
    for (size_t p = 0; p < 64; ++p) {
      const double v = images.estimates[0].radiance[p], e = images.standard_error[p];
      sum[p] += v;
      squares[p] += v * v;
      claimed[p] += e * e;
    }
  }
  double measured_variance = 0, claimed_variance = 0;
  for (size_t p = 0; p < 64; ++p) {
    measured_variance += (squares[p] - sum[p] * sum[p] / kSeeds) / (kSeeds - 1);
    claimed_variance += claimed[p] / kSeeds;
  }
  return claimed_variance / measured_variance;
}

TEST(RenderTest, StandardErrorIsCalibrated) {
  EXPECT_NEAR(claimed_over_measured_variance(false), 1, 0.05);
  EXPECT_GT(claimed_over_measured_variance(true), 1.1);
}

TEST(RenderTest, MaskIsTheObject) {
  const RenderedImages images = means(render_grad(mug_in_the_sun(), request()));
  EXPECT_EQ(images.mask[0], 0);             // a corner of the film
  EXPECT_EQ(images.mask[24 * 14 + 12], 1);  // its middle
}

// The camera looks into the smallest sun, far brighter than anything else: still counted.
TEST(RenderTest, TheSunItselfIsNotDropped) {
  SceneDescription description = studio(
      "cube", {SunSkyLight{.sun_elevation = 0.5, .sun_angular_radius = 1.75e-3, .sky_scale = 0}});
  description.camera = {
      .origin = {0, 5, 0}, .target = {0, 5 + std::sin(0.5), -std::cos(0.5)}, .fov = 1e-4};
  const FilmSums sums =
      render_grad(Scene(std::move(description)), {.material = {10, 0.5, 0}, .sample_count = 4});
  EXPECT_EQ(sums.counters.invalid_samples, 0U);
  EXPECT_GT(film_mean(sums, -1), 1e6);
}

// Paths that have ended are at no place, and a map is looked up in no direction from there: these
// looked it up beyond its pixels.
TEST(RenderTest, EndedPathsLookUpNoMap) {
  SceneDescription description =
      studio("cube", {small_map(), PointLight{{1, 2, 0}, 4e-6}, paper_sun_sky()}, 0.5F, 4);
  description.boundary = RoughDielectric{};
  const Scene scene(std::move(description));
  for (uint64_t seed = 0; seed < 300; ++seed) {
    const FilmSums sums =
        render_grad(scene, {.material = {4, 0.9, 0}, .sample_count = 3, .seed = seed});
    EXPECT_EQ(sums.counters.invalid_samples, 0U);
  }
}

// A surface in front of the object hides it: the camera ray starts at the object's box, but what
// stands before the box counts.
TEST(RenderTest, ASurfaceMayStandInFront) {
  SceneDescription description = studio("cube", {ConstantLight{1}}, -1, 4);
  Mesh screen = box({-2, -2, -10}, {2, 6, -9.9F});
  description.surfaces.push_back({screen, 0});
  const Scene scene(std::move(description));
  const FilmSums sums = render_grad(scene, {.material = {10, 0.9, 0}, .sample_count = 4});
  EXPECT_EQ(film_mean(sums, -1), 0);
}

TEST(RenderTest, StopsSoon) {
  std::stop_source stop;
  RenderRequest endless = request();
  endless.sample_count = 1U << 19;
  const double start = testing::own_cpu_seconds();
  double stopped = 0;
  std::jthread stopper([&] {
    EXPECT_TRUE(testing::eventually([&] { return testing::own_cpu_seconds() > start + 0.5; }));
    stopped = testing::own_cpu_seconds();
    stop.request_stop();
  });
  try {
    render_grad(mug_in_the_sun(), endless, {.threads = 1}, stop.get_token());
    FAIL() << "was not stopped";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kCancelled);
  }
  stopper.join();
  EXPECT_LT(testing::own_cpu_seconds() - stopped, 0.05) << "processor time after the stop, in s";
}

TEST(RenderTest, RefusesBadSettings) {
  std::vector<RenderRequest> bad(12, request());
  bad[0].material.albedo = 1.2;
  bad[1].material.g = 1;
  bad[2].material.sigma_t = 0;
  bad[3].material.sigma_t = std::nan("");
  bad[4].estimates = 17;
  bad[5].sample_count = 2;  // fewer than estimates
  bad[6].albedos = {0.95};  // above that of the material
  bad[7].albedos.assign(kMaxAlbedos + 1, 0.1);
  bad[8].pilot_spp = 65;
  bad[9].tracer = Tracer::kReference;
  bad[9].pilot_spp = 1;
  bad[10].sampling_weights = {1, 1};  // not one for each pixel
  bad[11].sampling_weights.assign(render_grad(mug_in_the_sun(), request()).squares.size(), -1);
  for (size_t i = 0; i < bad.size(); ++i) {
    EXPECT_THROW(render_grad(mug_in_the_sun(), bad[i]), Error) << "row " << i;
  }
}

TEST(SceneTest, RefusesOpenAndInsideOutMeshes) {
  SceneDescription open = studio("cube", {ConstantLight{1}});
  open.object.triangles.pop_back();
  try {
    const Scene scene(open);
    FAIL() << "an open mesh was accepted";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("open edge"), std::string::npos) << error.what();
  }
  SceneDescription inverted = studio("cube", {ConstantLight{1}});
  for (auto& triangle : inverted.object.triangles) std::swap(triangle[0], triangle[1]);
  EXPECT_THROW(Scene{inverted}, Error);
}

}  // namespace
}  // namespace itn::testing
