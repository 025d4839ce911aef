// Several translucent objects of different media.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "common/error.h"
#include "tests/server/tracer/scenes.h"
#include "tests/support/expect_error.h"

namespace itn::testing {
namespace {

using namespace tracer;

const Material kJade{20, 0.9, 0.4}, kMilk{60, 0.97, 0.7};

Parameter of_boundary(const std::string& name) {
  return parameter_named("rough_dielectric." + name);
}
std::vector<Parameter> of_medium_and_boundary() {
  std::vector<Parameter> all = medium_parameters();
  all.push_back(of_boundary("index"));
  all.push_back(of_boundary("roughness"));
  return all;
}

SceneDescription with_other(SceneDescription scene, Mesh mesh, const Material& material,
                            const Boundary& boundary) {
  scene.other_objects.push_back({std::move(mesh), material, boundary});
  return scene;
}

// Two boxes next to each other, on a floor, under a sky with a wide sun.
const Mesh kLeft = box({-0.42F, 0, -0.2F}, {-0.03F, 0.5F, 0.2F}),
           kRight = box({0.03F, 0, -0.2F}, {0.42F, 0.4F, 0.3F});
SceneDescription two_boxes(const Boundary& boundary) {
  SceneDescription scene = studio("cube", {paper_sun_sky(), ConstantLight{5}}, 0.4F);
  scene.object = kLeft;
  scene.boundary = boundary;
  return scene;
}
Mesh joined(Mesh a, const Mesh& b) {
  const auto vertices = static_cast<uint32_t>(a.vertices.size());
  a.vertices.insert(a.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const auto& [i, j, k] : b.triangles) {
    a.triangles.push_back({i + vertices, j + vertices, k + vertices});
  }
  return a;
}

// An object of two parts is two objects of the same medium: bit for bit, where roulette does not
// look at derivatives, and those of the one are the sums of those of the two.
TEST(OtherObjectsTest, TwoObjectsOfOneMediumAreOneOfTwoParts) {
  const RoughDielectric rough{1.4F, 0.3F};
  for (const Boundary& boundary : {Boundary{rough}, Boundary{Dielectric{1.4F}}}) {
    SceneDescription both = two_boxes(boundary);
    both.object = joined(kLeft, kRight);
    SceneDescription left = with_other(two_boxes(boundary), kRight, kJade, boundary);
    SceneDescription right = with_other(two_boxes(boundary), kLeft, kJade, boundary);
    right.object = kRight;
    const bool is_rough = std::holds_alternative<RoughDielectric>(boundary);
    const Scene one(std::move(both)), first(std::move(left)), second(std::move(right));
    RenderRequest request{.material = kJade, .sample_count = 128};
    const RenderOptions plain{.tuning = {.shadow_ray_roulette = 0},
                              .switches = {.throughput_roulette = true}};
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      request.tracer = tracer;
      const FilmSums a = render_grad(one, request, plain), b = render_grad(first, request, plain);
      EXPECT_EQ(a.estimates[0].radiance, b.estimates[0].radiance);
      EXPECT_GT(film_mean(a, -1), 1);
    }
    request.tracer = Tracer::kWavefront;
    request.derivatives = is_rough ? of_medium_and_boundary() : medium_parameters();
    const FilmEstimate all = estimate_film(one, request, 48, 1);
    const FilmEstimate of_first = estimate_film(first, request, 48, 101);
    const FilmEstimate of_second = estimate_film(second, request, 48, 201);
    for (size_t p = 0; p < request.derivatives.size(); ++p) {
      const Estimated &x = of_first.derivatives[p], &y = of_second.derivatives[p];
      const Estimated minus_y{-y.mean, y.standard_error, y.degrees_of_freedom};
      const std::string what =
          std::string(is_rough ? "rough, " : "smooth, ") + name_of(request.derivatives[p]);
      expect_equal(difference(x, minus_y), all.derivatives[p], 8, what);
      // Each has a part in it.
      EXPECT_GT(std::abs(x.mean), 4 * x.standard_error) << what;
      EXPECT_GT(std::abs(y.mean), 4 * y.standard_error) << what;
    }
  }
}

// Objects of different media and indices, by the tracer that finds light in other ways.
TEST(OtherObjectsTest, TracersAgree) {
  struct Case {
    const char* name;
    Boundary of_object, of_other;
    std::vector<Parameter> derivatives;
  };
  for (const Case& row :
       {Case{"rough", RoughDielectric{1.5F, 0.3F}, RoughDielectric{1.33F, 0.15F},
             of_medium_and_boundary()},
        Case{"smooth", Dielectric{1.5F}, Dielectric{1.33F}, medium_parameters()}}) {
    const Scene scene(with_other(two_boxes(row.of_object), kRight, kMilk, row.of_other));
    RenderRequest request{.material = kJade, .sample_count = 96};
    request.derivatives = row.derivatives;
    const FilmEstimate fast = estimate_film(scene, request, 64, 1);
    request.tracer = Tracer::kReference;
    const FilmEstimate plain = estimate_film(scene, request, 64, 1001);
    // By what is seen of both objects: the derivatives are of the order of the radiance.
    expect_equal(fast.radiance, plain.radiance, 10, row.name);
    expect_resolution(difference(fast.radiance, plain.radiance), plain.radiance.mean, 0.02,
                      row.name);
    for (size_t p = 0; p < row.derivatives.size(); ++p) {
      const std::string what = std::string(row.name) + ", " + name_of(row.derivatives[p]);
      expect_equal(fast.derivatives[p], plain.derivatives[p], 10, what);
    }
  }
}

// What the other object is made of is seen: its albedo changes the image, and by as much as the
// derivative says where that object is the one that derivatives are of.
TEST(OtherObjectsTest, TheirMediaAreTheirOwn) {
  const Material kDarkMilk{60, 0.9, 0.7};
  const RoughDielectric of_left{1.5F, 0.3F}, of_right{1.33F, 0.15F};
  SceneDescription description = two_boxes(of_right);
  description.object = kRight;
  const Scene scene(with_other(std::move(description), kLeft, kJade, of_left));
  RenderRequest request{
      .material = kDarkMilk, .sample_count = 128, .derivatives = medium_parameters()};
  const FilmEstimate film = estimate_film(scene, request, 64, 1);
  // With common random numbers.
  const auto expect_slope = [&](size_t p, double Material::*parameter, double step) {
    const auto changed = [&](double by) {
      Material material = kDarkMilk;
      material.*parameter += by;
      return Scene(with_other(two_boxes(of_left), kRight, material, of_right));
    };
    const Scene above = changed(step), below = changed(-step);
    std::vector<double> slopes;
    for (uint64_t seed = 1001; seed <= 1064; ++seed) {
      const RenderRequest other{.material = kJade, .sample_count = 256, .seed = seed};
      const double off =
          film_mean(render_grad(above, other), -1) - film_mean(render_grad(below, other), -1);
      slopes.push_back(off / (2 * step));
    }
    const Estimated slope = over_batches(slopes);
    expect_equal(film.derivatives[p], slope, 2, name_of(medium_parameters()[p]));
    EXPECT_GT(std::abs(slope.mean), 10 * slope.standard_error);
  };
  expect_slope(kSigmaT, &Material::sigma_t, 20);
  expect_slope(kAlbedo, &Material::albedo, 0.01);
}

// Slabs that absorb, seen at right angles in a constant light: with the reflectance r of a face and
// the part a of light that one of them lets through, it reflects R and lets T through,
//   R = r + r (1 - r)^2 a^2 / (1 - r^2 a^2),    T = (1 - r)^2 a / (1 - r^2 a^2),
// and two of them T_1 T_2 / (1 - R_1 R_2) and R_1 + T_1^2 R_2 / (1 - R_1 R_2).
TEST(OtherObjectsTest, SlabsBehindEachOther) {
  struct Slab {
    double sigma_t, index, thickness;
    double r() const { return std::pow((index - 1) / (index + 1), 2); }
    double a() const { return std::exp(-sigma_t * thickness); }
    double shared() const { return 1 - std::pow(r() * a(), 2); }
    double reflected() const { return r() + r() * std::pow((1 - r()) * a(), 2) / shared(); }
    double passed() const { return std::pow(1 - r(), 2) * a() / shared(); }
  };
  const Slab near{0.7, 1.5, 0.5}, far{0.4, 2, 1};
  SceneDescription description;
  description.object = box({-50, 0, -50}, {50, 0.5F, 50});
  description.boundary = Dielectric{static_cast<float>(near.index)};
  description.other_objects = {{box({-50, -2, -50}, {50, -1, 50}),
                                {far.sigma_t, 0, 0},
                                Dielectric{static_cast<float>(far.index)}}};
  description.lights = {ConstantLight{1}};
  description.camera = {
      .origin = {0.03, 5, 0.02}, .target = {0.03, 4, 0.02}, .up = {0, 0, 1}, .fov = 1e-4 / 5};
  description.film = {4, 4};
  const Scene scene(std::move(description));
  const double both = 1 - near.reflected() * far.reflected();
  const double expected = near.passed() * far.passed() / both + near.reflected() +
                          std::pow(near.passed(), 2) * far.reflected() / both;
  for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
    const FilmEstimate film = estimate_film(
        scene, {.material = {near.sigma_t, 0, 0}, .sample_count = 1024, .tracer = tracer}, 32);
    expect_equal(film.radiance, {expected, 0}, 2, "two slabs");
    expect_resolution(film.radiance, expected, 0.01, "two slabs");
  }
}

