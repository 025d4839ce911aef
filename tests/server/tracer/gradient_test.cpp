// The gradient of a weighted sum over the pixels, in numbers and in the pixels of a panorama.
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <string>

#include "common/error.h"
#include "server/tracer/geometry/corner_normals.h"
#include "server/tracer/parameters/parameter.h"
#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

constexpr int kWidth = 16, kHeight = 8;

// A panorama with a bright block, a dim one, and one that is dark.
EnvironmentMapLight panorama() {
  EnvironmentMapLight map{.width = kWidth, .height = kHeight, .rgb = {}};
  for (int row = 0; row < kHeight; ++row) {
    for (int column = 0; column < kWidth; ++column) {
      const float v = column < 5 ? 0.0F : column < 8 ? 4.0F : 0.5F + 0.1F * static_cast<float>(row);
      map.rgb.insert(map.rgb.end(), {v, 2 * v, v / 2});
    }
  }
  map.scale = 0.7;
  map.rotate_y = 0.4;
  return map;
}

std::vector<Parameter> parameters() {
  std::vector<Parameter> result = medium_parameters();
  for (const char* name : {"surface[0].reflectance", "light[0].scale", "light[1].scale"}) {
    result.push_back(parameter_named(name));
  }
  return result;
}
constexpr size_t kMapScale = 4;  // among them

SceneDescription lit_by(const EnvironmentMapLight& map) {
  SceneDescription scene = studio("mug", {map, ConstantLight{0.2}}, 0.5F);
  scene.film.channel = Channel::kGreen;
  return scene;
}

// Weights of both signs, and 0.
std::vector<float> weights_of(const Scene& scene) {
  std::vector<float> weights(static_cast<size_t>(scene.width()) * scene.height());
  for (size_t p = 0; p < weights.size(); ++p) {
    weights[p] = static_cast<float>(p * 7 % 11) / 4 - 0.75F;
  }
  return weights;
}

// The same paths as the images have, so the same to the rounding of their sums.
TEST(GradientTest, IsTheWeightedSumOfTheDerivativeImages) {
  for (const bool rough : {false, true}) {
    SceneDescription description = lit_by(panorama());
    if (rough) description.boundary = RoughDielectric{};
    const Scene scene(std::move(description));
    const std::vector<float> weights = weights_of(scene);
    for (const Tracer tracer : {Tracer::kWavefront, Tracer::kReference}) {
      RenderRequest request{.material = {30, 0.8, 0.3}, .sample_count = 33, .estimates = 2};
      request.derivatives = parameters();
      if (rough) request.derivatives.push_back(parameter_named("rough_dielectric.roughness"));
      request.tracer = tracer;
      request.pilot_spp = tracer == Tracer::kWavefront ? 2 : 0;
      const RenderedImages images = means(render_grad(scene, request));
      request.gradient_weights = weights;
      const RenderedImages gradients = means(render_grad(scene, request));
      for (size_t k = 0; k < images.estimates.size(); ++k) {
        EXPECT_EQ(gradients.estimates[k].radiance, images.estimates[k].radiance);
        EXPECT_TRUE(gradients.estimates[k].derivatives.empty());
        ASSERT_EQ(gradients.estimates[k].gradient.size(), request.derivatives.size());
        for (size_t i = 0; i < request.derivatives.size(); ++i) {
          double sum = 0, size = 0;
          for (size_t p = 0; p < weights.size(); ++p) {
            const double part = double{weights[p]} * double{images.estimates[k].derivatives[i][p]};
            sum += part;
            size += std::abs(part);
          }
          EXPECT_NEAR(gradients.estimates[k].gradient[i], sum, 1e-5 * size)
              << name_of(request.derivatives[i]);
        }
      }
    }
  }
}

// Ways to turn normals: whereto, at a place.
Vec3d lean(Vec3d /*place*/) {
  return {0.8, 0, 0.6};
}
Vec3d ripple(Vec3d p) {
  return {std::sin(4 * p.y), std::cos(5 * p.x), std::sin(4 * p.z + 1)};
}

SceneDescription rough_scene(const std::string& name) {
  const std::vector<LightDescription> lights{ConstantLight{0.3},
                                             SphereLight{{1.5, 2, -1.5}, 0.4, 20}};
  const bool flat = name == "flat";
  SceneDescription scene = studio(flat ? "cube" : "smooth_star", lights, flat ? 0.5F : -1.0F);
  scene.boundary = RoughDielectric{1.4F, 0.4F, name == "single"};
  scene.smooth_angle = flat ? 0 : 1;
  return scene;
}

