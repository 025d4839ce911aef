#include "server/tracer/lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "common/error.h"
#include "server/tracer/sky.h"

namespace itn::tracer {
namespace {

constexpr double kPi = std::numbers::pi;

// The part of a colour that is rendered.
double select(const Rgb& c, Channel channel) {
  switch (channel) {
    case Channel::kLuminance: return luminance(c);
    case Channel::kRed: return c[0];
    case Channel::kGreen: return c[1];
    case Channel::kBlue: return c[2];
  }
  return 0;
}

void check(const char* name, double value, double low, double high) {
  if (!(value >= low && value <= high)) {
    throw invalid_input(fmt::format("{} is {}; it must be in [{}, {}]", name, value, low, high));
  }
}

class UniformSource final : public LightSource {
 public:
  explicit UniformSource(double radiance) : radiance_(radiance) {}
  double radiance(Vec3f) const override { return radiance_; }
  double pdf(Vec3f) const override { return 1 / (4 * kPi); }
  Vec3f sample(float u0, float u1) const override {
    const float y = 1 - 2 * u0;
    const float r = std::sqrt(std::max(0.0F, 1 - y * y));
    const float phi = 2 * std::numbers::pi_v<float> * u1;
    return {r * std::cos(phi), y, r * std::sin(phi)};
  }
  double power() const override { return 4 * kPi * radiance_; }
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
        solid_angle_(2 * kPi * one_minus_cos_),
        radiance_(irradiance / solid_angle_) {}

  double radiance(Vec3f d) const override { return inside(d) ? radiance_ : 0; }
  double pdf(Vec3f d) const override { return inside(d) ? 1 / solid_angle_ : 0; }

  // With z = 1 - cos_theta uniform in [0, 1 - cos(half_angle)]; sin_theta = sqrt(z (2 - z)) holds
  // for a narrow sun too, where 1 - cos_theta^2 would cancel.
  Vec3f sample(float u0, float u1) const override {
    const float z = u0 * static_cast<float>(one_minus_cos_);
    const float sin_theta = std::sqrt(z * (2 - z));
    const float phi = 2 * std::numbers::pi_v<float> * u1;
    return itn::normalize(
        basis_.to_world(sin_theta * std::cos(phi), sin_theta * std::sin(phi), 1 - z));
  }
  double power() const override { return radiance_ * solid_angle_; }
  size_t memory() const override { return sizeof(*this); }

 private:
  // |d - axis|^2 = 2 (1 - cos_theta): no cancellation for a narrow sun.
  bool inside(Vec3f d) const {
    const Vec3f difference = d - basis_.n;
    return 0.5 * static_cast<double>(dot(difference, difference)) <= one_minus_cos_;
  }

  Basis<float> basis_;
  double one_minus_cos_, solid_angle_, radiance_;
};

// Directions drawn from a grid of cells, uniformly within a cell in azimuth and in y = cos_theta.
class CellDistribution {
 public:
  // `edges`: y at the rows' edges, falling; `weights`: expected power of every cell, row by row.
  CellDistribution(int columns, std::vector<double> edges, const std::vector<double>& weights)
      : columns_(columns), edges_(std::move(edges)), cumulative_(weights.size()) {
    double sum = 0;
    for (size_t i = 0; i < weights.size(); ++i) {
      sum += weights[i];
      cumulative_[i] = sum;
    }
    for (double& c : cumulative_) {
      c /= sum;
    }
  }

  double pdf(int column, int row) const {
    const size_t cell = index(column, row);
    const double probability = cumulative_[cell] - (cell > 0 ? cumulative_[cell - 1] : 0);
    return probability / (2 * kPi / columns_ * (edges_[row] - edges_[row + 1]));
  }

