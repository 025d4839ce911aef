// Colours whose images share their paths are those of their own.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/error.h"
#include "server/tracer/scene/scene.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

// A panorama of many colours, with a part that is blue alone.
EnvironmentMapLight coloured_map() {
  EnvironmentMapLight map;
  map.width = 8;
  map.height = 4;
  for (int i = 0; i < map.width * map.height; ++i) {
    const auto at = static_cast<float>(i);
    map.rgb.push_back(i % 5 == 0 ? 0 : 1 + std::sin(at));
    map.rgb.push_back(i % 5 == 0 ? 0 : 1 + std::cos(2 * at));
    map.rgb.push_back(i % 5 == 0 ? 6 : 0.2F);
  }
  return map;
}

// What lies under the object.
ImageReflectance coloured_tiles() {
  return {.width = 2,
          .height = 1,
          .values = std::make_shared<const std::vector<float>>(
              std::vector<float>{0.9F, 0.3F, 0, 0.1F, 0.6F, 0.9F}),
          .corner = {},
          .edge_u = {0.4, 0, 0},
          .edge_v = {0, 0, 0.4}};
}

struct Subject {
  std::string name;
  SceneDescription scene;
  std::vector<Material> colours;
  std::vector<Parameter> derivatives = medium_parameters();
};

RenderRequest request_for(const std::vector<Material>& colours) {
  RenderRequest request{.material = colours[0]};
  for (const Material& colour : colours) {
    request.material.sigma_t = std::min(request.material.sigma_t, colour.sigma_t);
    request.material.albedo = std::max(request.material.albedo, colour.albedo);
  }
  request.colours = colours;
  return request;
}

Scene in(SceneDescription scene, Channel channel) {
  scene.film.channel = channel;
  return Scene(std::move(scene));
}

// Each of film_mean.
std::vector<FilmEstimate> estimate_colours(const Scene& scene, RenderRequest request, int batches,
                                           uint64_t seed) {
  const size_t derivatives = request.derivatives.size();
  std::vector<FilmEstimate> results;
  std::vector<std::vector<double>> means_of(kColours.size() * (1 + derivatives));
  for (int b = 0; b < batches; ++b) {
    request.seed = seed + static_cast<uint64_t>(b);
    const FilmSums sums = render_grad(scene, request);
    for (size_t c = 0; c < kColours.size(); ++c) {
      FilmSums one = sums;
      one.estimates[0].radiance = sums.estimates[0].other_media[c];
      means_of[c].push_back(film_mean(one, -1));
      for (size_t d = 0; d < derivatives; ++d) {
        const size_t layer = d * kColours.size() + c;
        means_of[(1 + d) * kColours.size() + c].push_back(film_mean(sums, static_cast<int>(layer)));
      }
    }
  }
  for (size_t c = 0; c < kColours.size(); ++c) {
    FilmEstimate& of = results.emplace_back();
    of.radiance = over_batches(means_of[c]);
    for (size_t d = 1; d <= derivatives; ++d) {
      of.derivatives.push_back(over_batches(means_of[d * kColours.size() + c]));
    }
  }
  return results;
}

void expect_colours_of_their_own(const Subject& subject, uint32_t spp, uint32_t own_spp) {
  const int comparisons = static_cast<int>(3 * (1 + subject.derivatives.size()));
  RenderRequest together = request_for(subject.colours);
  together.sample_count = spp;
  together.derivatives = subject.derivatives;
  const std::vector<FilmEstimate> shared =
      estimate_colours(in(subject.scene, Channel::kRgb), together, 64, 1);
  for (size_t c = 0; c < kColours.size(); ++c) {
    RenderRequest own{.material = subject.colours[c], .sample_count = own_spp};
    own.derivatives = subject.derivatives;
    const FilmEstimate alone = estimate_film(in(subject.scene, kColours[c]), own, 64, 1001);
    std::vector<double> scales;  // of the albedo's its own
    for (const Parameter& parameter : subject.derivatives) {
      const double unit = parameter.kind == Parameter::kSigmaT     ? subject.colours[c].sigma_t
                          : parameter.kind == Parameter::kAlbedo   ? HUGE_VAL
                          : parameter.kind == Parameter::kBoundary ? 0.4
                                                                   : 1;
      scales.push_back(alone.radiance.mean / unit);
    }
    expect_same_film(shared[c], alone, comparisons, subject.name + ", colour " + std::to_string(c),
                     scales);
  }
}

TEST(ColoursTest, IndexMatched) {
  SceneDescription scene = studio(
      "smooth_star", {coloured_map(), paper_sun_sky(), PointLight{{1.5, 2, -1}, 1e-5}}, 0.5F);
  scene.surfaces[0].reflectance = coloured_tiles();
  expect_colours_of_their_own(
      {"star", std::move(scene), {{24, 0.6, 0.4}, {12, 0.8, 0.4}, {18, 0.9, 0.4}}}, 320, 320);
}

// Lamps, deltas and a sky of other colours, and a coloured ground.
TEST(ColoursTest, OfLightsAndSurfaces) {
  SceneDescription scene =
      studio("smooth_star", {ConstantLight{0.2}, SphereLight{{1, 2.5, -1.5}, 0.3, 20},
                             PointLight{{-1.5, 2, -1}, 4e-6}, ConstantLight{0.1}});
  scene.light_colours = {{1, 2, 4}, {3, 2, 1}, {0, 1, 0.2}};
  scene.surfaces = {{horizontal_square(0, 20), ColorReflectance{0.9F, 0.4F, 0.1F}}};
  expect_colours_of_their_own(
      {"coloured", std::move(scene), {{24, 0.6, 0.4}, {12, 0.7, 0.4}, {18, 0.7, 0.4}}}, 320, 320);
}

