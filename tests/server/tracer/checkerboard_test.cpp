// A surface whose reflectance depends on the place.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "common/error.h"
#include "server/tracer/parameters/parameter.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

const Parameter kEven = parameter_named("surface[0].checkerboard.even");
const Parameter kOdd = parameter_named("surface[0].checkerboard.odd");
const Parameter kUniform = parameter_named("surface[0].reflectance");

constexpr double kIrradiance = 3, kCosine = 0.8;

// A floor, seen from above at (x, z), with an object in a pose far below.
Scene seen_floor(const Reflectance& reflectance, double x, double z,
                 Channel channel = Channel::kLuminance) {
  SceneDescription scene;
  scene.object = box({-0.5F, -3, -0.5F}, {0.5F, -2, 0.5F});
  scene.pose = {.rotation = {Vec3d{0, 0, 1}, Vec3d{0.6, 0.8, 0}, Vec3d{-0.8, 0.6, 0}},
                .translation = {3, -9, 2}};
  scene.surfaces = {{horizontal_square(0, 20), reflectance}};
  scene.lights = {DirectionalLight{{0.6, kCosine, 0}, kIrradiance}};
  scene.camera = {.origin = {x, 4, z}, .target = {x, 3, z}, .up = {0, 0, 1}, .fov = 2.5e-5};
  scene.film = {2, 2, channel};
  return Scene(std::move(scene));
}

Scene seen_board(double x, double z) {
  return seen_floor(Checkerboard{.even = 0.7F,
                                 .odd = 0.1F,
                                 .corner = {0.5, 3, -0.25},
                                 .edge_u = {2, 0, 0},
                                 .edge_v = {1, 0, 1}},
                    x, z);
}

// L = rho E cos(theta) / pi, with the reflectance of the square; dL/drho is the same without rho,
// for the square's own slot, and 0 for the other.
TEST(CheckerboardTest, SquaresTakeTurns) {
  constexpr double kSlope = kIrradiance * kCosine / std::numbers::pi;
  struct Row {
    double u, v;  // in edges from the corner
    bool even;
  };
  for (const Row row : {Row{0.5, 0.5, true}, Row{1.5, 0.5, false}, Row{1.1, 1.9, true},
                        Row{-0.1, 0.1, false}, Row{-0.1, -0.1, true}, Row{-3.2, 2.7, true}}) {
    const Scene scene = seen_board(0.5 + 2 * row.u + row.v, -0.25 + row.v);
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      RenderRequest request{.material = {30, 0.8, 0}, .sample_count = 4};
      request.derivatives = {kEven, kOdd};
      request.tracer = tracer;
      const FilmSums sums = render_grad(scene, request, {.tuning = {.shadow_ray_roulette = 0}});
      EXPECT_NEAR(film_mean(sums, -1), (row.even ? 0.7 : 0.1) * kSlope, 1e-5) << row.u;
      EXPECT_NEAR(film_mean(sums, 0), row.even ? kSlope : 0, 1e-5);
      EXPECT_NEAR(film_mean(sums, 1), row.even ? 0 : kSlope, 1e-5);
    }
  }
}

Scene mug_on(const Reflectance& reflectance) {
  SceneDescription scene = studio("mug", {paper_sun_sky()}, 0.5F);
  scene.surfaces[0].reflectance = reflectance;
  return Scene(std::move(scene));
}

Checkerboard small_board(float even, float odd) {
  return {.even = even, .odd = odd, .corner = {}, .edge_u = {0.4, 0, 0}, .edge_v = {0, 0, 0.4}};
}