  // u = azimuth / 2 pi in [0, 1) and y.
  struct Point {
    double u, y;
  };
  Point sample(float u0, float u1) const {
    const auto found = std::upper_bound(cumulative_.begin(), cumulative_.end(), double{u0});
    const auto cell = std::min<size_t>(found - cumulative_.begin(), cumulative_.size() - 1);
    const double below = cell > 0 ? cumulative_[cell - 1] : 0;
    const double within = (double{u0} - below) / (cumulative_[cell] - below);
    const size_t row = cell / columns_;
    return {(static_cast<double>(cell % columns_) + within) / columns_,
            std::lerp(edges_[row], edges_[row + 1], double{u1})};
  }

  size_t memory() const { return cumulative_.size() * sizeof(double); }

 private:
  size_t index(int column, int row) const { return static_cast<size_t>(row) * columns_ + column; }

  int columns_;
  std::vector<double> edges_, cumulative_;
};

// u = atan2(x, -z) / 2 pi wrapped to [0, 1).
double azimuth01(Vec3f d) {
  const double u = std::atan2(static_cast<double>(d.x), static_cast<double>(-d.z)) / (2 * kPi);
  return u < 0 ? u + 1 : u;
}

Vec3f direction_of(CellDistribution::Point p) {
  const double r = std::sqrt(std::max(0.0, 1 - p.y * p.y));
  const double phi = 2 * kPi * p.u;
  return static_cast<Vec3f>(Vec3d{r * std::sin(phi), p.y, -r * std::cos(phi)});
}

class SkySource final : public LightSource {
 public:
  SkySource(const SunSkyLight& light, Vec3d sun, Channel channel)
      : sky_(light.turbidity, light.ground_albedo, light.sun_elevation),
        sun_(sun),
        channel_(channel),
        scale_(light.sky_scale),
        distribution_(make_distribution()) {}

  double radiance(Vec3f d) const override {
    if (d.y < 0) {
      return 0;
    }
    // The angle from the chord keeps its digits close to the sun, unlike acos.
    const double gamma = 2 * std::asin(std::min(1.0, length(static_cast<Vec3d>(d) - sun_) / 2));
    return scale_ * select(sky_.radiance(static_cast<double>(d.y), gamma), channel_);
  }
  double pdf(Vec3f d) const override {
    if (d.y < 0) {
      return 0;
    }
    const int column = std::min(static_cast<int>(azimuth01(d) * kColumns), kColumns - 1);
    const int row =
        std::clamp(static_cast<int>((1 - static_cast<double>(d.y)) * kRows), 0, kRows - 1);
    return distribution_.pdf(column, row);
  }
  Vec3f sample(float u0, float u1) const override {
    return direction_of(distribution_.sample(u0, u1));
  }
  double power() const override { return power_; }
  size_t memory() const override { return sizeof(*this) + distribution_.memory(); }

 private:
  static constexpr int kColumns = 64, kRows = 32;  // uniform in azimuth and in y

  // Cell weights from 4 x 4 points; a tenth of the average is added so that a cell between whose
  // points the radiance is larger does not yield outliers.
  CellDistribution make_distribution() {
    std::vector<double> edges(kRows + 1);
    for (int row = 0; row <= kRows; ++row) {
      edges[row] = 1 - static_cast<double>(row) / kRows;
    }
    constexpr int kPoints = 4;
    std::vector<double> weights(static_cast<size_t>(kColumns) * kRows);
    double total = 0;
    for (int row = 0; row < kRows; ++row) {
      for (int column = 0; column < kColumns; ++column) {
        double sum = 0;
        for (int i = 0; i < kPoints * kPoints; ++i) {
          const double u = (column + (i % kPoints + 0.5) / kPoints) / kColumns;
          const double y = 1 - (row + (i / kPoints + 0.5) / kPoints) / kRows;
          sum += radiance(direction_of({u, y}));
        }
        weights[static_cast<size_t>(row) * kColumns + column] = sum;
        total += sum;
      }
    }
    const double cells = kColumns * kRows;
    power_ = total / (cells * kPoints * kPoints) * 2 * kPi;
    for (double& w : weights) {
      w += 0.1 * total / cells;
    }
    return CellDistribution(kColumns, std::move(edges), weights);
  }