TEST(ColoursTest, BehindARoughBoundary) {
  SceneDescription scene =
      studio("knot", {paper_sun_sky(), SphereLight{{1, 2.5, -1.5}, 0.4, 60}}, 0.5F);
  scene.boundary = RoughDielectric{1.4F, 0.4F};
  std::vector<Parameter> derivatives = medium_parameters();
  derivatives.push_back(parameter_named("rough_dielectric.roughness"));
  expect_colours_of_their_own(
      {"rough", std::move(scene), {{10, 0.8, 0.2}, {10, 0.5, 0.2}, {16, 0.7, 0.2}}, derivatives},
      256, 256);
}

// Paths that follow an edge bring the derivative in the index.
TEST(ColoursTest, InTheIndexOfARoughBoundary) {
  SceneDescription scene = studio("sphere", {coloured_map()}, 0.5F);
  scene.boundary = RoughDielectric{1.5F, 0.9F};
  expect_colours_of_their_own({"index",
                               std::move(scene),
                               {{10, 0.5, 0.2}, {12, 0.3, 0.2}, {15, 0.6, 0.2}},
                               {parameter_named("rough_dielectric.index")}},
                              1024, 1024);
}

TEST(ColoursTest, BehindASmoothBoundary) {
  SceneDescription scene = studio("sphere", {coloured_map(), ConstantLight{0.3}}, 0.5F);
  scene.boundary = Dielectric{1.5F};
  expect_colours_of_their_own({"smooth",
                               std::move(scene),
                               {{10, 0.8, 0}, {10, 0.7, 0}, {12, 0.8, 0}},
                               {parameter_named("sigma_t"), parameter_named("albedo")}},
                              160, 160);
}

// If all media are the same, so are their images, whichever medium the paths fly by.
TEST(ColoursTest, AlikeAreOne) {
  const Material material{9, 0.8, 0.3};
  RenderRequest request = request_for({material, material, material});
  request.derivatives = medium_parameters();
  const Scene scene = in(studio("cube", {ConstantLight{1}}, 0.5F), Channel::kRgb);
  const RenderedImages images = means(render_grad(scene, request));
  const auto& estimate = images.estimates[0];
  for (size_t c = 0; c < kColours.size(); ++c) {
    EXPECT_EQ(estimate.other_media[c], estimate.other_media[0]);
    for (size_t d = 0; d < request.derivatives.size(); ++d) {
      EXPECT_EQ(estimate.derivatives[3 * d + c], estimate.derivatives[3 * d]);
    }
    for (size_t p = 0; p < estimate.radiance.size(); ++p) {
      EXPECT_NEAR(estimate.other_media[c][p], estimate.radiance[p], 1e-4) << p;
      EXPECT_NEAR(images.colour_standard_errors[c][p], images.standard_error[p], 1e-4) << p;
    }
  }
}

TEST(ColoursTest, RefusesWhatTheyHaveNot) {
  const std::vector<Material> colours = {{9, 0.8, 0.3}, {12, 0.7, 0.3}, {10, 0.9, 0.3}};
  SceneDescription description = studio("cube", {ConstantLight{1}}, 0.5F);
  description.boundary = RoughDielectric{};
  const Scene scene = in(description, Channel::kRgb);
  const auto message_of = [&](const auto& change, const Scene& of) -> std::string {
    RenderRequest request = request_for(colours);
    change(request);
    try {
      validate(request, of);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(message_of([](RenderRequest&) {}, scene), "");
  EXPECT_EQ(message_of([](RenderRequest& r) { r.colours.clear(); }, scene),
            "colours and a film whose channel is RGB need one another");
  EXPECT_EQ(message_of([](RenderRequest&) {}, in(description, Channel::kRed)),
            "colours and a film whose channel is RGB need one another");
  EXPECT_EQ(message_of([](RenderRequest& r) { r.colours.pop_back(); }, scene),
            "the number of colours is 2; it must be 0 or 3");
  EXPECT_EQ(message_of([](RenderRequest& r) { r.colours[1].g = 0.2; }, scene),
            "colours[1] is sigma_t 12, albedo 0.7, g 0.2; that must be at least, at most and "
            "exactly that of the material, 9, 0.9, 0.3");
  EXPECT_EQ(message_of([](RenderRequest& r) { r.pilot_spp = 2; }, scene),
            "colours have no albedos, no gradient and no pilot");
  EXPECT_EQ(message_of([](RenderRequest& r) { r.tracer = Tracer::kReference; }, scene),
            "the reference tracer knows neither albedos, colours nor pilot_spp");
  for (const char* name : {"light[0].scale", "surface[0].reflectance"}) {
    EXPECT_EQ(message_of([&](RenderRequest& r) { r.derivatives = {parameter_named(name)}; }, scene),
              "no derivative in " + std::string(name) +
                  " of colours that share their paths: there are those in the medium and its "
                  "boundary; others need a render of each colour");
  }
}

}  // namespace
}  // namespace itn::testing