class NormalGradient : public ::testing::TestWithParam<const char*> {
 protected:
  // Its normals lean towards `turn` by so much.
  SceneDescription turned(Vec3d (*turn)(Vec3d), double by) const {
    SceneDescription scene = straight_;
    const Mesh& mesh = scene.object;
    scene.corner_normals = CornerNormals(mesh, {{0, scene.smooth_angle}}).by_triangle();
    for (size_t t = 0; t < mesh.triangles.size(); ++t) {
      for (size_t k = 0; k < 3; ++k) {
        Vec3f& n = scene.corner_normals[t][k];
        const auto place = static_cast<Vec3d>(mesh.vertices[mesh.triangles[t][k]]);
        n = static_cast<Vec3f>(normalize(static_cast<Vec3d>(n) + turn(place) * by));
      }
    }
    return scene;
  }
  // The derivative along such a turn, by the gradient of a render.
  double along(Vec3d (*turn)(Vec3d), const std::vector<float>& gradient) const {
    const Mesh& mesh = straight_.object;
    double sum = 0;
    for (size_t c = 0; c < 3 * mesh.triangles.size(); ++c) {
      const auto place = static_cast<Vec3d>(mesh.vertices[mesh.triangles[c / 3][c % 3]]);
      sum += dot(Vec3d{gradient[3 * c], gradient[3 * c + 1], gradient[3 * c + 2]}, turn(place));
    }
    return sum;
  }

  const SceneDescription straight_ = rough_scene(GetParam());
};

// By central differences, with other random numbers. The pixels are weighed by how much they change
// in a first render, so that the derivative is large.
TEST_P(NormalGradient, EqualsFiniteDifferences) {
  constexpr float kStep = 0.05F;
  for (const auto turn : {lean, ripple}) {
    const Scene middle(turned(turn, 0)), above(turned(turn, double{kStep})),
        below(turned(turn, double{-kStep}));
    RenderRequest request{.material = {4, 0.6, 0.3}, .sample_count = 1536};
    const auto difference = [&](uint64_t seed) {
      request.seed = seed;
      request.gradient_normals = false;
      std::vector<float> image = means(render_grad(above, request)).estimates[0].radiance;
      const std::vector<float> other = means(render_grad(below, request)).estimates[0].radiance;
      for (size_t p = 0; p < image.size(); ++p) image[p] = (image[p] - other[p]) / (2 * kStep);
      return image;
    };
    request.gradient_weights = difference(1);
    std::vector<double> gradients, differences;
    for (uint64_t seed = 2; seed < 18; ++seed) {
      const std::vector<float> image = difference(seed);
      differences.push_back(
          std::inner_product(image.begin(), image.end(), request.gradient_weights.begin(), 0.0));
      request.seed = 1000 + seed;
      request.gradient_normals = true;
      gradients.push_back(
          along(turn, means(render_grad(middle, request)).estimates[0].normal_gradient));
    }
    expect_equal(over_batches(gradients), over_batches(differences), 6, GetParam());
  }
}

// The normals that the smooth angle makes are given instead of it.
TEST(GradientTest, GivenNormalsAreTakenAsTheyAre) {
  SceneDescription by_angle = rough_scene("smooth"), given = by_angle;
  given.corner_normals = CornerNormals(given.object, {{0, given.smooth_angle}}).by_triangle();
  given.smooth_angle = 0;
  const RenderRequest request{.material = {4, 0.6, 0.3}, .sample_count = 8};
  const auto image = [&](const SceneDescription& description) {
    return means(render_grad(Scene(description), request)).estimates[0].radiance;
  };
  const std::vector<float> expected = image(by_angle);
  EXPECT_EQ(image(given), expected);
  given.corner_normals = CornerNormals(given.object, {{0, 0.0}}).by_triangle();  // flat
  EXPECT_NE(image(given), expected);
}

INSTANTIATE_TEST_SUITE_P(Cases, NormalGradient, ::testing::Values("flat", "smooth", "single"),
                         [](const auto& of) { return std::string(of.param); });

TEST(GradientTest, ThreadsDoNotMatter) {
  const Scene scene(lit_by(panorama()));
  RenderRequest request{.material = {30, 0.8, 0.3}, .sample_count = 32};
  request.derivatives = parameters();
  request.gradient_weights = weights_of(scene);
  request.gradient_light = 0;
  const RenderedImages one = means(render_grad(scene, request, {.threads = 1}));
  const RenderedImages three = means(render_grad(scene, request, {.threads = 3}));
  EXPECT_EQ(one.estimates[0].gradient, three.estimates[0].gradient);
  EXPECT_EQ(one.estimates[0].map_gradient, three.estimates[0].map_gradient);
}

