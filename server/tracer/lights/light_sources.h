// The kinds of distant lights, and how directions are drawn from them. Internal to the tracer: the
// wavefront renderer evaluates the same tables many directions at a time.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <numeric>

#include "common/error.h"
#include "server/tracer/lights/lights.h"
#include "server/tracer/lights/sky.h"

namespace itn::tracer {

// The part of a colour that is rendered.
inline double select(const Rgb& c, Channel channel) {
  switch (channel) {
    case Channel::kLuminance: return luminance(c);
    case Channel::kRed: return c[0];
    case Channel::kGreen: return c[1];
    case Channel::kBlue: return c[2];
  }
  return 0;
}

class UniformSource final : public LightSource {
 public:
  explicit UniformSource(double radiance) : radiance_(radiance) {}
  double radiance(Vec3f) const override { return radiance_; }
  double pdf(Vec3f) const override { return 1 / (4 * std::numbers::pi); }
  Vec3f sample([[maybe_unused]] double u, float u0, float u1) const override {
    const float y = 1 - 2 * u0;
    const float r = std::sqrt(std::max(0.0F, 1 - y * y));
    const float phi = 2 * std::numbers::pi_v<float> * u1;
    return {r * std::cos(phi), y, r * std::sin(phi)};
  }
  double power() const override { return 4 * std::numbers::pi * radiance_; }
  size_t memory() const override { return sizeof(*this); }

 private:
  double radiance_;
};

// A disc of constant radiance: the cone of directions within an angle of its axis.
class ConeSource final : public LightSource {
 public:
  ConeSource(Vec3d axis, double half_angle, double irradiance)
      : basis_(static_cast<Vec3f>(axis)),
        one_minus_cos_(2 * std::pow(std::sin(half_angle / 2), 2)),
        solid_angle_(2 * std::numbers::pi * one_minus_cos_),
        radiance_(irradiance / solid_angle_) {}

  double radiance(Vec3f d) const override { return inside(d) ? radiance_ : 0; }
  double pdf(Vec3f d) const override { return inside(d) ? 1 / solid_angle_ : 0; }

  // With z = 1 - cos_theta uniform in [0, 1 - cos(half_angle)]; sin_theta = sqrt(z (2 - z)) holds
  // for a narrow sun too, where 1 - cos_theta^2 would cancel.
  Vec3f sample([[maybe_unused]] double u, float u0, float u1) const override {
    const float z = u0 * static_cast<float>(one_minus_cos_);
    const float sin_theta = std::sqrt(z * (2 - z));
    const float phi = 2 * std::numbers::pi_v<float> * u1;
    return itn::normalize(
        basis_.to_world(sin_theta * std::cos(phi), sin_theta * std::sin(phi), 1 - z));
  }
  double power() const override { return radiance_ * solid_angle_; }
  size_t memory() const override { return sizeof(*this); }

  const Basis<float>& basis() const { return basis_; }
  double one_minus_cos() const { return one_minus_cos_; }

 private:
  // |d - axis|^2 = 2 (1 - cos_theta): no cancellation for a narrow sun.
  bool inside(Vec3f d) const {
    const Vec3f difference = d - basis_.n;
    return 0.5 * static_cast<double>(dot(difference, difference)) <= one_minus_cos_;
  }

  Basis<float> basis_;
  double one_minus_cos_, solid_angle_, radiance_;
};

// Draws one of many cells with given weights, in constant time: Walker, "An Efficient Method for
// Generating Discrete Random Variables with General Distributions", 1977, with Vose's construction.
class AliasTable {
 public:
  struct Entry {
    float own;  // probability of keeping the cell, against `other`
    uint32_t other;
  };
  explicit AliasTable(const std::vector<double>& weights)
      : entries_(weights.size()), probabilities_(weights.size()) {
    const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
    const auto n = static_cast<double>(weights.size());
    std::vector<double> scaled(weights.size());
    std::vector<uint32_t> small, large;
    for (uint32_t i = 0; i < weights.size(); ++i) {
      probabilities_[i] = static_cast<float>(weights[i] / sum);
      scaled[i] = weights[i] / sum * n;
      (scaled[i] < 1 ? small : large).push_back(i);
    }
    while (!small.empty() && !large.empty()) {
      const uint32_t poor = small.back(), rich = large.back();
      small.pop_back();
      entries_[poor] = {static_cast<float>(scaled[poor]), rich};
      scaled[rich] -= 1 - scaled[poor];
      if (scaled[rich] < 1) {
        large.pop_back();
        small.push_back(rich);
      }
    }
    for (const auto& rest : {small, large}) {
      for (const uint32_t i : rest) {
        entries_[i] = {1, i};
      }
    }
  }

