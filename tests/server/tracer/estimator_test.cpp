// The two ways to sample light agree, and gradients of a loss are unbiased.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/server/tracer/scenes.h"

namespace itn::testing {
namespace {

using namespace tracer;
using Techniques = Switches::Techniques;

// Images and derivatives from light sampling alone, phase sampling alone, and both combined. Phase
// sampling finds the sun by chance and needs more samples.
TEST(MultipleImportanceSamplingTest, TechniquesAgree) {
  constexpr int kComparisons = 2 * 2 * 4;
  struct Row {
    const char* shape;
    Material material;
  };
  for (const Row& row : {Row{"sphere", {6, 0.7, 0.5}}, Row{"mug", {10, 0.5, 0}}}) {
    const Scene scene(studio(row.shape, {paper_sun_sky()}, 0.5F));
    const auto film = [&](Techniques techniques, uint32_t spp, uint64_t seed) {
      const RenderRequest request{
          .material = row.material, .sample_count = spp, .derivatives = medium_parameters()};
      return estimate_film(scene, request, 64, seed, {.switches = {.techniques = techniques}});
    };
    const FilmEstimate both = film(Techniques::kBoth, 72, 1);
    const std::vector<double> scales{both.radiance.mean / row.material.sigma_t, 0,
                                     both.radiance.mean / 0.5};
    const std::string shape = row.shape;
    expect_same_film(film(Techniques::kLightsOnly, 72, 101), both, kComparisons,
                     shape + ", lights only", scales);
    expect_same_film(film(Techniques::kPhaseOnly, 640, 201), both, kComparisons,
                     shape + ", phase only", scales);
  }
}

// Every estimator that is quicker or quieter gives the image and derivatives of the reference.
struct Variant {
  const char* name;
  void (*change)(RenderRequest&, RenderOptions&);
};

constexpr Variant kVariants[] = {
    {"standard", [](RenderRequest&, RenderOptions&) {}},
    {"plain",
     [](RenderRequest&, RenderOptions& o) {
       o.tuning.shadow_ray_roulette = 0;
       o.tuning.walk_roulette = 0.1;
       o.switches.stratified = false;
     }},
    {"much shadow ray roulette",
     [](RenderRequest&, RenderOptions& o) { o.tuning.shadow_ray_roulette = 0.5; }},
    {"much walk roulette", [](RenderRequest&, RenderOptions& o) { o.tuning.walk_roulette = 0.6; }},
    {"no walk roulette to speak of",
     [](RenderRequest&, RenderOptions& o) { o.tuning.walk_roulette = 1e-3; }},
    {"the usual walk roulette",
     [](RenderRequest&, RenderOptions& o) { o.switches.throughput_roulette = true; }},
    {"much roulette by depth",
     [](RenderRequest&, RenderOptions& o) { o.tuning.depth_roulette = 1.5; }},
    {"no stratification", [](RenderRequest&, RenderOptions& o) { o.switches.stratified = false; }},
    {"a pilot for the control variates",
     [](RenderRequest& r, RenderOptions& o) {
       r.pilot_spp = 4;
       o.switches.adaptive = false;
     }},
    {"a pilot for control variates and samples",
     [](RenderRequest& r, RenderOptions&) { r.pilot_spp = 4; }}};

// A scene and a material that all variants are tried on, with the samples that the reference and
// each variant need to be known well enough.
struct Subject {
  const char* shape;
  Material material;
  uint32_t reference_spp, spp;
  // So thick that sigma_t shows nowhere but in the finest features: its derivative hardly differs
  // from 0. An error in it is then measured by the radiance, as one of d/d ln(sigma_t).
  bool opaque = false;
};

void PrintTo(const Subject& subject, std::ostream* out) {
  *out << subject.shape << ", sigma_t " << subject.material.sigma_t;
}

class VariantsTest : public ::testing::TestWithParam<Subject> {};

TEST_P(VariantsTest, AgreeWithTheReference) {
  constexpr int kComparisons = 3 * static_cast<int>(std::size(kVariants)) * 4;
  const Subject& subject = GetParam();
  const Scene scene(studio(subject.shape, {paper_sun_sky()}, 0.5F));
  const FilmEstimate reference = estimate_film(scene,
                                               {.material = subject.material,
                                                .sample_count = subject.reference_spp,
                                                .derivatives = medium_parameters(),
                                                .tracer = Tracer::kReference},
                                               64, 1);
  const double per_sigma_t = reference.radiance.mean / subject.material.sigma_t;
  for (const Variant& variant : kVariants) {
    RenderRequest request{.material = subject.material,
                          .sample_count = subject.spp,
                          .derivatives = medium_parameters()};
    RenderOptions options;
    variant.change(request, options);
    expect_same_film(estimate_film(scene, request, 64, 301, options), reference, kComparisons,
                     variant.name, {subject.opaque ? per_sigma_t : 0});
  }
}

INSTANTIATE_TEST_SUITE_P(Subjects, VariantsTest,
                         ::testing::Values(Subject{"mug", {10, 0.5, 0}, 192, 320}));
INSTANTIATE_TEST_SUITE_P(FineSubject, VariantsTest,
                         ::testing::Values(Subject{"smooth_star", {12, 0.7, 0.4}, 640, 640}));
INSTANTIATE_TEST_SUITE_P(OpaqueSubject, VariantsTest,
                         ::testing::Values(Subject{
                             "smooth_star", {3000, 0.87, 0.4}, 704, 768, true}));

// Images at other albedos from the same walks are those of their own walks.
TEST(AlbedosTest, FromOneWalkAreThoseOfTheirOwn) {
  const Scene scene(studio("smooth_star", {paper_sun_sky()}, 0.5F));
  RenderRequest together{.material = {60, 0.95, 0.4}, .sample_count = 72};
  together.albedos = {0.87, 0.59, 0};
  std::vector<std::vector<double>> means_at(together.albedos.size());
  for (uint64_t seed = 0; seed < 96; ++seed) {
    together.seed = seed;
    const RenderedImages images = means(render_grad(scene, together));
    for (size_t a = 0; a < means_at.size(); ++a) {
      double sum = 0;
      for (const float v : images.estimates[0].other_media[a]) sum += v;
      means_at[a].push_back(sum / static_cast<double>(images.mask.size()));
    }
  }
  for (size_t a = 0; a < means_at.size(); ++a) {
    RenderRequest delta_bounce = together;
    delta_bounce.albedos.clear();
    delta_bounce.material.albedo = together.albedos[a];
    const FilmEstimate own = estimate_film(scene, delta_bounce, 96, 501);
    expect_equal(over_batches(means_at[a]), own.radiance, 3,
                 "albedo " + std::to_string(together.albedos[a]));
    expect_resolution(over_batches(means_at[a]), own.radiance.mean, 0.01, "at albedo");
  }
}

// The loss L = sum over pixels of (T - I)^2 has the gradient sum of 2 (T - I) dT. With independent
// estimates A and B of T and dT, (T_A - I) dT_B + (T_B - I) dT_A is unbiased; with the same samples
// in both factors it is not, and the test must see that.
class LossGradientTest : public ::testing::Test {
 protected:
  LossGradientTest() : scene_(studio("cube", {paper_sun_sky()}, 0.5F)) {
    compare_with({40, 0.9, 0.2});
    for (size_t p = 0; p < target_.size(); ++p) weight_.push_back(static_cast<float>(p % 4) / 3);
  }

