#include "server/tracer/lights/environment_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/error.h"
#include "server/tracer/lights/channel.h"

namespace itn::tracer {
namespace {

// u = atan2(x, -z) / 2 pi wrapped to [0, 1).
double map_u(Vec3f d) {
  const double u =
      std::atan2(static_cast<double>(d.x), static_cast<double>(-d.z)) / (2 * std::numbers::pi);
  return u - std::floor(u);
}

double map_v(Vec3f d) {
  return std::acos(std::clamp(static_cast<double>(d.y), -1.0, 1.0)) / std::numbers::pi;
}

}  // namespace

EnvironmentMapTable::EnvironmentMapTable(const EnvironmentMapLight& light, Channel channel)
    : width_(light.width),
      height_(light.height),
      values_(static_cast<size_t>(width_) * static_cast<size_t>(height_)) {
  for (size_t i = 0; i < values_.size(); ++i) {
    const Rgb c{light.rgb[3 * i], light.rgb[3 * i + 1], light.rgb[3 * i + 2]};
    for (const double v : c) {
      if (!(v >= 0 && std::isfinite(v))) {
        throw invalid_input(fmt::format(
            "environment map: pixel ({}, {}) is ({}, {}, {}); it must be finite and >= 0",
            i % width_, i / width_, c[0], c[1], c[2]));
      }
    }
    values_[i] = static_cast<float>(light.scale * select(c, channel));
    if (!std::isfinite(values_[i])) {
      throw invalid_input(
          fmt::format("environment map: pixel ({}, {}) times scale is beyond the range of a float",
                      i % width_, i / width_));
    }
  }
  weigh_pixels();
}

double EnvironmentMapTable::radiance_of(Vec3f d) const {
  const double x = map_u(d) * width_ - 0.5;
  const double y = map_v(d) * height_ - 0.5;
  const double fx = x - std::floor(x), fy = y - std::floor(y);
  const int column = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
  return std::lerp(std::lerp(value(column, row), value(column + 1, row), fx),
                   std::lerp(value(column, row + 1), value(column + 1, row + 1), fx), fy);
}

// Within a pixel uniform in azimuth and in y.
double EnvironmentMapTable::pdf(Vec3f d) const {
  const int column = std::min(static_cast<int>(map_u(d) * width_), width_ - 1);
  const int row = std::clamp(static_cast<int>(map_v(d) * height_), 0, height_ - 1);
  return static_cast<double>(cells_->probability(static_cast<size_t>(row) * width_ + column)) *
         static_cast<double>(inverse_angles_[row]);
}

Vec3f EnvironmentMapTable::sample(double u, float u0, float u1) const {
  const uint32_t cell = cells_->sample(u);
  const auto row = static_cast<int>(cell) / width_;
  const double azimuth = 2 * std::numbers::pi * (cell % width_ + double{u0}) / width_;
  const double y = std::lerp(double{edges_[row]}, double{edges_[row + 1]}, double{u1});
  const double r = std::sqrt(std::max(0.0, 1 - y * y));
  return static_cast<Vec3f>(Vec3d{r * std::sin(azimuth), y, -r * std::cos(azimuth)});
}

size_t EnvironmentMapTable::memory() const {
  return sizeof(*this) + (values_.size() + edges_.size() + inverse_angles_.size()) * sizeof(float) +
         (cells_ ? cells_->memory() : 0);
}

double EnvironmentMapTable::value(int column, int row) const {
  column = (column % width_ + width_) % width_;
  row = std::clamp(row, 0, height_ - 1);
  return static_cast<double>(values_[static_cast<size_t>(row) * width_ + column]);
}

// A pixel's weight is the average of the 3 x 3 values that bilinear interpolation reaches from it,
// so that no direction with light has density 0.
void EnvironmentMapTable::weigh_pixels() {
  const auto edge = [&](int row) { return std::cos(std::numbers::pi * row / height_); };
  std::vector<double> weights;
  weights.reserve(values_.size());
  edges_.push_back(1);
  for (int row = 0; row < height_; ++row) {
    const double solid_angle = 2 * std::numbers::pi / width_ * (edge(row) - edge(row + 1));
    edges_.push_back(static_cast<float>(edge(row + 1)));
    inverse_angles_.push_back(static_cast<float>(1 / solid_angle));
    for (int column = 0; column < width_; ++column) {
      double sum = 0;
      for (int i = 0; i < 9; ++i) sum += value(column + i % 3 - 1, row + i / 3 - 1);
      weights.push_back(sum / 9 * solid_angle);
      power_ += value(column, row) * solid_angle;
    }
  }
  if (power_ > 0) cells_.emplace(weights);
}

}  // namespace itn::tracer