  uint32_t sample(double u) const {
    const double scaled = u * static_cast<double>(entries_.size());
    const auto i = std::min(static_cast<size_t>(scaled), entries_.size() - 1);
    const Entry& entry = entries_[i];
    return scaled - static_cast<double>(i) < double{entry.own} ? static_cast<uint32_t>(i)
                                                               : entry.other;
  }
  float probability(size_t cell) const { return probabilities_[cell]; }
  const std::vector<Entry>& entries() const { return entries_; }
  const std::vector<float>& probabilities() const { return probabilities_; }
  size_t memory() const { return entries_.size() * (sizeof(Entry) + sizeof(float)); }

 private:
  std::vector<Entry> entries_;
  std::vector<float> probabilities_;
};

// u = atan2(x, -z) / 2 pi wrapped to [0, 1).
inline double azimuth01(Vec3f d) {
  const double u =
      std::atan2(static_cast<double>(d.x), static_cast<double>(-d.z)) / (2 * std::numbers::pi);
  return u < 0 ? u + 1 : u;
}

// The sky, tabulated: the model's exponentials at every connection would cost as much as tracing
// it. A direction is found in the table without trigonometry. Columns are uniform in the diamond
// angle
//   a = side + x' / (x' + z'),   x', z' >= 0 the coordinates turned into side's quarter of the
//   plane,
// rows in s = sqrt(y), which straightens the model's rise towards the horizon. In between,
// bilinear: within 0.3 % of the model but for the last degree above the horizon and the cusp at the
// sun's centre.
class SkySource final : public LightSource {
 public:
  SkySource(const SunSkyLight& light, Vec3d sun, Channel channel)
      : values_(tabulate(light, sun, channel)), cells_(weights_or_uniform()) {}

  double radiance(Vec3f d) const override {
    if (d.y < 0) {
      return 0;
    }
    const Position p = locate(d);
    const auto at = [&](int column, int row) { return values_[index(column, row)]; };
    return std::lerp(std::lerp(at(p.column, p.row), at(p.column + 1, p.row), p.x),
                     std::lerp(at(p.column, p.row + 1), at(p.column + 1, p.row + 1), p.x), p.y);
  }
  // Within a cell uniform in a and s. With d omega = dy d phi, dy = 2 (1 - s) ds, and
  // d phi / da = 1 / (f^2 + (1 - f)^2) where f is the fraction of a.
  double pdf(Vec3f d) const override {
    if (d.y < 0) {
      return 0;
    }
    const Position p = locate(d);
    const float f = p.fraction;
    const float probability = cells_.probability(
        static_cast<size_t>(p.row / kMerged) * kCellColumns + p.column / kMerged);
    return probability * (kCellColumns / 4.0F) * kCellRows * (f * f + (1 - f) * (1 - f)) /
           std::max(2 * std::sqrt(1 - std::min(1.0F, d.y)), 1e-12F);
  }
  Vec3f sample([[maybe_unused]] double u, float u0, float u1) const override {
    const uint32_t cell = cells_.sample(u);
    const uint32_t column = cell % kCellColumns, row = cell / kCellColumns;
    const float a = (static_cast<float>(column) + u0) * (4.0F / kCellColumns);
    const float s = (static_cast<float>(row) + u1) / kCellRows;
    return direction(a, s);
  }
  double power() const override { return power_; }
  size_t memory() const override {
    return sizeof(*this) + values_.size() * sizeof(float) + cells_.memory();
  }

  static constexpr int kColumns = 256, kRows = 256;
  // Directions are drawn from larger cells, whose weights fit into the nearest cache.
  static constexpr int kMerged = 4, kCellColumns = kColumns / kMerged, kCellRows = kRows / kMerged;
  // By row and column; kRows + 1 rows.
  const std::vector<float>& values() const { return values_; }
  const AliasTable& cells() const { return cells_; }