// Nothing that absorbs nothing is seen in a furnace: three that touch each other and the ground, of
// different media, from outside, and from inside of one of them, where radiance is that outside
// times the square of its index.
TEST(OtherObjectsTest, VanishInAFurnace) {
  for (const bool smooth : {true, false}) {
    const auto of_index = [&](float index) {
      return smooth ? Boundary{Dielectric{index}} : Boundary{RoughDielectric{index, 0.2F}};
    };
    SceneDescription description = studio("cube", {ConstantLight{1}}, 1);
    description.object = box({-0.4F, 0, -0.2F}, {0, 0.5F, 0.2F});
    description.boundary = of_index(1.5F);
    description.other_objects = {
        {box({0, 0, -0.2F}, {0.4F, 0.5F, 0.2F}), {8, 1, 0.6}, of_index(1.3F)},
        {box({-0.2F, 0.5F, -0.2F}, {0.2F, 0.9F, 0.2F}), {3, 1, 0}, of_index(1.8F)}};
    SceneDescription within = description;
    within.camera = {.origin = {0.02, 0.7, 0.01}, .target = {-1, 0, 0.3}, .fov = 1.5};
    const RenderRequest request{.material = {5, 1, 0.3}, .sample_count = 64};
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      RenderRequest by = request;
      by.tracer = tracer;
      if (tracer == Tracer::kReference) by.sample_count *= 8;
      const std::string what = smooth ? "smooth" : "rough";
      const FilmEstimate film = estimate_film(Scene(description), by, 32);
      expect_equal(film.radiance, {1, 0}, 8, what);
      expect_resolution(film.radiance, 1, 0.01, what);
      const FilmEstimate inside = estimate_film(Scene(within), by, 32);
      expect_equal(inside.radiance, {1.8 * 1.8, 0}, 8, what + ", inside");
      expect_resolution(inside.radiance, 1.8 * 1.8, 0.01, what + ", inside");
      EXPECT_LT(static_cast<double>(film.counters.leaks + inside.counters.leaks),
                1e-5 * static_cast<double>(film.counters.paths + inside.counters.paths));
    }
  }
}

