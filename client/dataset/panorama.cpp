#include "client/dataset/panorama.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "common/luminance.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace {

// The weights of R, G and B in what a film shows.
std::array<double, 3> weights_in(v1::Film::Channel channel) {
  if (channel == v1::Film::LUMINANCE) return kLuminanceOfColours;
  std::array<double, 3> weights{};
  weights.at(static_cast<size_t>(channel - v1::Film::RED)) = 1;
  return weights;
}

// The height on the unit sphere at which a row begins: cos(pi row / height), but 0 at the horizon.
double top_of(uint32_t row, uint32_t height) {
  return std::sin(std::numbers::pi / 2 * (height - 2.0 * row) / height);
}

// A pixel of a larger image, and the part that it has of one of a smaller image along an axis.
struct Part {
  uint32_t of;
  double part;
};

// What each pixel of the smaller image is made of. Pixel i of n begins at `begin(i, n)`, which
// rises or falls with i.
template <typename Begin>
std::vector<std::vector<Part>> parts_of(uint32_t size, uint32_t smaller, const Begin& begin) {
  std::vector<std::vector<Part>> parts(smaller);
  for (uint32_t i = 0; i < smaller; ++i) {
    const auto [low, high] = std::minmax({begin(i, smaller), begin(i + 1, smaller)});
    const auto end = static_cast<uint32_t>((uint64_t{i + 1} * size + smaller - 1) / smaller);
    for (auto k = static_cast<uint32_t>(uint64_t{i} * size / smaller); k < end; ++k) {
      const auto [from, to] = std::minmax({begin(k, size), begin(k + 1, size)});
      const double common = std::min(high, to) - std::max(low, from);
      parts[i].push_back({k, std::max(0.0, common) / (high - low)});
    }
  }
  return parts;
}

}  // namespace

PanoramaRow panorama_row(uint32_t row, uint32_t width, uint32_t height) {
  const double column = 2 * std::numbers::pi / width;
  const double top = top_of(row, height), bottom = top_of(row + 1, height);
  const double up = std::max(top, 0.0), down = std::max(bottom, 0.0);
  return {.solid_angle = column * (top - bottom),
          .from_above = column * (up * up - down * down) / 2};
}

v1::Pixels panorama_of(uint32_t width, uint32_t height, std::span<const float> rgb) {
  v1::Pixels pixels;
  pixels.set_width(width);
  pixels.set_height(height);
  pixels.set_rgb(to_bytes(rgb));
  return pixels;
}

double irradiance_from_above(const v1::Pixels& panorama, v1::Film::Channel channel) {
  const std::array<double, 3> weights = weights_in(channel);
  const std::vector<float> rgb = from_bytes<float>(panorama.rgb());
  double sum = 0;
  auto value = rgb.begin();
  for (uint32_t row = 0; row < panorama.height(); ++row) {
    double radiance = 0;
    for (uint32_t column = 0; column < panorama.width(); ++column) {
      for (const double weight : weights) radiance += weight * static_cast<double>(*value++);
    }
    sum += radiance * panorama_row(row, panorama.width(), panorama.height()).from_above;
  }
  return sum;
}

v1::Pixels averaged_down(const v1::Pixels& panorama, uint32_t max_width, uint32_t max_height) {
  const uint32_t width = std::min(panorama.width(), max_width);
  const uint32_t height = std::min(panorama.height(), max_height);
  if (width == panorama.width() && height == panorama.height()) return panorama;
  const auto rows = parts_of(panorama.height(), height, top_of);
  const auto columns = parts_of(panorama.width(), width,
                                [](uint32_t i, uint32_t n) { return static_cast<double>(i) / n; });
  const std::vector<float> rgb = from_bytes<float>(panorama.rgb());
  std::vector<float> result;
  result.reserve(size_t{3} * width * height);
  for (const auto& row : rows) {
    for (const auto& column : columns) {
      double mean[3] = {};
      for (const Part& y : row) {
        for (const Part& x : column) {
          const float* const pixel = &rgb[3 * (size_t{y.of} * panorama.width() + x.of)];
          for (size_t c = 0; c < 3; ++c) mean[c] += y.part * x.part * static_cast<double>(pixel[c]);
        }
      }
      for (const double value : mean) result.push_back(static_cast<float>(value));
    }
  }
  v1::Pixels pixels;
  pixels.set_width(width);
  pixels.set_height(height);
  pixels.set_rgb(to_bytes(result));
  return pixels;
}

void scale(v1::Pixels& panorama, double factor) {
  std::vector<float> rgb = from_bytes<float>(panorama.rgb());
  for (float& value : rgb) value = static_cast<float>(static_cast<double>(value) * factor);
  panorama.set_rgb(to_bytes(rgb));
}

}  // namespace itn
