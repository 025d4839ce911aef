// Images that are stored on their side, or mirrored.
#pragma once

#include <cstddef>

namespace itn {

// Tells where the pixels of an upright image are in the one that the file holds.
class Upright {
 public:
  // TIFF 6.0, tag 274: which side of the scene the file's first row and first column are.
  Upright(int orientation, int width, int height)
      : orientation_(orientation), width_(width), height_(height) {}

  int width() const { return swaps() ? height_ : width_; }
  int height() const { return swaps() ? width_ : height_; }

  size_t source(int x, int y) const {
    const int u = swaps() ? y : x, v = swaps() ? x : y;
    // 2: from the right; 3: from the right, bottom first; 4: bottom first; 5 to 8: columns for
    // rows.
    const bool from_right =
        orientation_ == 2 || orientation_ == 3 || orientation_ == 7 || orientation_ == 8;
    const bool from_bottom =
        orientation_ == 3 || orientation_ == 4 || orientation_ == 6 || orientation_ == 7;
    const int column = from_right ? width_ - 1 - u : u;
    const int row = from_bottom ? height_ - 1 - v : v;
    return static_cast<size_t>(row) * static_cast<size_t>(width_) + static_cast<size_t>(column);
  }

  // Calls f(pixel, source pixel) for every pixel.
  template <typename F>
  void for_each(const F& f) const {
    size_t pixel = 0;
    for (int y = 0; y < height(); ++y) {
      for (int x = 0; x < width(); ++x) f(pixel++, source(x, y));
    }
  }

 private:
  bool swaps() const { return orientation_ >= 5; }

  int orientation_;
  int width_;
  int height_;
};

}  // namespace itn