  Sky sky_;
  Vec3d sun_;
  Channel channel_;
  double scale_;
  double power_ = 0;
  CellDistribution distribution_;
};

class MapSource final : public LightSource {
 public:
  MapSource(const EnvironmentMapLight& light, Channel channel)
      : width_(light.width),
        height_(light.height),
        rotation01_(light.rotate_y / (2 * kPi)),
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
    }
    build_distribution();
  }

  double radiance(Vec3f d) const override {
    const double x = map_u(d) * width_ - 0.5;
    const double y = map_v(d) * height_ - 0.5;
    const double fx = x - std::floor(x), fy = y - std::floor(y);
    const int column = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
    return std::lerp(std::lerp(value(column, row), value(column + 1, row), fx),
                     std::lerp(value(column, row + 1), value(column + 1, row + 1), fx), fy);
  }
  double pdf(Vec3f d) const override {
    return distribution_->pdf(std::min(static_cast<int>(map_u(d) * width_), width_ - 1),
                              std::clamp(static_cast<int>(map_v(d) * height_), 0, height_ - 1));
  }
  Vec3f sample(float u0, float u1) const override {
    auto point = distribution_->sample(u0, u1);
    point.u -= rotation01_;
    return direction_of(point);
  }
  double power() const override { return power_; }
  size_t memory() const override {
    return sizeof(*this) + values_.size() * sizeof(float) + distribution_->memory();
  }

 private:
  // Counter-clockwise seen from above, azimuth falls (it grows from -z towards +x): a panorama
  // turned by r shows at azimuth u what stood at u + r.
  double map_u(Vec3f d) const {
    const double u = azimuth01(d) + rotation01_;
    return u - std::floor(u);
  }
  static double map_v(Vec3f d) {
    return std::acos(std::clamp(static_cast<double>(d.y), -1.0, 1.0)) / kPi;
  }
  double value(int column, int row) const {
    column = (column % width_ + width_) % width_;
    row = std::clamp(row, 0, height_ - 1);
    return static_cast<double>(values_[static_cast<size_t>(row) * width_ + column]);
  }

  // A pixel's weight is the average of the 3 x 3 values that bilinear interpolation reaches from
  // it, so that no direction with light has density 0.
  void build_distribution() {
    std::vector<double> edges(height_ + 1);
    for (int row = 0; row <= height_; ++row) {
      edges[row] = std::cos(kPi * row / height_);
    }
    std::vector<double> weights(values_.size());
    for (int row = 0; row < height_; ++row) {
      const double solid_angle = 2 * kPi / width_ * (edges[row] - edges[row + 1]);
      for (int column = 0; column < width_; ++column) {
        double sum = 0;
        for (int i = 0; i < 9; ++i) {
          sum += value(column + i % 3 - 1, row + i / 3 - 1);
        }
        weights[static_cast<size_t>(row) * width_ + column] = sum / 9 * solid_angle;
        power_ += value(column, row) * solid_angle;
      }
    }
    if (power_ > 0) {
      distribution_ = std::make_unique<CellDistribution>(width_, std::move(edges), weights);
    }
  }

  int width_, height_;
  double rotation01_;
  std::vector<float> values_;
  double power_ = 0;
  std::unique_ptr<CellDistribution> distribution_;
};

}  // namespace

