// Truths in closed form: Beer-Lambert, single scattering, van de Hulst's slab, Chandrasekhar's
// half-space.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;

// A pinhole that looks along -y at (x, z) = (0.03, 0.02), its whole film within 1e-4 of that.
CameraDescription looking_down(double from_y) {
  return {.origin = {0.03, from_y, 0.02},
          .target = {0.03, from_y - 1, 0.02},
          .up = {0, 0, 1},
          .fov = 1e-4 / from_y};
}

// Without scattering, light is dimmed along the chord d: T = exp(-sigma_t d), and its derivative in
// sigma_t is -d T. The derivative in the albedo is not 0: it is the light scattered once.
TEST(BeerLambertTest, LightIsDimmedAlongTheChord) {
  SceneDescription description;
  description.object = box({-0.5F, 0, -0.5F}, {0.5F, 0.7F, 0.5F});
  description.lights = {ConstantLight{1}};
  description.camera = looking_down(5);
  description.film = {4, 4};
  const Scene scene(std::move(description));
  for (const double sigma_t : {0.5, 2.0, 4.0}) {
    const FilmEstimate film = estimate_film(
        scene,
        {.material = {sigma_t, 0, 0.3}, .sample_count = 4096, .derivatives = medium_parameters()},
        64);
    const double expected = std::exp(-sigma_t * 0.7);
    expect_equal(film.radiance, {expected, 0}, 6, "transmittance");
    expect_resolution(film.radiance, expected, 0.01, "transmittance");
    expect_equal(film.derivatives[kSigmaT], {-0.7 * expected, 0}, 6, "d transmittance / d sigma_t");
    EXPECT_GT(film.derivatives[kAlbedo].mean, 0.05);
  }
}

// The limit where hardly anything happens: T = 1 - sigma_t d + ..., and the derivative is the
// chord, -d.
TEST(BeerLambertTest, DerivativeOfAThinMedium) {
  SceneDescription description;
  description.object = box({-0.5F, 0, -0.5F}, {0.5F, 0.01F, 0.5F});
  description.lights = {ConstantLight{1}};
  description.camera = looking_down(5);
  description.film = {4, 4};
  const FilmSums sums = render_grad(
      Scene(std::move(description)),
      {.material = {1e-6, 0, 0}, .sample_count = 64, .derivatives = medium_parameters()});
  EXPECT_NEAR(film_mean(sums, -1), 1, 1e-5);
  EXPECT_NEAR(film_mean(sums, kSigmaT), -0.01, 1e-5);
}

// A distant light in the zenith on a slab of thickness D with the camera above it, to first order
// in the albedo: light goes down sigma_t y, is scattered back (cos_theta = -1), and comes up again:
//   d T / d albedo at albedo 0 = E p(-1; g) (1 - exp(-2 sigma_t D)) / 2.
TEST(SingleScatteringTest, DerivativeAtAlbedoZero) {
  SceneDescription description;
  description.object = box({-1, 0, -1}, {1, 0.5F, 1});
  description.lights = {DirectionalLight{{0, 1, 0}, 3}};
  description.camera = looking_down(4);
  description.film = {4, 4};
  const Scene scene(std::move(description));
  for (const double g : {-0.4, 0.0, 0.6}) {
    RenderRequest settings{
        .material = {2, 0, g}, .sample_count = 1024, .derivatives = medium_parameters()};
    // The roulette of shadow rays goes by the image, which is black.
    const RenderOptions all{.tuning = {.shadow_ray_roulette = 0}};
    const FilmEstimate film = estimate_film(scene, settings, 64, 1, all);
    const double phase = (1 - g * g) / (4 * std::numbers::pi * std::pow(1 + g, 3));
    const double expected = 3 * phase * (1 - std::exp(-2 * 2 * 0.5)) / 2;
    EXPECT_EQ(film.radiance.mean, 0);
    expect_equal(film.derivatives[kAlbedo], {expected, 0}, 3, "single scattering");
    expect_resolution(film.derivatives[kAlbedo], expected, 0.01, "single scattering");
  }
}

// The standard check of tissue optics: mu_a 10, mu_s 90 /cm, g 0.75, thickness 0.02 cm, index
// matched, a pencil beam at right angles: total reflectance 0.09739, total transmittance 0.66096
// (H. C. van de Hulst, "Multiple Light Scattering", 1980). By reciprocity the reflectance is the
// radiance seen along the beam when light of radiance 1 falls on that side only; black screens keep
// it from the other.
class VanDeHulstTest : public ::testing::Test {
 protected:
  static constexpr float kThickness = 0.2F;  // mm

