#include "client/dataset/studio.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "client/dataset/panorama.h"
#include "client/image/spectrum.h"
#include "common/angle.h"
#include "common/vec.h"

namespace itn {
namespace {

constexpr double kPi = std::numbers::pi;

// Pixels from top to bottom; even, so that none of them crosses the horizon.
uint32_t height_of(const v1::Studio& studio) {
  constexpr double kPixelsAcross = 4, kMinHeight = 64;
  double height = kMinHeight;
  for (const v1::Emitter& emitter : studio.emitters()) {
    const double shortest =
        static_cast<double>(emitter.size_degrees()) * (emitter.is_lamp() ? 1 : emitter.aspect());
    height = std::max(height, kPixelsAcross * 180 / shortest);
  }
  return 2 * static_cast<uint32_t>(std::ceil(height / 2));
}

// Sine and cosine of the middles of `count` equal parts of an angle.
struct Angles {
  Angles(uint32_t count, double angle) : sin(count), cos(count) {
    for (uint32_t i = 0; i < count; ++i) {
      sin[i] = std::sin((i + 0.5) * angle / count);
      cos[i] = std::cos((i + 0.5) * angle / count);
    }
  }
  std::vector<double> sin, cos;
};

// The directions of a panorama's pixels.
class Directions {
 public:
  Directions(uint32_t width, uint32_t height) : polar_(height, kPi), azimuth_(width, 2 * kPi) {}
  Vec3d operator()(size_t column, size_t row) const {
    return {polar_.sin[row] * azimuth_.sin[column], polar_.cos[row],
            -polar_.sin[row] * azimuth_.cos[column]};
  }

 private:
  Angles polar_, azimuth_;
};

// A flat emitter at distance 1, which is looked at through a plane there.
class FlatEmitter {
 public:
  explicit FlatEmitter(const v1::Emitter& emitter)
      : is_lamp_(emitter.is_lamp()),
        half_u_(std::tan(emitter.size_degrees() * kRadiansPerDegree / 2)),
        half_v_(is_lamp_
                    ? half_u_
                    : std::tan(emitter.size_degrees() * emitter.aspect() * kRadiansPerDegree / 2)),
        edge_(std::max(1e-6, emitter.edge() * half_v_)) {
    const double azimuth = emitter.azimuth_degrees() * kRadiansPerDegree;
    const double roll = emitter.roll_degrees() * kRadiansPerDegree;
    const Vec3d right{std::cos(azimuth), 0, std::sin(azimuth)};
    middle_ = direction_at(emitter.azimuth_degrees(), emitter.elevation_degrees());
    const Vec3d up = cross(right, middle_);
    u_ = right * std::cos(roll) + up * std::sin(roll);
    v_ = up * std::cos(roll) - right * std::sin(roll);
  }

  Vec3d middle() const { return middle_; }

  // From its middle to its farthest corner, in radians.
  double reach() const { return std::atan(is_lamp_ ? half_u_ : std::hypot(half_u_, half_v_)); }

  // Its radiance over that of its middle.
  double operator()(Vec3d direction) const {
    const double depth = dot(direction, middle_);
    if (depth <= 0) return 0;
    const double x = std::abs(dot(direction, u_)) / depth, y = std::abs(dot(direction, v_)) / depth;
    return is_lamp_ ? faded(half_u_ - std::hypot(x, y)) : faded(half_u_ - x) * faded(half_v_ - y);
  }

 private:
  // By the distance from the rim: a cubic step.
  double faded(double inside) const {
    const double t = std::clamp(inside / edge_, 0.0, 1.0);
    return t * t * (3 - 2 * t);
  }

  bool is_lamp_;
  double half_u_, half_v_, edge_;
  Vec3d middle_, u_, v_;
};

// A panorama while it is made.
struct Canvas {
  Canvas(uint32_t w, uint32_t h)
      : width(w),
        height(h),
        middles(w, h),
        samples(kSamples * w, kSamples * h),
        luminance(size_t{w} * h),
        radiance(size_t{w} * h) {
    for (uint32_t row = 0; row < h; ++row) rows.push_back(panorama_row(row, w, h));
  }

  static constexpr uint32_t kSamples = 3;  // along each side of a pixel
  uint32_t width, height;
  Directions middles, samples;
  std::vector<PanoramaRow> rows;
  // The emitters' light; their colours have a luminance of 1.
  std::vector<double> luminance;
  std::vector<std::array<double, 3>> radiance;
};

// The mean over the pixel.
double coverage(const FlatEmitter& emitter, const Canvas& canvas, uint32_t column, uint32_t row) {
  constexpr uint32_t n = Canvas::kSamples;
  double sum = 0;
  for (uint32_t i = 0; i < n * n; ++i) {
    sum += emitter(canvas.samples(n * column + i % n, n * row + i / n));
  }
  return sum / (n * n);
}

// So bright that it gives its strength to a surface that faces it.
void add(const v1::Emitter& choice, Canvas& canvas) {
  const FlatEmitter emitter(choice);
  const double pixel = kPi / canvas.height;
  const double near = std::cos(std::min(kPi, emitter.reach() + pixel));
  std::vector<std::pair<size_t, double>> covered;
  double irradiance = 0;
  for (uint32_t row = 0; row < canvas.height; ++row) {
    for (uint32_t column = 0; column < canvas.width; ++column) {
      const double cos_angle = dot(canvas.middles(column, row), emitter.middle());
      if (cos_angle < near) continue;
      const double part = coverage(emitter, canvas, column, row);
      irradiance += part * cos_angle * canvas.rows[row].solid_angle;
      covered.emplace_back(size_t{row} * canvas.width + column, part);
    }
  }
  const std::array<double, 3> colour = colour_of_black_body(choice.temperature());
  for (const auto& [place, part] : covered) {
    const double radiance = choice.strength() * part / irradiance;
    canvas.luminance[place] += radiance;
    for (size_t c = 0; c < 3; ++c) canvas.radiance[place][c] += radiance * colour[c];
  }
}

double irradiance_from_above(const Canvas& canvas) {
  double sum = 0;
  for (size_t i = 0; i < canvas.luminance.size(); ++i) {
    sum += canvas.luminance[i] * canvas.rows[i / canvas.width].from_above;
  }
  return sum;
}

}  // namespace

v1::Pixels studio_panorama(const v1::Studio& studio) {
  const uint32_t height = height_of(studio);
  Canvas canvas(2 * height, height);
  for (const v1::Emitter& emitter : studio.emitters()) add(emitter, canvas);
  // Each has its part of the irradiance.
  const double irradiance = studio.irradiance(), walls = studio.walls();
  const double factor = (1 - walls) * irradiance / irradiance_from_above(canvas);
  const double of_walls = walls * irradiance / kPi;
  const std::array<double, 3> colour = colour_of_black_body(studio.walls_temperature());
  std::vector<float> rgb;
  rgb.reserve(3 * canvas.radiance.size());
  for (const std::array<double, 3>& pixel : canvas.radiance) {
    for (size_t c = 0; c < 3; ++c) {
      rgb.push_back(static_cast<float>(of_walls * colour[c] + factor * pixel[c]));
    }
  }
  return panorama_of(canvas.width, canvas.height, rgb);
}

}  // namespace itn
