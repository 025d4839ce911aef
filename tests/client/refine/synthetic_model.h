// An image formation without rendering: a smooth function of the material with Gaussian noise,
// whose truth is known exactly.
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "client/refine/observation.h"
#include "common/random.h"

namespace itn::testing {

class Gaussian1D {
 public:
  explicit Gaussian1D(uint64_t seed) : random_(seed) {}
  // Standard normal, by Box and Muller.
  double operator()() {
    const double radius = std::sqrt(-2 * std::log(1 - random_.uniform()));
    return radius * std::cos(2 * std::numbers::pi * random_.uniform());
  }

 private:
  SplitMix random_;
};

// Pixels of a kSide x kSide image that all see the object. Each depends on the material by
// exponents of its own: T = sigma_t^-a albedo^b exp(c g + d (index - 1.4)), the index being that of
// the scene's rough boundary.
class SyntheticModel {
 public:
  static constexpr uint32_t kSide = 20;
  static constexpr size_t kPixels = size_t{kSide} * kSide;
  static constexpr size_t kEstimates = 4;
  static constexpr double kIndex = 1.4;

  // Relative noise of a pixel of a render with one sample; 0: none.
  explicit SyntheticModel(double noise_of_sample = 0.5) : noise_(noise_of_sample) {
    v1::Scene scene;
    scene.mutable_object()->mutable_rough_dielectric();
    scene.mutable_object()->mutable_mesh()->set_builtin("cube");
    scene.add_lights()->mutable_constant();
    scene.mutable_camera()->mutable_origin()->set_z(-5);
    scene.mutable_camera()->mutable_target();
    scene.mutable_film()->set_width(kSide);
    scene.mutable_film()->set_height(kSide);
    scene_ = serialize(scene);
    for (size_t p = 0; p < kPixels; ++p) {
      const double u = static_cast<double>(p % kSide) / kSide;
      const double v = static_cast<double>(p / kSide) / kSide;
      exponents_.push_back({0.2 + 0.8 * u, 1 + 2 * v, std::cos(5 * u) * std::sin(4 * v),
                            std::cos(7 * u + 3) * std::cos(6 * v)});
    }
  }

  // Pixels depend on sigma_s (1 - g) and sigma_a, and hardly on what else there is.
  void make_similar_materials_alike() { alike_ = true; }

  double radiance(size_t p, const Material& m, double index = kIndex) const {
    const auto& [a, b, c, d] = exponents_[p];
    if (alike_) {
      return std::pow(m.sigma_a(), -a) * std::pow(m.sigma_s_reduced(), b / 3) *
             std::exp(0.02 * c * m.g);
    }
    return 10 * std::pow(m.sigma_t, -a) * std::pow(m.albedo, b) *
           std::exp(c * m.g + d * (index - kIndex));
  }

  // By sigma_t, albedo, g, index.
  double derivative(size_t p, const Material& m, size_t parameter, double index = kIndex) const {
    if (parameter == 3) return exponents_[p].d * radiance(p, m, index);
    const double step = 1e-6 * (parameter == 0 ? m.sigma_t : 1);
    const auto moved = [&](double by) {
      Material other = m;
      (parameter == 0 ? other.sigma_t : parameter == 1 ? other.albedo : other.g) += by;
      return radiance(p, other, index);
    };
    return (moved(step) - moved(-step)) / (2 * step);
  }

  // An image with this relative noise, of a photograph of its own.
  Observation observe(const Material& truth, double noise, uint64_t seed, double exposure = 1,
                      double index = kIndex) const {
    Observation observation{
        .name = "synthetic", .radiance = {}, .mask = {}, .noise = {}, .scene = scene_};
    observation.photograph = seed;
    Gaussian1D gaussian(seed);
    for (size_t p = 0; p < kPixels; ++p) {
      const double exact = exposure * radiance(p, truth, index);
      observation.radiance.push_back(static_cast<float>(exact * (1 + noise * gaussian())));
      observation.noise.push_back(static_cast<float>(exact * noise));
    }
    return observation;
  }

  Render render(const Material& m, uint32_t spp, uint64_t seed, double index = kIndex) const {
    Render render;
    render.mask.assign(kPixels, 1);
    Gaussian1D gaussian(seed);
    const double noise = noise_ * std::sqrt(static_cast<double>(kEstimates) / spp);
    for (size_t k = 0; k < kEstimates; ++k) {
      RenderEstimate& estimate = render.estimates.emplace_back();
      estimate.derivatives.resize(4);
      for (size_t p = 0; p < kPixels; ++p) {
        const double exact = radiance(p, m, index), off = gaussian();
        estimate.radiance.push_back(static_cast<float>(exact * (1 + noise * off)));
        for (size_t i = 0; i < 4; ++i) {
          // What makes a sample bright makes its derivative large, as in a render.
          const double scale = i == 0 ? exact / m.sigma_t : exact;
          estimate.derivatives[i].push_back(static_cast<float>(
              derivative(p, m, i, index) + 2 * scale * noise * (off + gaussian())));
        }
      }
    }
    return render;
  }

  Renderer renderer() const {
    return [this](std::span<const RenderQuery> queries) {
      std::vector<Render> renders;
      for (const RenderQuery& query : queries) {
        renders.push_back(render(query.material, query.spp, query.seed,
                                 query.values.empty() ? kIndex : query.values[0].value));
      }
      return renders;
    };
  }

 private:
  struct Exponents {
    double a, b, c, d;
  };
  double noise_;
  bool alike_ = false;
  std::shared_ptr<const SerializedScene> scene_;
  std::vector<Exponents> exponents_;
};

}  // namespace itn::testing