  void compare_with(const Material& material) {
    const FilmSums target =
        render_grad(scene_, {.material = material, .sample_count = 1024, .seed = 77});
    target_ = means(target).estimates[0].radiance;
  }

  RenderedImages render(double sigma_t, uint32_t spp, uint64_t seed,
                        std::vector<Parameter> derivatives) const {
    return means(render_grad(scene_, {.material = {sigma_t, 0.8, 0.2},
                                      .sample_count = spp,
                                      .seed = seed,
                                      .derivatives = std::move(derivatives),
                                      .estimates = 2}));
  }

  // Unbiased for the loss itself, in the same way: (T_A - I)(T_B - I).
  double loss(double sigma_t, uint64_t seed) const {
    const RenderedImages images = render(sigma_t, 1024, seed, {});
    double sum = 0;
    for (size_t p = 0; p < target_.size(); ++p) {
      sum += residual(images, 0, p) * residual(images, 1, p);
    }
    return sum;
  }

  double residual(const RenderedImages& images, size_t k, size_t p) const {
    return static_cast<double>(images.estimates[k].radiance[p]) - static_cast<double>(target_[p]);
  }

  // Gradient of the weighted loss, and the loss, from all pairs of different estimates.
  std::array<double, kCoordinates + 1> pair_loss(const RenderedImages& images) const {
    std::array<double, kCoordinates + 1> result{};
    const size_t count = images.estimates.size();
    const double pairs = static_cast<double>(count * (count - 1));
    for (size_t p = 0; p < target_.size(); ++p) {
      for (size_t i = 0; i < count; ++i) {
        for (size_t j = 0; j < count; ++j) {
          if (i == j || images.mask[p] == 0) continue;
          const double w = weight_[p];
          for (size_t c = 0; c < images.estimates[j].derivatives.size(); ++c) {
            result[c] += 2 * w * residual(images, i, p) *
                         static_cast<double>(images.estimates[j].derivatives[c][p]) / pairs;
          }
          result[kCoordinates] += w * residual(images, i, p) * residual(images, j, p) / pairs;
        }
      }
    }
    return result;
  }