// Milk in a glass, of which every face touches one of the glass: nothing is lost.
TEST(OtherObjectsTest, OneFillsACavityOfAnother) {
  for (const bool smooth : {true, false}) {
    const auto of_index = [&](float index) {
      return smooth ? Boundary{Dielectric{index}} : Boundary{RoughDielectric{index, 0.3F}};
    };
    Mesh cavity = box({-0.3F, 0.1F, -0.3F}, {0.3F, 0.7F, 0.3F});
    for (auto& [a, b, c] : cavity.triangles) std::swap(b, c);
    SceneDescription description = studio("cube", {ConstantLight{1}});
    description.object = joined(box({-0.4F, 0, -0.4F}, {0.4F, 0.8F, 0.4F}), cavity);
    description.boundary = of_index(1.5F);
    description.other_objects = {
        {box({-0.3F, 0.1F, -0.3F}, {0.3F, 0.7F, 0.3F}), {10, 1, 0.5}, of_index(1.33F)}};
    const Scene scene(std::move(description));
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      RenderRequest request{.material = {1, 1, 0}, .sample_count = smooth ? 8U : 24U};
      request.tracer = tracer;
      if (tracer == Tracer::kReference) request.sample_count *= 2;
      const FilmEstimate film = estimate_film(scene, request, 32);
      const std::string what = smooth ? "smooth" : "rough";
      expect_equal(film.radiance, {1, 0}, 4, what);
      expect_resolution(film.radiance, 1, 0.02, what);
      EXPECT_LT(static_cast<double>(film.counters.leaks),
                1e-4 * static_cast<double>(film.counters.paths));
    }
  }
}

