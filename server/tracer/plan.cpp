#include "server/tracer/plan.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace itn::tracer {
namespace {

// Half the side of the square of pixels that are averaged.
constexpr int kBlur = 2;

// In a pixel, whatever its weight: as many as may be asked for.
constexpr double kMostSamples = 1 << 20;

// Least standard deviation that a pixel is thought to have, of the mean.
constexpr double kLeastDeviation = 0.25;

std::vector<uint32_t> rendered_pixels(const Scene::Compiled& scene, const RenderRequest& request) {
  if (request.pixels == Pixels::kObject) {
    return scene.object_pixels();
  }
  std::vector<uint32_t> all(static_cast<size_t>(scene.film.width) *
                            static_cast<size_t>(scene.film.height));
  std::iota(all.begin(), all.end(), 0U);
  return all;
}

void number_paths(Plan& plan) {
  for (PlannedPixel& p : plan.pixels) {
    p.first_path = plan.paths;
    plan.paths += p.sample_count;
  }
}

// Averages over the square of pixels around each, of those that are rendered.
std::vector<double> blurred(const std::vector<double>& image, const std::vector<bool>& rendered,
                            int width, int height) {
  std::vector<double> result(image.size());
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double sum = 0;
      int count = 0;
      for (int v = std::max(0, y - kBlur); v <= std::min(height - 1, y + kBlur); ++v) {
        for (int u = std::max(0, x - kBlur); u <= std::min(width - 1, x + kBlur); ++u) {
          const auto p =
              static_cast<size_t>(v) * static_cast<size_t>(width) + static_cast<size_t>(u);
          if (rendered[p]) {
            sum += image[p];
            ++count;
          }
        }
      }
      result[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)] =
          count > 0 ? sum / count : 0;
    }
  }
  return result;
}

// Share of the samples by pixel; the mean is 1.
std::vector<double> sample_shares(const std::vector<uint32_t>& pixels,
                                  const std::vector<double>& deviation,
                                  const RenderRequest& request, bool adaptive) {
  std::vector<double> shares(pixels.size(), 1);
  if (!adaptive) {
    return shares;
  }
  double total = 0;
  for (const uint32_t p : pixels) {
    total += deviation[p];
  }
  const double least = kLeastDeviation * total / static_cast<double>(pixels.size());
  double sum = 0;
  for (size_t i = 0; i < pixels.size(); ++i) {
    const uint32_t p = pixels[i];
    const double weight =
        request.sampling_weights.empty() ? 1 : double{request.sampling_weights[p]};
    shares[i] = weight * (least + (1 - kLeastDeviation) * deviation[p]);
    sum += shares[i];
  }
  if (!(sum > 0)) {
    return std::vector<double>(pixels.size(), 1);
  }
  for (double& share : shares) {
    share *= static_cast<double>(pixels.size()) / sum;
  }
  return shares;
}

}  // namespace

Plan even_plan(const Scene::Compiled& scene, const RenderRequest& request) {
  Plan plan;
  for (const uint32_t pixel : rendered_pixels(scene, request)) {
    plan.pixels.push_back({pixel, request.first_sample, request.sample_count, 0, 0});
  }
  number_paths(plan);
  return plan;
}

RenderRequest pilot_request(const RenderRequest& request) {
  RenderRequest pilot = request;
  pilot.first_sample = 0;
  pilot.sample_count = request.pilot_spp;
  pilot.pilot_spp = 0;
  pilot.estimates = 1;
  pilot.derivatives.clear();
  pilot.albedos.clear();
  pilot.sampling_weights.clear();
  pilot.seed = request.seed ^ 0x9E3779B97F4A7C15;  // another stream
  return pilot;
}

Plan plan_from_pilot(const Scene::Compiled& scene, const RenderRequest& request,
                     const RenderOptions& options, const FilmSums& pilot) {
  const std::vector<uint32_t> pixels = rendered_pixels(scene, request);
  const auto& estimate = pilot.estimates[0];
  std::vector<bool> rendered(estimate.radiance.size());
  std::vector<double> mean(rendered.size()), deviation(rendered.size());
  for (const uint32_t p : pixels) {
    const double n = estimate.counts[p];
    rendered[p] = true;
    mean[p] = static_cast<double>(estimate.radiance[p]) * pilot.quantum / n;
    const double square = static_cast<double>(pilot.squares[p]) * pilot.squares_quantum / n;
    // One sample tells no deviation: that of a path is about its mean.
    deviation[p] = n > 1 ? std::max(0.0, square - mean[p] * mean[p]) : mean[p] * mean[p];
  }
  mean = blurred(mean, rendered, pilot.width, pilot.height);
  deviation = blurred(deviation, rendered, pilot.width, pilot.height);
  for (const uint32_t p : pixels) {
    deviation[p] = std::sqrt(deviation[p]);
  }

  const std::vector<double> shares =
      sample_shares(pixels, deviation, request, options.switches.adaptive);
  const double spp = request.spp > 0 ? request.spp : request.first_sample + request.sample_count;
  Plan plan;
  for (size_t i = 0; i < pixels.size(); ++i) {
    const uint32_t p = pixels[i];
    if (shares[i] == 0) {
      continue;
    }
    // Every estimate gets as many, so that all are as good. A part takes its part of every pixel.
    const double each = std::clamp(std::round(shares[i] * spp / request.estimates), 1.0,
                                   std::max(1.0, std::floor(kMostSamples / request.estimates)));
    const auto number = [&](double sample) {
      return static_cast<uint32_t>(std::floor(each * request.estimates * sample / spp));
    };
    const uint32_t first = number(static_cast<double>(request.first_sample));
    const uint32_t last = number(static_cast<double>(request.first_sample) + request.sample_count);
    plan.pixels.push_back(
        {p, first, last - first, static_cast<float>(options.tuning.control_variate * mean[p]), 0});
  }
  number_paths(plan);
  return plan;
}

}  // namespace itn::tracer
