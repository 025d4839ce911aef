#include "client/fit/mirror_ball.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "common/vec.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

constexpr int kWidth = 480, kHeight = 360;
constexpr double kFocal = 900, kDown = 30;

// A smooth room, of directions with y up.
double radiance(Vec3d w) {
  return 2 + w.x + 0.5 * w.y * w.z + 0.3 * std::sin(3 * w.y) + 0.4 * w.x * w.z;
}

Vec3d to_room(Vec3d v) {
  const double angle = kDown * std::numbers::pi / 180, c = std::cos(angle), s = std::sin(angle);
  return {v.x, c * v.y + s * v.z, c * v.z - s * v.y};
}

struct Photograph {
  std::vector<float> radiance, mask;
};

// Along the rays of the camera to a ball and from it to the room.
Photograph photographed(Vec3d middle, double size) {
  constexpr int kFine = 4;
  Photograph result;
  for (int row = 0; row < kHeight; ++row) {
    for (int column = 0; column < kWidth; ++column) {
      double sum = 0, hits = 0;
      for (int k = 0; k < kFine * kFine; ++k) {
        const double x = column + (k % kFine + 0.5) / kFine, y = row + (k / kFine + 0.5) / kFine;
        const Vec3d d =
            normalize(Vec3d{(x - 0.5 * kWidth) / kFocal, (0.5 * kHeight - y) / kFocal, -1});
        const double along = dot(d, middle);
        const double square = along * along - dot(middle, middle) + size * size;
        if (square < 0) continue;
        const Vec3d n = (d * (along - std::sqrt(square)) - middle) * (1 / size);
        sum += radiance(to_room(d - n * (2 * dot(d, n))));
        ++hits;
      }
      result.radiance.push_back(static_cast<float>(hits > 0 ? sum / hits : 9));
      result.mask.push_back(static_cast<float>(hits / (kFine * kFine)));
    }
  }
  return result;
}

TEST(MirrorBall, ShowsTheRoom) {
  // Aside of the axis.
  const Vec3d middle{60, 40, -500};
  const Photograph photograph = photographed(middle, 45);
  const MirrorBall ball = ball_of_mask(photograph.mask, kWidth);
  EXPECT_NEAR(ball.x, 0.5 * kWidth + kFocal * middle.x / -middle.z, 2);
  EXPECT_NEAR(ball.y, 0.5 * kHeight - kFocal * middle.y / -middle.z, 2);
  constexpr int kRows = 32;
  const std::vector<float> panorama = panorama_of_ball(
      photograph.radiance, 1,
      {.width = kWidth, .height = kHeight, .focal = kFocal, .degrees_down = kDown}, ball, kRows);
  ASSERT_EQ(panorama.size(), size_t{2 * kRows * kRows});
  const Vec3d behind = to_room(normalize(middle));
  double worst = 0, squares = 0, count = 0;
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < 2 * kRows; ++column) {
      const double around = 2 * std::numbers::pi * ((column + 0.5) / (2 * kRows) - 0.5);
      const double polar = std::numbers::pi * (row + 0.5) / kRows;
      const Vec3d w{std::sin(around) * std::sin(polar), std::cos(polar),
                    -std::cos(around) * std::sin(polar)};
      constexpr double kHidden = 0.9;  // within 25 degrees of what is behind the ball
      if (dot(w, behind) > kHidden) continue;
      const double off = panorama[static_cast<size_t>(row * 2 * kRows + column)] / radiance(w) - 1;
      worst = std::max(worst, std::abs(off));
      squares += off * off;
      ++count;
    }
  }
  EXPECT_LT(std::sqrt(squares / count), 0.01);
  EXPECT_LT(worst, 0.06);
}

TEST(MirrorBall, IsRound) {
  std::vector<float> square(100 * 100, 0);
  testing::expect_error(ErrorKind::kInvalidInput, {"shows no ball"},
                        [&] { ball_of_mask(square, 100); });
  for (int y = 20; y < 60; ++y) {
    for (int x = 20; x < 60; ++x) square[static_cast<size_t>(100 * y + x)] = 1;
  }
  testing::expect_error(ErrorKind::kInvalidInput, {"40 x 40 pixels, of which 100 %"},
                        [&] { ball_of_mask(square, 100); });
}

}  // namespace
}  // namespace itn