// Radiance is linear in the pixels: what each of them sends adds up to what the panorama does.
TEST(GradientTest, PixelsAddUpToTheLight) {
  const EnvironmentMapLight map = panorama();
  for (const Boundary& boundary :
       {Boundary(IndexMatched()), Boundary(Dielectric()), Boundary(RoughDielectric())}) {
    SceneDescription description = lit_by(map);
    description.boundary = boundary;
    const Scene scene(std::move(description));
    RenderRequest request{.material = {30, 0.8, 0.3}, .sample_count = 64};
    request.derivatives = parameters();
    request.gradient_weights = weights_of(scene);
    request.gradient_light = 0;
    const RenderedImages images = means(render_grad(scene, request));
    const auto& [radiance, derivatives, other_media, gradient, by_pixel, by_normal] =
        images.estimates[0];
    ASSERT_EQ(by_pixel.size(), size_t{kWidth * kHeight});
    double sum = 0;
    for (size_t i = 0; i < by_pixel.size(); ++i) {
      sum += double{by_pixel[i]} * double{map.rgb[3 * i + 1]};
    }
    EXPECT_NEAR(sum, gradient[kMapScale], 1e-4 * std::abs(gradient[kMapScale]));
  }
}

// What a part of the panorama sends, by its pixels' gradient in a scene where it is dark or bright,
// and by an image of it alone.
TEST(GradientTest, InPixelsIsTheImageOfThem) {
  const Scene scene(lit_by(panorama()));
  RenderRequest request{.material = {12, 0.8, 0.3}, .sample_count = 256};
  request.gradient_weights.assign(static_cast<size_t>(scene.width()) * scene.height(), 1);
  const double pixels = static_cast<double>(request.gradient_weights.size());
  constexpr int kBatches = 32;
  struct Block {
    const char* name;
    int first, end;  // columns
  };
  constexpr Block kBlocks[] = {{"dark", 1, 4}, {"bright", 5, 8}, {"dim", 10, 14}};
  std::vector<std::vector<double>> by_gradient(std::size(kBlocks));
  RenderRequest with_pixels = request;
  with_pixels.gradient_light = 0;
  for (uint64_t batch = 0; batch < kBatches; ++batch) {
    with_pixels.seed = batch;
    const RenderedImages images = means(render_grad(scene, with_pixels));
    const std::vector<float>& by_pixel = images.estimates[0].map_gradient;
    for (size_t b = 0; b < std::size(kBlocks); ++b) {
      double sum = 0;
      for (int row = 0; row < kHeight; ++row) {
        for (int column = kBlocks[b].first; column < kBlocks[b].end; ++column) {
          sum += double{by_pixel[static_cast<size_t>(row) * kWidth + column]};
        }
      }
      by_gradient[b].push_back(sum / pixels);
    }
  }
  for (size_t b = 0; b < std::size(kBlocks); ++b) {
    EnvironmentMapLight alone = panorama();
    for (int i = 0; i < kWidth * kHeight; ++i) {
      const bool in_block = i % kWidth >= kBlocks[b].first && i % kWidth < kBlocks[b].end;
      for (int c = 0; c < 3; ++c) alone.rgb[3 * i + c] = in_block ? 1.0F : 0.0F;
    }
    SceneDescription description = lit_by(alone);
    description.lights = {alone};
    RenderRequest image = request;
    image.gradient_weights.clear();
    const Estimated expected =
        estimate_film(Scene(std::move(description)), image, kBatches, 1000).radiance;
    const Estimated found = over_batches(by_gradient[b]);
    expect_equal(found, expected, static_cast<int>(std::size(kBlocks)), kBlocks[b].name);
    expect_resolution(difference(found, expected), expected.mean, 0.02, kBlocks[b].name);
  }
}

TEST(GradientTest, RefusesWhatItCannotAnswer) {
  const Scene scene(lit_by(panorama()));
  const auto message_of = [&](const auto& change) -> std::string {
    RenderRequest request{.material = {30, 0.8, 0.3}, .sample_count = 1};
    request.gradient_weights = weights_of(scene);
    request.gradient_light = 0;
    change(request);
    try {
      render_grad(scene, request);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(message_of([](auto&) {}), "");
  EXPECT_EQ(message_of([](auto& r) { r.gradient_light = 1; }),
            "lights[1] is no panorama that shines");
  EXPECT_EQ(message_of([](auto& r) { r.gradient_weights.pop_back(); }),
            "there are 63 gradient weights; there must be one for each of the 64 pixels");
  EXPECT_EQ(message_of([](auto& r) { r.gradient_weights.assign(64, 0); }),
            "all gradient weights are 0");
  EXPECT_EQ(message_of([](auto& r) { r.gradient_weights[3] = NAN; }),
            "the gradient weight of pixel 3 is nan; it must be at most 1e+15 in size");
  EXPECT_NE(message_of([](auto& r) { r.gradient_weights[3] = -2e15F; }), "");
  EXPECT_EQ(message_of([](auto& r) { r.gradient_weights.clear(); }),
            "a gradient in a light's pixels needs gradient weights");
  EXPECT_EQ(message_of([](auto& r) { r.tracer = Tracer::kReference; }),
            "the reference tracer knows no gradient in a light's pixels");
}

}  // namespace
}  // namespace itn::testing