 private:
  struct Position {
    int column, row;
    float x, y;      // within the cell
    float fraction;  // of the diamond angle
  };
  static size_t index(int column, int row) {
    return static_cast<size_t>(row) * kColumns + column % kColumns;
  }
  static Position locate(Vec3f d) {
    // Sides 0..3 begin at -z, +x, +z, -x: azimuth grows from -z towards +x.
    const float ax = std::abs(d.x), az = std::abs(d.z), sum = std::max(ax + az, 1e-30F);
    const int side = d.x >= 0 ? (d.z < 0 ? 0 : 1) : (d.z >= 0 ? 2 : 3);
    const float fraction = (side % 2 == 0 ? ax : az) / sum;
    const float x = (static_cast<float>(side) + fraction) * (kColumns / 4.0F);
    const float y = (1 - std::sqrt(1 - std::min(1.0F, d.y))) * kRows;
    const int column = std::min(static_cast<int>(x), kColumns - 1);
    const int row = std::min(static_cast<int>(y), kRows - 1);
    return {column, row, x - static_cast<float>(column), y - static_cast<float>(row), fraction};
  }
  static Vec3f direction(float a, float s) {
    const int side = std::min(static_cast<int>(a), 3);
    const float f = a - static_cast<float>(side);
    const float y = std::min(1.0F, s * (2 - s));
    // 1 - y^2 = (1 - s)^2 (1 + y).
    const float r = (1 - s) * std::sqrt((1 + y) / (f * f + (1 - f) * (1 - f)));
    switch (side) {
      case 0: return {r * f, y, -r * (1 - f)};
      case 1: return {r * (1 - f), y, r * f};
      case 2: return {-r * f, y, r * (1 - f)};
      default: return {-r * (1 - f), y, -r * f};
    }
  }

  // At the corners of the cells: kRows + 1 rows.
  static std::vector<float> tabulate(const SunSkyLight& light, Vec3d sun, Channel channel) {
    const Sky sky(light.turbidity, light.ground_albedo, light.sun_elevation);
    std::vector<float> values(static_cast<size_t>(kColumns) * (kRows + 1));
    for (int row = 0; row <= kRows; ++row) {
      for (int column = 0; column < kColumns; ++column) {
        const auto d = static_cast<Vec3d>(
            direction(static_cast<float>(column) * 4 / kColumns, static_cast<float>(row) / kRows));
        // The angle from the chord keeps its digits close to the sun, unlike acos.
        const double gamma = 2 * std::asin(std::min(1.0, length(d - sun) / 2));
        values[index(column, row)] = static_cast<float>(
            light.sky_scale * select(sky.radiance(std::max(0.0, d.y), gamma), channel));
      }
    }
    return values;
  }
  static double solid_angle(int column, int row) {
    const auto azimuth = [](int c) {
      const double a = 4.0 * c / kColumns, f = a - std::floor(a);
      return (std::floor(a) + std::atan2(f, 1 - f) / (std::numbers::pi / 2)) *
             (std::numbers::pi / 2);
    };
    const auto y = [](int r) {
      const double s = static_cast<double>(r) / kRows;
      return s * (2 - s);
    };
    return (azimuth(column + 1) - azimuth(column)) * (y(row + 1) - y(row));
  }
  // Power of every cell; where there is no light at all (a scale of 0), any distribution will do.
  std::vector<double> weights_or_uniform() {
    std::vector<double> weights(static_cast<size_t>(kCellColumns) * kCellRows);
    for (int row = 0; row < kRows; ++row) {
      for (int column = 0; column < kColumns; ++column) {
        const auto at = [&](int c, int r) { return static_cast<double>(values_[index(c, r)]); };
        const double power = (at(column, row) + at(column + 1, row) + at(column, row + 1) +
                              at(column + 1, row + 1)) /
                             4 * solid_angle(column, row);
        weights[static_cast<size_t>(row / kMerged) * kCellColumns + column / kMerged] += power;
        power_ += power;
      }
    }
    return power_ > 0 ? weights : std::vector<double>(weights.size(), 1.0);
  }