// Two reflectances that are one: the same image, to the bit, and the derivatives in both of them
// add up to that in the one.
TEST(CheckerboardTest, OfOneReflectanceIsUniform) {
  RenderRequest request{.material = {30, 0.8, 0.3}, .sample_count = 16};
  const Scene uniform = mug_on(UniformReflectance{0.4F}), board = mug_on(small_board(0.4F, 0.4F));
  for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
    request.tracer = tracer;
    request.derivatives = {};
    EXPECT_EQ(render_grad(uniform, request).estimates[0].radiance,
              render_grad(board, request).estimates[0].radiance);
    // No roulette: it goes by the derivatives that are asked for.
    const RenderOptions all{.tuning = {.shadow_ray_roulette = 0, .walk_roulette = 0}};
    request.derivatives = {kUniform};
    const RenderedImages one = means(render_grad(uniform, request, all));
    request.derivatives = {kEven, kOdd};
    const RenderedImages two = means(render_grad(board, request, all));
    double even = 0, odd = 0;
    for (size_t p = 0; p < one.estimates[0].radiance.size(); ++p) {
      const auto& parts = two.estimates[0].derivatives;
      if (tracer == Tracer::kWavefront) {  // the reference has a roulette of its own
        EXPECT_NEAR(parts[0][p] + parts[1][p], one.estimates[0].derivatives[0][p], 1e-4) << p;
      }
      even += parts[0][p];
      odd += parts[1][p];
    }
    EXPECT_GT(even, 0);
    EXPECT_GT(odd, 0);
  }
}

TEST(CheckerboardTest, AgreesWithTheReference) {
  const Scene scene = mug_on(small_board(0.8F, 0.1F));
  const auto film_by = [&](Tracer tracer, uint64_t seed) {
    RenderRequest request{.material = {12, 0.7, 0.4}, .sample_count = 96};
    request.derivatives = {kEven, kOdd};
    request.tracer = tracer;
    return estimate_film(scene, request, 64, seed);
  };
  expect_same_film(film_by(Tracer::kWavefront, 1), film_by(Tracer::kReference, 301), 3, "board");
}

// Three pixels by two, whose values are exact in their middles and linear between those, also
// across the seam to the next image.
ImageReflectance small_image() {
  return {.width = 3,
          .height = 2,
          .values = std::make_shared<const std::vector<float>>(
              std::vector<float>{0.1F, 0.9F, 0, 0.2F, 0.9F, 0, 0.3F, 0.9F, 0, 0.4F, 0.9F, 0, 0.6F,
                                 0.9F, 0, 0.8F, 0.9F, 0.5F}),
          .scale = 0.5F,
          .corner = {0.5, 3, -0.25},
          .edge_u = {3, 0, 0},
          .edge_v = {1, 0, 2}};
}

TEST(ImageReflectanceTest, InterpolatesPixels) {
  constexpr double kSlope = kIrradiance * kCosine / std::numbers::pi;
  const Parameter scale = parameter_named("surface[0].image.scale");
  struct Row {
    double x, y;  // in pixels from the upper left corner of an image
    Channel channel;
    double value;
  };
  for (const Row row : {Row{0.5, 0.5, Channel::kRed, 0.1}, Row{2.5, 1.5, Channel::kRed, 0.8},
                        Row{1.0, 0.5, Channel::kRed, 0.15}, Row{1.5, 1.25, Channel::kRed, 0.5},
                        Row{3.0, 0.5, Channel::kRed, 0.2}, Row{-3.5, 4.5, Channel::kRed, 0.3},
                        Row{1.5, 2.0, Channel::kRed, 0.4}, Row{1.2, 0.9, Channel::kGreen, 0.9},
                        Row{2.5, 1.5, Channel::kBlue, 0.5},
                        Row{0.5, 0.5, Channel::kLuminance, 0.2126 * 0.1 + 0.7152 * 0.9}}) {
    const double u = row.x / 3, v = 1 - row.y / 2;
    const Scene scene = seen_floor(small_image(), 0.5 + 3 * u + v, -0.25 + 2 * v, row.channel);
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      RenderRequest request{.material = {30, 0.8, 0}, .sample_count = 4};
      request.derivatives = {scale};
      request.tracer = tracer;
      const FilmSums sums = render_grad(scene, request, {.tuning = {.shadow_ray_roulette = 0}});
      EXPECT_NEAR(film_mean(sums, -1), 0.5 * row.value * kSlope, 1e-4) << row.x << " " << row.y;
      EXPECT_NEAR(film_mean(sums, 0), row.value * kSlope, 1e-4);
    }
  }
}