// An object that lets light pass as it is, index 1, is not there but for its medium: images at
// other albedos too know that theirs is of the object alone.
TEST(OtherObjectsTest, OtherAlbedosAreOfTheObject) {
  const RoughDielectric rough{1.4F, 0.3F};
  const Scene scene(with_other(two_boxes(rough), kRight, kMilk, rough));
  RenderRequest request{.material = kJade, .sample_count = 256};
  request.albedos = {0.8};
  std::vector<double> shared, own;
  for (uint64_t seed = 1; seed <= 32; ++seed) {
    request.seed = seed;
    const FilmSums sums = render_grad(scene, request);
    double sum = 0;
    for (const Sum pixel : sums.estimates[0].other_media[0]) sum += static_cast<double>(pixel);
    shared.push_back(sum * sums.quantum / static_cast<double>(request.sample_count) /
                     static_cast<double>(sums.estimates[0].counts.size()));
    RenderRequest alone{.material = {kJade.sigma_t, 0.8, kJade.g}, .sample_count = 256};
    alone.seed = 1000 + seed;
    own.push_back(film_mean(render_grad(scene, alone), -1));
  }
  expect_equal(over_batches(shared), over_batches(own), 1, "albedo .8");
  expect_resolution(difference(over_batches(shared), over_batches(own)), over_batches(own).mean,
                    0.02, "albedo .8");
}

TEST(OtherObjectsTest, WhatTheyCannotBeIsRefused) {
  const RoughDielectric rough{1.4F, 0.3F};
  const auto expect_refused = [](SceneDescription scene, const std::vector<std::string>& parts) {
    expect_error(ErrorKind::kInvalidInput, parts, [&] { const Scene refused(std::move(scene)); });
  };
  expect_refused(with_other(two_boxes(rough), kRight, kMilk, Dielectric{}),
                 {"other_objects[0] is dielectric and the object rough_dielectric"});
  expect_refused(
      with_other(two_boxes(IndexMatched{}), kRight, kMilk, IndexMatched{}),
      {"other_objects[0] is index-matched", "must be dielectric, or all rough_dielectric"});
  expect_refused(with_other(two_boxes(rough), kRight, {-1, 0.9, 0}, rough),
                 {"other_objects[0].material", "sigma_t"});
  expect_refused(with_other(two_boxes(rough), kRight, kMilk, RoughDielectric{3, 0.2F}),
                 {"other_objects[0].rough_dielectric.index", "3"});
  Mesh open = kRight;
  open.triangles.pop_back();
  expect_refused(with_other(two_boxes(rough), open, kMilk, rough), {"other_objects[0]"});
  expect_refused(
      with_other(two_boxes(rough), box({3, 0, 0}, {3.00005F, 1e-5F, 1e-5F}), kMilk, rough),
      {"other_objects[0]: its longest side is", "distance to the camera"});
  SceneDescription tiny =
      with_other(two_boxes(rough), box({1000, 0, 0}, {1001, 1, 1}), kMilk, rough);
  tiny.object = box({0, 0, 0}, {0.01F, 0.01F, 0.01F});
  expect_refused(std::move(tiny), {"object: its longest side is 0.01", "of all objects"});
  expect_refused(
      with_other(two_boxes(rough), box({-0.1F, 0.1F, -0.1F}, {0.1F, 0.2F, 0.1F}), kMilk, rough),
      {"object with other_objects", "overlap"});

  SceneDescription coloured = with_other(two_boxes(rough), kRight, kMilk, rough);
  coloured.film.channel = Channel::kRgb;
  RenderRequest request{.material = kJade};
  request.colours.assign(3, kJade);
  expect_error(ErrorKind::kInvalidInput, {"colours", "other_objects"},
               [&] { render_grad(Scene(std::move(coloured)), request); });
}

}  // namespace
}  // namespace itn::testing