  Estimated seen_from_above(float screen_height) {
    SceneDescription description;
    // So wide that no light reaches the sides, which are 100 mean free paths away.
    description.object = box({-10, 0, -10}, {10, kThickness, 10});
    description.surfaces = {{horizontal_square(screen_height, 1e4F), 0}};
    description.lights = {ConstantLight{1}};
    description.camera = looking_down(0.5);
    description.film = {8, 8};
    const Scene scene(std::move(description));
    return estimate_film(scene, {.material = {10, 0.9, 0.75}, .sample_count = 1024}, 64).radiance;
  }
};

TEST_F(VanDeHulstTest, Reflectance) {
  const Estimated reflectance = seen_from_above(-0.01F);  // the screen is below the slab
  expect_equal(reflectance, {0.09739, 0}, 2, "reflectance");
  expect_resolution(reflectance, 0.09739, 0.01, "reflectance");
}

TEST_F(VanDeHulstTest, Transmittance) {
  const Estimated transmittance = seen_from_above(1.0F);  // above the slab, behind the camera
  expect_equal(transmittance, {0.66096, 0}, 2, "transmittance");
  expect_resolution(transmittance, 0.66096, 0.01, "transmittance");
}

// H of isotropic scattering, by iteration of Chandrasekhar's equation in the form
//   1 / H(mu) = sqrt(1 - albedo) + albedo / 2 * integral_0^1 mu' H(mu') / (mu + mu') dmu'
// (S. Chandrasekhar, "Radiative Transfer", 1950, chapter V), with the midpoint rule.
class HFunction {
 public:
  explicit HFunction(double albedo) : albedo_(albedo), h_(kNodes, 1.0) {
    for (int iteration = 0; iteration < 200; ++iteration) {
      std::vector<double> next(kNodes);
      for (int i = 0; i < kNodes; ++i) next[i] = (*this)(node(i));
      h_ = std::move(next);
    }
  }
  double operator()(double mu) const {
    double integral = 0;
    for (int i = 0; i < kNodes; ++i) integral += node(i) * h_[i] / (mu + node(i)) / kNodes;
    return 1 / (std::sqrt(1 - albedo_) + albedo_ / 2 * integral);
  }

 private:
  static constexpr int kNodes = 400;
  static double node(int i) { return (i + 0.5) / kNodes; }
  double albedo_;
  std::vector<double> h_;
};

// Radiance of a half-space under a distant light of irradiance E across itself at cosine mu_0,
// seen at mu:
//   I = albedo / (4 pi) E mu_0 / (mu + mu_0) H(mu) H(mu_0)
// (Chandrasekhar, chapter III, Eq. 123, with pi F = E).
TEST(ChandrasekharTest, HalfSpace) {
  struct Row {
    double albedo, mu_0;
  };
  for (const Row row : {Row{0.5, 0.3}, Row{0.9, 0.8}, Row{0.99, 0.5}}) {
    SceneDescription description;
    description.object = box({-60, -60, -60}, {60, 0, 60});
    const double sine = std::sqrt(1 - row.mu_0 * row.mu_0);
    description.lights = {DirectionalLight{{sine, row.mu_0, 0}, 2}};
    description.camera = looking_down(3);
    description.film = {4, 4};
    const Scene scene(std::move(description));
    const Estimated seen =
        estimate_film(scene, {.material = {3, row.albedo, 0}, .sample_count = 1024}, 64).radiance;
    const HFunction h(row.albedo);
    const double expected =
        row.albedo / (4 * std::numbers::pi) * 2 * row.mu_0 / (1 + row.mu_0) * h(1) * h(row.mu_0);
    expect_equal(seen, {expected, 0}, 3, "half-space");
    expect_resolution(seen, expected, 0.01, "half-space");
  }
}

// An opaque surface lit by a distant light alone: radiance = reflectance E cos / pi.
TEST(LambertTest, GroundUnderADistantLight) {
  SceneDescription description;
  description.object = box({5, 0, 5}, {6, 1, 6});
  description.surfaces = {{horizontal_square(0, 20), 0.6F}};
  description.lights = {DirectionalLight{{0, 0.8, 0.6}, 5}};
  description.camera = looking_down(4);
  description.film = {2, 2};
  const Scene scene(std::move(description));
  const FilmSums sums = render_grad(scene, {.material = {1e3, 0, 0}, .sample_count = 4});
  EXPECT_NEAR(film_mean(sums, -1), 0.6 * 5 * 0.8 / std::numbers::pi, 1e-5);
}

}  // namespace
}  // namespace itn::testing
