#include "client/contact_sheet.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "common/image/image.h"
#include "common/image/preview.h"

namespace itn {
namespace {

constexpr int kSamples = 3;  // of a pixel, along a side

// x to the right, y up, z towards the viewer, who looks down at the middle of a shape's space.
Vec3f seen(Vec3f p) {
  constexpr float kTurn = 0.5F, kTilt = 0.45F;  // radians
  static const float kCosTurn = std::cos(kTurn), kSinTurn = std::sin(kTurn);
  static const float kCosTilt = std::cos(kTilt), kSinTilt = std::sin(kTilt);
  const float across = kCosTurn * p.x + kSinTurn * p.z, along = kCosTurn * p.z - kSinTurn * p.x;
  return {across, kCosTilt * p.y - kSinTilt * along, kSinTilt * p.y + kCosTilt * along};
}

// A square of depths and shades.
class Square {
 public:
  explicit Square(int pixels)
      : size_(pixels * kSamples),
        depth_(static_cast<size_t>(size_) * size_, -std::numeric_limits<float>::infinity()),
        shade_(depth_.size(), 1) {}

  void draw(const Mesh& mesh) {
    // In the middle; what fits into a cube fits into a square of its diagonal.
    constexpr float kWidth = 1.5F;
    std::vector<Vec3f> corners;
    Vec3f low{kWidth, kWidth, 0}, high{-kWidth, -kWidth, 0};
    for (const Vec3f p : mesh.vertices) {
      corners.push_back(seen(p));
      low = {std::min(low.x, corners.back().x), std::min(low.y, corners.back().y), 0};
      high = {std::max(high.x, corners.back().x), std::max(high.y, corners.back().y), 0};
    }
    const Vec3f middle = (low + high) * 0.5F;
    const float scale = static_cast<float>(size_) / kWidth, half = static_cast<float>(size_) / 2;
    for (Vec3f& p : corners) {
      p = {half + (p.x - middle.x) * scale, half - (p.y - middle.y) * scale, p.z * scale};
    }
    for (const auto& [a, b, c] : mesh.triangles) draw(corners[a], corners[b], corners[c]);
  }

  // Of a pixel, linear.
  float shade(int x, int y) const {
    float sum = 0;
    for (int dy = 0; dy < kSamples; ++dy) {
      for (int dx = 0; dx < kSamples; ++dx) sum += shade_[at(x * kSamples + dx, y * kSamples + dy)];
    }
    return sum / (kSamples * kSamples);
  }

 private:
  size_t at(int x, int y) const { return static_cast<size_t>(y) * size_ + x; }

  // In pixels, y downwards.
  void draw(Vec3f a, Vec3f b, Vec3f c) {
    const Vec3f normal = cross(b - a, c - a);  // counter-clockwise has it point away, y downwards
    if (!(normal.z < 0)) return;
    const float lit = lightness(normalize(Vec3f{-normal.x, normal.y, -normal.z}));
    const auto first = [](float v) { return std::max(0, static_cast<int>(std::ceil(v - 0.5F))); };
    const auto last = [this](float v) {
      return std::min(size_ - 1, static_cast<int>(std::floor(v - 0.5F)));
    };
    for (int y = first(std::min({a.y, b.y, c.y})); y <= last(std::max({a.y, b.y, c.y})); ++y) {
      for (int x = first(std::min({a.x, b.x, c.x})); x <= last(std::max({a.x, b.x, c.x})); ++x) {
        const Vec3f p{static_cast<float>(x) + 0.5F, static_cast<float>(y) + 0.5F, 0};
        const auto side = [&](Vec3f from, Vec3f to) {
          return (to.x - from.x) * (p.y - from.y) - (to.y - from.y) * (p.x - from.x);
        };
        const float u = side(b, c), v = side(c, a), w = side(a, b);
        if (u > 0 || v > 0 || w > 0) continue;
        const float depth = (u * a.z + v * b.z + w * c.z) / normal.z;
        if (depth <= depth_[at(x, y)]) continue;
        depth_[at(x, y)] = depth;
        shade_[at(x, y)] = lit;
      }
    }
  }

  // Of a diffuse surface under a lamp and a bright sky.
  static float lightness(Vec3f normal) {
    const Vec3f lamp = normalize(Vec3f{-0.6F, 0.7F, 0.7F});
    return 0.08F + 0.55F * std::max(0.0F, dot(normal, lamp)) + 0.12F * (normal.y + 1);
  }

  int size_;
  std::vector<float> depth_, shade_;
};

}  // namespace

void write_contact_sheet(const std::filesystem::path& path, size_t count, size_t columns, int side,
                         const std::function<Mesh(size_t)>& shape) {
  const size_t rows = (count + columns - 1) / columns;
  const size_t width = std::min(count, columns) * side;
  std::vector<unsigned char> rgb(width * rows * side * 3, 255);
  for (size_t i = 0; i < count; ++i) {
    Square square(side);
    square.draw(shape(i));
    for (int y = 0; y < side; ++y) {
      for (int x = 0; x < side; ++x) {
        const size_t at = (i / columns * side + y) * width + i % columns * side + x;
        std::fill_n(rgb.begin() + static_cast<ptrdiff_t>(3 * at), 3,
                    to_srgb_byte(square.shade(x, y)));
      }
    }
  }
  write_png(path, static_cast<int>(width), static_cast<int>(rows * side), rgb);
}

}  // namespace itn
