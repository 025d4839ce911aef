#include "server/tracer/lights/environment_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/error.h"

namespace itn::tracer {

EnvironmentMap EnvironmentMapLight::compile(const LightFrame& frame) const {
  if (width < 1 || height < 1 || rgb.size() != 3 * static_cast<size_t>(width) * height) {
    throw invalid_input(fmt::format("environment map: {} x {} pixels do not go with {} numbers",
                                    width, height, rgb.size()));
  }
  const auto build = [&] {
    return std::make_shared<const EnvironmentMapTable>(*this, frame.channel);
  };
  const auto table =
      digest.empty() ? build()
                     : frame.table<EnvironmentMapTable>(
                           part_key("map" + digest, width, height, scale, frame.channel), build);
  // A panorama turned by r, counter-clockwise seen from above, shows at azimuth a what stood at
  // a + r: azimuth grows from -z towards +x.
  return {table, turned_back(-rotate_y).after(frame.pose.rotation)};
}

EnvironmentMapTable::EnvironmentMapTable(const EnvironmentMapLight& light, Channel channel)
    : width_(light.width),
      height_(light.height),
      scale_(light.scale),
      values_(static_cast<size_t>(width_) * static_cast<size_t>(height_)) {
  if (channel == Channel::kRgb) colours_.resize(3 * values_.size());
  for (size_t i = 0; i < values_.size(); ++i) {
    const Rgb c{light.rgb[3 * i], light.rgb[3 * i + 1], light.rgb[3 * i + 2]};
    for (const double v : c) {
      if (!(v >= 0 && std::isfinite(v))) {
        throw invalid_input(fmt::format(
            "environment map: pixel ({}, {}) is ({}, {}, {}); it must be finite and >= 0",
            i % width_, i / width_, c[0], c[1], c[2]));
      }
    }
    const auto scaled = [&](double value) {
      const double result = light.scale * value;
      if (result <= EnvironmentMapLight::kMaxRadiance) return static_cast<float>(result);
      throw invalid_input(fmt::format(
          "environment map: pixel ({}, {}) times scale is {:g}; it must be at most {:g}",
          i % width_, i / width_, result, EnvironmentMapLight::kMaxRadiance));
    };
    values_[i] = scaled(select(c, channel));
    if (channel != Channel::kRgb) continue;
    for (size_t k = 0; k < c.size(); ++k) colours_[3 * i + k] = scaled(c[k]);
  }
  weigh_pixels();
}

size_t EnvironmentMapTable::memory() const {
  return sizeof(*this) +
         (values_.size() + colours_.size() + edges_.size() + inverse_angles_.size()) *
             sizeof(float) +
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