TEST(ImageReflectanceTest, AgreesWithTheReference) {
  ImageReflectance image = small_image();
  image.edge_u = {0.4, 0, 0};
  image.edge_v = {0, 0, 0.4};
  const Scene scene = mug_on(image);
  const auto film_by = [&](Tracer tracer, uint64_t seed) {
    RenderRequest request{.material = {12, 0.7, 0.4}, .sample_count = 32};
    request.derivatives = {parameter_named("surface[0].image.scale")};
    request.tracer = tracer;
    return estimate_film(scene, request, 64, seed);
  };
  expect_same_film(film_by(Tracer::kWavefront, 1), film_by(Tracer::kReference, 301), 2, "image");
}

TEST(CheckerboardTest, RefusesWhatItIsNot) {
  const auto message_of = [](const auto& action) -> std::string {
    try {
      action();
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  RenderRequest request{.material = {30, 0.8, 0.3}};
  request.derivatives = {kUniform};
  EXPECT_EQ(message_of([&] { render_grad(mug_on(small_board(1, 0)), request); }),
            "no derivative in surface[0].reflectance: there is surface[0].checkerboard.even, "
            "surface[0].checkerboard.odd");
  request.derivatives = {kOdd};
  EXPECT_EQ(message_of([&] { render_grad(mug_on(UniformReflectance{1}), request); }),
            "no derivative in surface[0].checkerboard.odd: there is surface[0].reflectance");
  EXPECT_EQ(message_of([&] { mug_on(small_board(0, 1.5F)); }),
            "surfaces[0]: checkerboard.odd is 1.5; it must be in [0, 1]");
  Checkerboard flat = small_board(1, 0);
  flat.edge_v = flat.edge_u * -2;
  EXPECT_EQ(message_of([&] { mug_on(flat); }),
            "checkerboard.edge_u and edge_v are parallel; they must not be");
}

// What a film shows of a colour, and of that of the light.
TEST(ColorReflectanceTest, AFilmShowsItsPart) {
  constexpr double kSlope = kIrradiance * kCosine / std::numbers::pi;
  const Rgb surface{0.9, 0.4, 0.1}, light{1, 3, 2};
  for (const Channel channel : {Channel::kLuminance, Channel::kRed, Channel::kBlue}) {
    SceneDescription description;
    description.object = box({-0.5F, -3, -0.5F}, {0.5F, -2, 0.5F});
    description.surfaces = {{horizontal_square(0, 20), ColorReflectance{0.9F, 0.4F, 0.1F}}};
    description.lights = {DirectionalLight{{0.6, kCosine, 0}, kIrradiance}};
    description.light_colours = {light};
    description.camera = {.origin = {2, 4, 1}, .target = {2, 3, 1}, .up = {0, 0, 1}, .fov = 2.5e-5};
    description.film = {2, 2, channel};
    const Scene scene(std::move(description));
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      RenderRequest request{.material = {30, 0.8, 0}, .sample_count = 4};
      request.derivatives = {parameter_named("surface[0].color.red"),
                             parameter_named("surface[0].color.blue")};
      request.tracer = tracer;
      const FilmSums sums = render_grad(scene, request, {.tuning = {.shadow_ray_roulette = 0}});
      const double of_light = select(light, channel) / luminance(light) * kSlope;
      EXPECT_NEAR(film_mean(sums, -1), select(surface, channel) * of_light, 1e-5);
      EXPECT_NEAR(film_mean(sums, 0), select({1, 0, 0}, channel) * of_light, 1e-5);
      EXPECT_NEAR(film_mean(sums, 1), select({0, 0, 1}, channel) * of_light, 1e-5);
    }
  }
}

TEST(ColorReflectanceTest, ASkyHasItsOwnColours) {
  SceneDescription description = studio("cube", {ConstantLight{1}, paper_sun_sky()});
  description.light_colours = {{1, 1, 1}, {1, 0.5, 0.5}};
  try {
    const Scene scene(std::move(description));
    FAIL();
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "lights[1].color: sun_sky has colours of its own");
  }
}

}  // namespace
}  // namespace itn::testing