Lights::Lights(const std::vector<LightDescription>& descriptions, Channel channel) {
  const auto add = [&](std::unique_ptr<LightSource> source) {
    const double power = source->power();
    if (power > 0) {
      choices_.push_back({.cumulative = 0, .probability = power, .source = std::move(source)});
    }
  };
  const auto add_sun_sky = [&](const SunSkyLight& light) {
    check("sun_sky.turbidity", light.turbidity, 1, 10);
    check("sun_sky.ground_albedo", light.ground_albedo, 0, 1);
    check("sun_sky.sun_elevation (radians)", light.sun_elevation, 0, kPi / 2 + 1e-6);
    check("sun_sky.sun_angular_radius (radians)", light.sun_angular_radius, 1e-4, kPi / 4 + 1e-6);
    check("sun_sky.sun_scale", light.sun_scale, 0, 1e6);
    check("sun_sky.sky_scale", light.sky_scale, 0, 1e6);
    const double cos_elevation = std::cos(light.sun_elevation);
    const Vec3d sun{std::sin(light.sun_azimuth) * cos_elevation, std::sin(light.sun_elevation),
                    -std::cos(light.sun_azimuth) * cos_elevation};
    add(std::make_unique<SkySource>(light, sun, channel));
    add(std::make_unique<ConeSource>(
        sun, light.sun_angular_radius,
        light.sun_scale * select(sun_irradiance(light.turbidity, light.sun_elevation), channel)));
  };
  const auto add_map = [&](const EnvironmentMapLight& light) {
    check("environment_map.scale", light.scale, 0, 1e6);
    if (light.width < 1 || light.height < 1 ||
        light.rgb.size() != 3 * static_cast<size_t>(light.width) * light.height) {
      throw invalid_input(fmt::format("environment map: {} x {} pixels do not go with {} numbers",
                                      light.width, light.height, light.rgb.size()));
    }
    add(std::make_unique<MapSource>(light, channel));
  };
  const auto add_beam = [&](const DirectionalBeam& light) {
    check("directional.irradiance", light.irradiance, 0, 1e9);
    if (!is_finite(light.direction) || !(length(light.direction) > 0)) {
      throw invalid_input("directional.direction must be finite and not zero");
    }
    if (light.irradiance > 0) {
      choices_.push_back({.cumulative = 0,
                          .probability = light.irradiance,
                          .source = nullptr,
                          .direction = static_cast<Vec3f>(itn::normalize(light.direction)),
                          .irradiance = light.irradiance});
    }
  };

  for (const LightDescription& description : descriptions) {
    if (const auto* sun_sky = std::get_if<SunSkyLight>(&description)) {
      add_sun_sky(*sun_sky);
    } else if (const auto* map = std::get_if<EnvironmentMapLight>(&description)) {
      add_map(*map);
    } else if (const auto* constant = std::get_if<ConstantEnvironment>(&description)) {
      check("constant.radiance", constant->radiance, 0, 1e9);
      add(std::make_unique<UniformSource>(constant->radiance));
    } else {
      add_beam(std::get<DirectionalBeam>(description));
    }
  }

  for (const Choice& choice : choices_) {
    power_ += choice.probability;
  }
  if (!(power_ > 0)) {
    throw invalid_input("nothing shines: a scene needs at least one light with radiance > 0");
  }
  double cumulative = 0;
  for (Choice& choice : choices_) {
    choice.probability /= power_;
    cumulative += choice.probability;
    choice.cumulative = cumulative;
  }
}

float Lights::radiance(Vec3f direction) const {
  double sum = 0;
  for (const Choice& choice : choices_) {
    if (choice.source) {
      sum += choice.source->radiance(direction);
    }
  }
  return static_cast<float>(sum);
}

float Lights::pdf(Vec3f direction) const {
  double sum = 0;
  for (const Choice& choice : choices_) {
    if (choice.source) {
      sum += choice.probability * choice.source->pdf(direction);
    }
  }
  return static_cast<float>(sum);
}

LightSample Lights::sample(float u0, float u1, float u2) const {
  auto choice = choices_.begin();
  while (choice + 1 != choices_.end() && double{u0} >= choice->cumulative) {
    ++choice;
  }
  if (!choice->source) {
    return {choice->direction, static_cast<float>(choice->irradiance / choice->probability), 0};
  }
  const Vec3f direction = choice->source->sample(u1, u2);
  const float density = pdf(direction);
  // A direction on the very rim of the sun may fall outside it by rounding.
  return {direction, density > 0 ? radiance(direction) / density : 0, density};
}

size_t Lights::memory() const {
  size_t sum = 0;
  for (const Choice& choice : choices_) {
    sum += sizeof(Choice) + (choice.source ? choice.source->memory() : 0);
  }
  return sum;
}

}  // namespace itn::tracer
