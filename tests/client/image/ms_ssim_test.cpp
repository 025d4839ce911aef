#include "client/image/ms_ssim.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/random.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using Pixels = std::vector<double>;

// Again, straight from the formulas: one window after the other.
class Slowly {
 public:
  Slowly() {
    double sum = 0;
    for (int y = -5; y <= 5; ++y) {
      for (int x = -5; x <= 5; ++x) sum += window_.emplace_back(std::exp(-(x * x + y * y) / 4.5));
    }
    for (double& w : window_) w /= sum;
  }

  double ms_ssim(int side, Pixels x, Pixels y) const {
    const std::vector<double> weights = {0.0448, 0.2856, 0.3001, 0.2363, 0.1333};
    const double range = *std::ranges::max_element(x);
    std::vector<std::pair<double, double>> scales;  // cs, l cs
    while (side >= 11 && scales.size() < 5) {
      scales.push_back(means(side, x, y, range));
      x = halved(side, x);
      y = halved(side, y);
      side /= 2;
    }
    double sum = 0, result = 1;
    for (size_t j = 0; j < scales.size(); ++j) sum += weights[j];
    for (size_t j = 0; j < scales.size(); ++j) {
      const bool last = j + 1 == scales.size();
      result *=
          std::pow(std::max(0.0, last ? scales[j].second : scales[j].first), weights[j] / sum);
    }
    return result;
  }

 private:
  std::pair<double, double> means(int side, const Pixels& x, const Pixels& y, double range) const {
    const double c1 = 1e-4 * range * range, c2 = 9e-4 * range * range;
    double cs = 0, whole = 0;
    int count = 0;
    for (int row = 5; row < side - 5; ++row) {
      for (int column = 5; column < side - 5; ++column) {
        double mx = 0, my = 0, xx = 0, yy = 0, xy = 0;
        for (int w = 0; w < 121; ++w) {
          const auto p = static_cast<size_t>((row + w / 11 - 5) * side + column + w % 11 - 5);
          const double weight = window_[static_cast<size_t>(w)];
          mx += weight * x[p];
          my += weight * y[p];
          xx += weight * x[p] * x[p];
          yy += weight * y[p] * y[p];
          xy += weight * x[p] * y[p];
        }
        const double l = (2 * mx * my + c1) / (mx * mx + my * my + c1);
        const double s = (2 * (xy - mx * my) + c2) / (xx - mx * mx + yy - my * my + c2);
        cs += s;
        whole += l * s;
        ++count;
      }
    }
    return {cs / count, whole / count};
  }

  static Pixels halved(int side, const Pixels& image) {
    Pixels half;
    for (int y = 0; y + 1 < side; y += 2) {
      for (int x = 0; x + 1 < side; x += 2) {
        const auto at = [&](int dy, int dx) {
          return image[static_cast<size_t>((y + dy) * side + x + dx)];
        };
        half.push_back((at(0, 0) + at(0, 1) + at(1, 0) + at(1, 1)) / 4);
      }
    }
    return half;
  }

  Pixels window_;
};

// Something with structure at all scales, and the same with noise.
std::pair<std::vector<float>, std::vector<float>> images(int side, double noise) {
  SplitMix random(static_cast<uint64_t>(side));
  std::vector<float> clean, noisy;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const double value = 3 + std::sin(0.9 * x) + std::cos(0.05 * x * y / side) + 0.02 * y;
      clean.push_back(static_cast<float>(value));
      noisy.push_back(static_cast<float>(value + noise * (random.uniform() - 0.5)));
    }
  }
  return {clean, noisy};
}

TEST(MsSsim, IsThatOfTheFormulas) {
  const Slowly slowly;
  for (const int side : {16, 46, 64, 128}) {
    for (const double noise : {0.3, 4.0}) {
      const auto [clean, noisy] = images(side, noise);
      const double expected =
          slowly.ms_ssim(side, {clean.begin(), clean.end()}, {noisy.begin(), noisy.end()});
      EXPECT_NEAR(ms_ssim(side, clean, noisy), expected, 1e-9) << side << " " << noise;
      EXPECT_GT(expected, 0.05);
      EXPECT_LT(expected, 0.999);
    }
  }
}

TEST(MsSsim, OfAnImageWithItselfIsOne) {
  const auto [clean, noisy] = images(64, 1);
  EXPECT_NEAR(ms_ssim(64, clean, clean), 1, 1e-12);
  EXPECT_LT(ms_ssim(64, clean, noisy), 1);
}

// All structure agrees, and of luminance the last of the five scales alone speaks.
TEST(MsSsim, OfEvenImagesIsTheirLuminance) {
  const std::vector<float> a(176 * 176, 2), b(176 * 176, 1.5F);
  const double c1 = 1e-4 * 4, l = (2 * 2 * 1.5 + c1) / (4 + 2.25 + c1);
  EXPECT_NEAR(ms_ssim(176, a, b), std::pow(l, 0.1333 / 1.0001), 1e-12);
}

TEST(MsSsim, DoesNotDependOnTheUnit) {
  auto [clean, noisy] = images(64, 1);
  const double before = ms_ssim(64, clean, noisy);
  for (float& value : clean) value *= 1024;
  for (float& value : noisy) value *= 1024;
  EXPECT_NEAR(ms_ssim(64, clean, noisy), before, 1e-12);
}

TEST(MsSsim, RefusesWhatItCannotCompare) {
  const std::vector<float> small(100, 1), large(256, 1), black(256);
  testing::expect_error(ErrorKind::kInvalidInput, {"too small"},
                        [&] { ms_ssim(10, small, small); });
  testing::expect_error(ErrorKind::kInvalidInput, {"100", "256", "16 x 16"},
                        [&] { ms_ssim(16, large, small); });
  testing::expect_error(ErrorKind::kInvalidInput, {"black"}, [&] { ms_ssim(16, black, large); });
}

}  // namespace
}  // namespace itn
