#include "client/fit/mirror_ball.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "common/angle.h"
#include "common/error.h"
#include "common/image/photograph.h"
#include "common/vec.h"

namespace itn {
namespace {

// The ball in the coordinates of its camera, at a distance of 1.
class Ball {
 public:
  Ball(const BallCamera& camera, const MirrorBall& outline)
      : focal_(camera.focal), center_x_(0.5 * camera.width), center_y_(0.5 * camera.height) {
    // The two tangents in the plane of the axis and the middle of the outline.
    const double right = outline.x - center_x_, down = outline.y - center_y_;
    const double off = std::hypot(right, down);
    const double near = std::atan((off - outline.radius) / focal_);
    const double far = std::atan((off + outline.radius) / focal_);
    radius_ = std::sin((far - near) / 2);
    const double away = std::tan((near + far) / 2);
    const double per_pixel = off > 0 ? away / off : 0;
    towards_ = normalize(Vec3d{right * per_pixel, -down * per_pixel, -1});
  }

  struct Pixel {
    double x, y;
  };

  // The pixel that shows what comes from the direction `w`.
  Pixel place_of(Vec3d w) const {
    constexpr int kIterations = 8;
    Vec3d d = towards_, n{};
    for (int i = 0; i < kIterations; ++i) {
      n = visible(w - d, d);
      d = normalize(towards_ + n * radius_);
    }
    return {center_x_ + focal_ * d.x / -d.z, center_y_ - focal_ * d.y / -d.z};
  }

 private:
  // A normal that is no farther from the middle of what is seen than the outermost hundredth.
  static Vec3d visible(Vec3d direction, Vec3d d) {
    constexpr double kOutermost = 0.99;  // of the radius
    const Vec3d n = normalize(direction);
    const double ahead = -dot(n, d);
    if (ahead * ahead >= 1 - kOutermost * kOutermost) return n;
    const Vec3d across = n + d * ahead;
    const double size = length(across);
    const Vec3d aside = size > 0 ? across * (1 / size) : normalize(cross(d, Vec3d{0, 1, 0}));
    return aside * kOutermost - d * std::sqrt(1 - kOutermost * kOutermost);
  }

  double focal_, center_x_, center_y_;
  Vec3d towards_{};
  double radius_ = 0;  // over the distance
};

// Adds what is seen there to a sum for each channel.
void add_interpolated(std::span<const float> pixels, const BallCamera& camera, double x, double y,
                      std::vector<double>& sums) {
  const double u = std::clamp(x - 0.5, 0.0, camera.width - 1.0);
  const double v = std::clamp(y - 0.5, 0.0, camera.height - 1.0);
  const int left = std::min(static_cast<int>(u), std::max(0, camera.width - 2));
  const int top = std::min(static_cast<int>(v), std::max(0, camera.height - 2));
  const int right = std::min(left + 1, camera.width - 1);
  const int bottom = std::min(top + 1, camera.height - 1);
  const double a = u - left, b = v - top;
  for (size_t channel = 0; channel < sums.size(); ++channel) {
    const auto at = [&](int column, int row) {
      const auto p = static_cast<size_t>(row) * static_cast<size_t>(camera.width) +
                     static_cast<size_t>(column);
      return double{pixels[p * sums.size() + channel]};
    };
    sums[channel] += (1 - b) * ((1 - a) * at(left, top) + a * at(right, top)) +
                     b * ((1 - a) * at(left, bottom) + a * at(right, bottom));
  }
}

}  // namespace

MirrorBall ball_of_mask(std::span<const float> mask, int width) {
  double area = 0, x = 0, y = 0;
  int left = width, right = -1, top = -1, bottom = -1;
  for (size_t p = 0; p < mask.size(); ++p) {
    const int column = static_cast<int>(p % static_cast<size_t>(width));
    const int row = static_cast<int>(p / static_cast<size_t>(width));
    const double part{mask[p]};
    area += part;
    x += part * (column + 0.5);
    y += part * (row + 0.5);
    if (!is_on_object(mask[p])) continue;
    left = std::min(left, column);
    right = std::max(right, column);
    top = top < 0 ? row : top;
    bottom = row;
  }
  if (right < 0) throw invalid_input("the mask shows no ball");
  constexpr double kRound = 1.05;
  const double wide = right - left + 1, tall = bottom - top + 1;
  const double disc = std::numbers::pi / 4 * wide * tall;
  if (std::max(wide, tall) > kRound * std::min(wide, tall) + 2 || area > kRound * disc ||
      disc > kRound * area + 4 * std::max(wide, tall)) {
    throw invalid_input(fmt::format(
        "the mask shows no ball: {:.0f} x {:.0f} pixels, of which {:.0f} % are covered; of a disc "
        "79 % are, and it is as wide as high",
        wide, tall, 100 * area / (wide * tall)));
  }
  return {x / area, y / area, std::sqrt(area / std::numbers::pi)};
}

std::vector<float> panorama_of_ball(std::span<const float> radiance, int channels,
                                    const BallCamera& camera, const MirrorBall& ball, int rows) {
  constexpr int kSamples = 4;  // along each side of a pixel
  const Ball in_camera(camera, ball);
  const double down = camera.degrees_down * kRadiansPerDegree;
  const double c = std::cos(down), s = std::sin(down);
  const int columns = 2 * rows;
  std::vector<float> panorama;
  std::vector<double> sums(static_cast<size_t>(channels));
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      std::ranges::fill(sums, 0);
      for (int j = 0; j < kSamples; ++j) {
        for (int i = 0; i < kSamples; ++i) {
          const double u = (column + (i + 0.5) / kSamples) / columns;
          const double v = (row + (j + 0.5) / kSamples) / rows;
          const double around = 2 * std::numbers::pi * (u - 0.5), polar = std::numbers::pi * v;
          const Vec3d w{std::sin(around) * std::sin(polar), std::cos(polar),
                        -std::cos(around) * std::sin(polar)};
          const auto [x, y] = in_camera.place_of({w.x, c * w.y - s * w.z, s * w.y + c * w.z});
          add_interpolated(radiance, camera, x, y, sums);
        }
      }
      for (const double sum : sums) {
        panorama.push_back(static_cast<float>(sum / (kSamples * kSamples)));
      }
    }
  }
  return panorama;
}

}  // namespace itn