  double power_ = 0;
  std::vector<float> values_;
  AliasTable cells_;
};

class MapSource final : public LightSource {
 public:
  MapSource(const EnvironmentMapLight& light, Channel channel)
      : width_(light.width),
        height_(light.height),
        rotation01_(light.rotate_y / (2 * std::numbers::pi)),
        values_(static_cast<size_t>(width_) * height_) {
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
        throw invalid_input(fmt::format(
            "environment map: pixel ({}, {}) times scale is beyond the range of a float",
            i % width_, i / width_));
      }
    }
    weigh_pixels();
  }

  double radiance(Vec3f d) const override {
    const double x = map_u(d) * width_ - 0.5;
    const double y = map_v(d) * height_ - 0.5;
    const double fx = x - std::floor(x), fy = y - std::floor(y);
    const int column = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
    return std::lerp(std::lerp(value(column, row), value(column + 1, row), fx),
                     std::lerp(value(column, row + 1), value(column + 1, row + 1), fx), fy);
  }
  // Within a pixel uniform in azimuth and in y.
  double pdf(Vec3f d) const override {
    const int column = std::min(static_cast<int>(map_u(d) * width_), width_ - 1);
    const int row = std::clamp(static_cast<int>(map_v(d) * height_), 0, height_ - 1);
    return cells_->probability(static_cast<size_t>(row) * width_ + column) / solid_angle(row);
  }
  Vec3f sample([[maybe_unused]] double u, float u0, float u1) const override {
    const uint32_t cell = cells_->sample(u);
    const auto row = static_cast<int>(cell) / width_;
    const double azimuth = (cell % width_ + double{u0}) / width_ - rotation01_;
    const double y = std::lerp(edges_[row], edges_[row + 1], double{u1});
    const double r = std::sqrt(std::max(0.0, 1 - y * y));
    return static_cast<Vec3f>(Vec3d{r * std::sin(2 * std::numbers::pi * azimuth), y,
                                    -r * std::cos(2 * std::numbers::pi * azimuth)});
  }
  double power() const override { return power_; }
  size_t memory() const override {
    return sizeof(*this) + values_.size() * sizeof(float) + (cells_ ? cells_->memory() : 0);
  }

  int width() const { return width_; }
  int height() const { return height_; }
  double rotation01() const { return rotation01_; }
  const std::vector<float>& values() const { return values_; }
  const std::vector<double>& edges() const { return edges_; }
  const AliasTable& cells() const { return *cells_; }  // where the map has power

 private:
  // Counter-clockwise seen from above, azimuth falls (it grows from -z towards +x): a panorama
  // turned by r shows at azimuth u what stood at u + r.
  double map_u(Vec3f d) const {
    const double u = azimuth01(d) + rotation01_;
    return u - std::floor(u);
  }
  static double map_v(Vec3f d) {
    return std::acos(std::clamp(static_cast<double>(d.y), -1.0, 1.0)) / std::numbers::pi;
  }
  double value(int column, int row) const {
    column = (column % width_ + width_) % width_;
    row = std::clamp(row, 0, height_ - 1);
    return static_cast<double>(values_[static_cast<size_t>(row) * width_ + column]);
  }

  double solid_angle(int row) const {
    return 2 * std::numbers::pi / width_ * (edges_[row] - edges_[row + 1]);
  }

  // A pixel's weight is the average of the 3 x 3 values that bilinear interpolation reaches from
  // it, so that no direction with light has density 0.
  void weigh_pixels() {
    for (int row = 0; row <= height_; ++row) {
      edges_.push_back(std::cos(std::numbers::pi * row / height_));
    }
    std::vector<double> weights;
    for (int row = 0; row < height_; ++row) {
      for (int column = 0; column < width_; ++column) {
        double sum = 0;
        for (int i = 0; i < 9; ++i) {
          sum += value(column + i % 3 - 1, row + i / 3 - 1);
        }
        weights.push_back(sum / 9 * solid_angle(row));
        power_ += value(column, row) * solid_angle(row);
      }
    }
    if (power_ > 0) {
      cells_ = std::make_unique<AliasTable>(weights);
    }
  }

  int width_, height_;
  double rotation01_;
  std::vector<float> values_;
  double power_ = 0;
  std::vector<double> edges_;  // y at the edges of the rows, falling
  std::unique_ptr<AliasTable> cells_;
};

}  // namespace itn::tracer
