#include "client/picture.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/image/image.h"
#include "common/image/preview.h"

namespace itn {
namespace {

using Rgb = std::array<unsigned char, 3>;

constexpr int kMinSide = 256;  // in pixels, of one panel
constexpr int kGap = 8;        // in pixels, between panels
constexpr float kFullColour =
    0.5F;  // of the white level: the difference that is shown in full colour

Rgb gray(float linear) {
  const unsigned char value = to_srgb_byte(linear);
  return {value, value, value};
}

// White at 0, red above, blue below.
Rgb diverging(float difference) {
  const float fade = 1 - std::min(std::abs(difference) / kFullColour, 1.0F);
  return difference > 0 ? Rgb{255, to_byte(fade), to_byte(fade)}
                        : Rgb{to_byte(fade), to_byte(fade), 255};
}

// An 8-bit image that panels are put into.
class Canvas {
 public:
  Canvas(int width, int height)
      : width_(width), height_(height), rgb_(static_cast<size_t>(width) * height * 3, 255) {}

  void enlarge_into(int left, int top, int scale, int resolution, const std::vector<Rgb>& panel) {
    for (int y = 0; y < resolution * scale; ++y) {
      for (int x = 0; x < resolution * scale; ++x) {
        const Rgb& colour = panel[static_cast<size_t>(y / scale) * resolution + x / scale];
        const size_t at = (static_cast<size_t>(top + y) * width_ + left + x) * 3;
        std::ranges::copy(colour, rgb_.begin() + static_cast<ptrdiff_t>(at));
      }
    }
  }

  void write(const std::filesystem::path& path) const { write_png(path, width_, height_, rgb_); }

 private:
  int width_, height_;
  std::vector<unsigned char> rgb_;
};

std::array<std::vector<Rgb>, 3> panels(const Comparison& comparison) {
  const float white = white_level(comparison.input);
  std::array<std::vector<Rgb>, 3> result;
  for (size_t p = 0; p < comparison.input.size(); ++p) {
    const float input = comparison.input[p] / white;
    const float rendered = comparison.rendered[p] / white;
    result[0].push_back(gray(input));
    result[1].push_back(gray(rendered));
    result[2].push_back(diverging(rendered - input));
  }
  return result;
}

}  // namespace

void write_comparison(const std::filesystem::path& path, int resolution,
                      std::span<const Comparison> rows) {
  const int scale = (kMinSide + resolution - 1) / resolution;
  const int step = resolution * scale + kGap;
  Canvas canvas(3 * step - kGap, static_cast<int>(rows.size()) * step - kGap);
  for (size_t row = 0; row < rows.size(); ++row) {
    const auto columns = panels(rows[row]);
    for (size_t column = 0; column < 3; ++column) {
      canvas.enlarge_into(static_cast<int>(column) * step, static_cast<int>(row) * step, scale,
                          resolution, columns[column]);
    }
  }
  canvas.write(path);
}

}  // namespace itn