  Scene scene_;
  std::vector<float> target_;
  std::vector<float> weight_;  // a pixel in four has none
};

TEST_F(LossGradientTest, TwoEstimatesAreUnbiasedAndOneIsNot) {
  constexpr double kSigmaT0 = 30, kStep = 3;
  std::vector<double> slopes;
  for (uint64_t seed = 0; seed < 48; ++seed) {
    slopes.push_back((loss(kSigmaT0 + kStep, seed) - loss(kSigmaT0 - kStep, seed)) / (2 * kStep));
  }
  const Estimated finite_difference = over_batches(slopes);

  std::vector<double> independent, same;
  for (uint64_t seed = 1000; seed < 5000; ++seed) {
    const RenderedImages images = render(kSigmaT0, 4, seed, medium_parameters());
    double cross_terms = 0, same_terms = 0;
    for (size_t p = 0; p < target_.size(); ++p) {
      const auto derivative = [&](size_t k) {
        return static_cast<double>(images.estimates[k].derivatives[kSigmaT][p]);
      };
      cross_terms +=
          residual(images, 0, p) * derivative(1) + residual(images, 1, p) * derivative(0);
      same_terms += residual(images, 0, p) * derivative(0) + residual(images, 1, p) * derivative(1);
    }
    independent.push_back(cross_terms);
    same.push_back(same_terms);
  }
  expect_equal(over_batches(independent), finite_difference, 1, "independent estimates");
  const Estimated biased = over_batches(same);
  const double z = (biased.mean - finite_difference.mean) /
                   std::hypot(biased.standard_error, finite_difference.standard_error);
  std::printf("  the same samples twice: %.4g +- %.2g, z = %+.1f\n", biased.mean,
              biased.standard_error, z);
  EXPECT_GT(std::abs(z), 2 * t_threshold(1, biased.degrees_of_freedom))
      << "the test could not tell a biased gradient";
}

enum class Against { kPlainEstimates, kSlopes };

// The gradient as training asks for it, few samples and everything that makes it quieter, against
// finite differences of the loss, or against the gradient from two halves of many samples with
// nothing of all that.
class TrainingGradientTest : public LossGradientTest,
                             public ::testing::WithParamInterface<Against> {};

TEST_P(TrainingGradientTest, IsUnbiased) {
  const bool against_slopes = GetParam() == Against::kSlopes;
  // Materials whose images differ by much in the coordinate. Steps are small: the third derivative
  // grows as sigma_t^-2 and as (1 - albedo)^-2. Counts are such that an error of 2 % would show, of
  // 1 % against slopes but those in sigma_t.
  const uint64_t part = against_slopes ? 1 : 3;
  const double resolution = against_slopes ? 0.01 : 0.02;
  struct Case {
    Coordinate coordinate;
    Material target, material;
    double step, slope_resolution;
    uint64_t slopes, plain, gradients;
  };
  const Material brighter{40, 0.9, 0.2}, darker{30, 0.8, 0.2};
  for (const Case& c : {Case{kSigmaT, {20, 0.8, 0.2}, {6, 0.8, 0.2}, 0.3, 0.02, 336, 240, 12000},
                        Case{kAlbedo, brighter, darker, 0.005, 0.01, 240, 24, 3000},
                        Case{kG, brighter, darker, 0.05, 0.01, 228, 48, 3000}}) {
    compare_with(c.target);
    RenderRequest settings{.material = c.material, .sample_count = 1024, .estimates = 4};
    settings.pixels = Pixels::kObject;
    const auto loss_of = [&](const RenderRequest& s, const RenderOptions& options = {}) {
      return pair_loss(means(render_grad(scene_, s, options)));
    };
    std::vector<double> expected, gradients;
    for (uint64_t seed = 0; against_slopes && seed < c.slopes; ++seed) {
      RenderRequest s = settings;
      s.seed = seed;
      const auto moved = [&](double by) {
        s.material = c.material;
        (c.coordinate == kSigmaT   ? s.material.sigma_t
         : c.coordinate == kAlbedo ? s.material.albedo
                                   : s.material.g) += by;
        return loss_of(s)[kCoordinates];
      };
      expected.push_back((moved(c.step) - moved(-c.step)) / (2 * c.step));
    }
    settings.derivatives = medium_parameters();
    for (uint64_t seed = 1000;
         !against_slopes && seed < 1000 + std::max<uint64_t>(16, c.plain / part); ++seed) {
      RenderRequest s = settings;
      s.seed = seed;
      s.estimates = 2;
      const RenderOptions simple{.tuning = {.shadow_ray_roulette = 0},
                                 .switches = {.throughput_roulette = true, .stratified = false}};
      expected.push_back(loss_of(s, simple)[c.coordinate]);
    }
    settings.sample_count = 16;
    settings.pilot_spp = 4;
    for (size_t p = 0; p < target_.size(); ++p) {
      settings.sampling_weights.push_back(weight_[p] * (target_[p] + 0.1F));
    }
    for (uint64_t seed = 2000; seed < 2000 + c.gradients / part; ++seed) {
      settings.seed = seed;
      gradients.push_back(loss_of(settings)[c.coordinate]);
    }
    const std::string what = "coordinate " + std::to_string(c.coordinate);
    const Estimated gradient = over_batches(gradients);
    expect_equal(gradient, over_batches(expected), 2 * kCoordinates, what);
    expect_resolution(gradient, gradient.mean, resolution, what);
    expect_resolution(over_batches(expected), gradient.mean,
                      against_slopes ? c.slope_resolution : resolution, what + ", expected");
  }
}

INSTANTIATE_TEST_SUITE_P(PlainEstimates, TrainingGradientTest,
                         ::testing::Values(Against::kPlainEstimates));
INSTANTIATE_TEST_SUITE_P(Slopes, TrainingGradientTest, ::testing::Values(Against::kSlopes));

}  // namespace
}  // namespace itn::testing
