#include "server/tracer/film/plan.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace itn::tracer {
namespace {

// Half the side of the square of pixels that are averaged.
constexpr int kBlur = 2;

// Least standard deviation that a pixel is thought to have, of the mean.
constexpr double kMinDeviation = 0.25;

// In their order in the film.
std::vector<uint32_t> rendered_pixels(const Scene::Compiled& scene, const RenderRequest& request) {
  const Tile tile = tile_of(scene, request);
  static const std::vector<uint32_t> kNone;
  const std::vector<uint32_t>& object =
      request.pixels == Pixels::kObject ? scene.object_pixels() : kNone;
  std::vector<uint32_t> pixels;
  for (uint32_t y = tile.y; y < tile.y + tile.height; ++y) {
    const uint32_t first = y * static_cast<uint32_t>(scene.film.width) + tile.x;
    const uint32_t end = first + tile.width;
    if (request.pixels == Pixels::kObject) {
      pixels.insert(pixels.end(), std::ranges::lower_bound(object, first),
                    std::ranges::lower_bound(object, end));
    } else {
      pixels.resize(pixels.size() + tile.width);
      std::iota(pixels.end() - tile.width, pixels.end(), first);
    }
  }
  return pixels;
}

void number_paths(Plan& plan) {
  for (PlannedPixel& p : plan.pixels) {
    p.first_path = plan.paths;
    plan.paths += p.sample_count;
  }
}

// The tile and the pixels around it that are averaged for those at its edge.
Tile with_margin(const Tile& tile, const FilmDescription& film) {
  const auto grown = [](uint32_t first, uint32_t count, int length) {
    const auto begin = first - std::min<uint32_t>(first, kBlur);
    const auto end = std::min(first + count + kBlur, static_cast<uint32_t>(length));
    return std::pair(begin, end - begin);
  };
  const auto [x, width] = grown(tile.x, tile.width, film.width);
  const auto [y, height] = grown(tile.y, tile.height, film.height);
  return {x, y, width, height};
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

// Share of the samples by pixel, from their deviations; the mean is 1.
std::vector<double> sample_shares(const std::vector<uint32_t>& pixels,
                                  const std::vector<double>& deviation,
                                  const RenderRequest& request, bool adaptive) {
  std::vector<double> shares(pixels.size(), 1);
  if (!adaptive) return shares;
  double total = 0;
  for (const double d : deviation) total += d;
  const double least = kMinDeviation * total / static_cast<double>(pixels.size());
  double sum = 0;
  for (size_t i = 0; i < pixels.size(); ++i) {
    const double weight =
        request.sampling_weights.empty() ? 1 : double{request.sampling_weights[pixels[i]]};
    shares[i] = weight * (least + (1 - kMinDeviation) * deviation[i]);
    sum += shares[i];
  }
  if (!(sum > 0)) return std::vector<double>(pixels.size(), 1);
  for (double& share : shares) share *= static_cast<double>(pixels.size()) / sum;
  return shares;
}

}  // namespace

Tile tile_of(const Scene::Compiled& scene, const RenderRequest& request) {
  return request.tile.value_or(Tile{.width = static_cast<uint32_t>(scene.film.width),
                                    .height = static_cast<uint32_t>(scene.film.height)});
}

Plan even_plan(const Scene::Compiled& scene, const RenderRequest& request) {
  Plan plan;
  for (const uint32_t pixel : rendered_pixels(scene, request)) {
    plan.pixels.push_back({pixel, request.sample_count, 0, 0});
  }
  number_paths(plan);
  return plan;
}

RenderRequest pilot_request(const Scene::Compiled& scene, const RenderRequest& request) {
  RenderRequest pilot = request;
  if (request.tile) pilot.tile = with_margin(*request.tile, scene.film);
  pilot.sample_count = request.pilot_spp;
  pilot.first_sample = 0;
  pilot.pilot_spp = 0;
  pilot.estimates = 1;
  pilot.derivatives.clear();
  pilot.albedos.clear();
  pilot.sampling_weights.clear();
  pilot.gradient_weights.clear();
  pilot.gradient_light.reset();
  pilot.gradient_normals = false;
  pilot.seed = request.seed ^ 0x9E3779B97F4A7C15;  // another stream
  return pilot;
}

Plan plan_from_pilot(const Scene::Compiled& scene, const RenderRequest& request,
                     const RenderOptions& options, const FilmSums& pilot) {
  const auto& estimate = pilot.estimates[0];
  std::vector<bool> rendered(estimate.radiance.size());
  std::vector<double> mean(rendered.size()), variance(rendered.size());
  for (size_t i = 0; i < rendered.size(); ++i) {
    if (estimate.counts[i] == 0) continue;
    const double n = estimate.counts[i];
    rendered[i] = true;
    mean[i] = static_cast<double>(estimate.radiance[i]) * pilot.quantum / n;
    const double square = static_cast<double>(pilot.squares[i]) * pilot.squares_quantum / n;
    // One sample tells no deviation: that of a path is about its mean.
    variance[i] = n > 1 ? std::max(0.0, square - mean[i] * mean[i]) : mean[i] * mean[i];
  }
  mean = blurred(mean, rendered, pilot.width, pilot.height);
  variance = blurred(variance, rendered, pilot.width, pilot.height);

  const std::vector<uint32_t> pixels = rendered_pixels(scene, request);
  std::vector<double> deviation(pixels.size());
  for (size_t i = 0; i < pixels.size(); ++i) {
    deviation[i] = std::sqrt(variance[pilot.index_of(pixels[i])]);
  }
  const std::vector<double> shares =
      sample_shares(pixels, deviation, request, options.switches.adaptive);
  Plan plan;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (shares[i] == 0) continue;
    // Every estimate gets as many, so that all are as good; a pixel gets what may be asked for at
    // most.
    const double each =
        std::clamp(std::round(shares[i] * request.sample_count / request.estimates), 1.0,
                   std::max(1.0, std::floor(double{kMaxSamples} / request.estimates)));
    plan.pixels.push_back(
        {pixels[i], static_cast<uint32_t>(each) * request.estimates,
         static_cast<float>(options.tuning.control_variate * mean[pilot.index_of(pixels[i])]), 0});
  }
  number_paths(plan);
  return plan;
}

}  // namespace itn::tracer
