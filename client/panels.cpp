#include "client/panels.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "client/image/image.h"
#include "client/image/preview.h"

namespace itn {
namespace {

constexpr int kMinSide = 256;  // in pixels, of one panel
constexpr int kGap = 8;        // in pixels, between panels
constexpr float kFullColour =
    0.5F;  // of the white level: the difference that is shown in full colour

// An 8-bit image that panels are put into.
class Canvas {
 public:
  Canvas(int width, int height)
      : width_(width), height_(height), rgb_(static_cast<size_t>(width) * height * 3, 255) {}

  void enlarge_into(int left, int top, const Panel& panel) {
    const int scale = enlargement(panel.side);
    for (int y = 0; y < panel.side * scale; ++y) {
      for (int x = 0; x < panel.side * scale; ++x) {
        const Rgb& colour = panel.pixels[static_cast<size_t>(y / scale) * panel.side + x / scale];
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

// From the edge of a panel of this row to that of the next one.
int step_of(const PanelRow& row) {
  const int side = row.front().side;
  return side * enlargement(side) + kGap;
}

}  // namespace

Rgb gray(float linear) {
  const unsigned char value = to_srgb_byte(linear);
  return {value, value, value};
}

Rgb diverging(float difference) {
  const float fade = 1 - std::min(std::abs(difference) / kFullColour, 1.0F);
  return difference > 0 ? Rgb{255, to_byte(fade), to_byte(fade)}
                        : Rgb{to_byte(fade), to_byte(fade), 255};
}

PanelRow compared(std::span<const float> image, std::span<const float> render, int width,
                  int height, float white) {
  const auto side = static_cast<size_t>(std::max(width, height));
  const Panel empty{.side = static_cast<int>(side),
                    .pixels = std::vector<Rgb>(side * side, Rgb{255, 255, 255})};
  PanelRow panels(3, empty);
  for (size_t p = 0; p < image.size(); ++p) {
    const size_t at = p / width * side + p % width;
    panels[0].pixels[at] = gray(image[p] / white);
    panels[1].pixels[at] = gray(render[p] / white);
    panels[2].pixels[at] = diverging((render[p] - image[p]) / white);
  }
  return panels;
}

int enlargement(int side) {
  return (kMinSide + side - 1) / side;
}

void write_panels(const std::filesystem::path& path, std::span<const PanelRow> rows) {
  int width = 0, height = -kGap;
  for (const PanelRow& row : rows) {
    width = std::max(width, static_cast<int>(row.size()) * step_of(row) - kGap);
    height += step_of(row);
  }
  Canvas canvas(width, height);
  int top = 0;
  for (const PanelRow& row : rows) {
    int left = 0;
    for (const Panel& panel : row) {
      canvas.enlarge_into(left, top, panel);
      left += step_of(row);
    }
    top += step_of(row);
  }
  canvas.write(path);
}

std::string encode_png(const Panel& panel) {
  std::vector<unsigned char> rgb;
  rgb.reserve(panel.pixels.size() * 3);
  for (const Rgb& pixel : panel.pixels) rgb.insert(rgb.end(), pixel.begin(), pixel.end());
  return encode_png(panel.side, panel.side, rgb);
}

}  // namespace itn
