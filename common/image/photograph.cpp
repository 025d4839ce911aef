#include "common/image/photograph.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/error.h"

namespace itn {
namespace {

// The part of the frame that the object's longest side takes in the set-up of Che et al. 2020:
// 1 mm, of the 2 * 33.9 mm * tan(2.5 deg / 2) = 1.48 mm that the camera sees.
constexpr double kObjectFraction = 1 / 1.48;

void throw_if_stopped(const std::stop_token& stop) {
  if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "the prediction was cancelled");
}

std::span<const float> row_of(std::span<const float> values, int y, size_t per_row) {
  return values.subspan(static_cast<size_t>(y) * per_row, per_row);
}

void require_values(const char* what, std::span<const float> values, const Photograph& p,
                    int channels, float max, const std::stop_token& stop) {
  for (int y = 0; y < p.height; ++y) {
    throw_if_stopped(stop);
    const auto row = row_of(values, y, static_cast<size_t>(p.width) * channels);
    const auto bad = std::ranges::find_if(
        row, [max](float v) { return !(v >= 0 && v <= max) || !std::isfinite(v); });
    if (bad != row.end()) {
      throw invalid_input(fmt::format("{} is {} at pixel ({}, {}); it must be {}", what, *bad,
                                      (bad - row.begin()) / channels, y,
                                      max == 1 ? "in [0, 1]" : "finite and >= 0"));
    }
  }
}

// The extent of the pixels on the object.
struct Extent {
  int left, top, right, bottom;  // inclusive
};

Extent extent_of_object(const Photograph& p, const std::stop_token& stop) {
  Extent extent{p.width, p.height, -1, -1};
  for (int y = 0; y < p.height; ++y) {
    throw_if_stopped(stop);
    const auto row = row_of(p.mask, y, p.width);
    const auto first = std::ranges::find_if(row, is_on_object);
    if (first == row.end()) continue;
    const auto last = std::find_if(row.rbegin(), row.rend(), is_on_object);
    extent.left = std::min(extent.left, static_cast<int>(first - row.begin()));
    extent.right = std::max(extent.right, static_cast<int>(row.rend() - last) - 1);
    extent.top = std::min(extent.top, y);
    extent.bottom = y;
  }
  return extent;
}

// How the pixels of a line are shared out to the cells of a coarser one: this part of a pixel falls
// into this cell, the rest into the next.
struct Share {
  int cell;
  double part;
};

// Both lines are as long; there are no more cells than pixels. The last border is the end of both,
// however it is rounded.
std::vector<Share> shares(int pixels, int cells) {
  const double width = static_cast<double>(pixels) / cells;
  std::vector<Share> result;
  result.reserve(pixels);
  for (int x = 0; x < pixels; ++x) {
    const int cell = std::min(static_cast<int>(x / width), cells - 1);
    const bool is_last = cell + 1 == cells;
    result.push_back({cell, is_last ? 1 : std::clamp((cell + 1) * width - x, 0.0, 1.0)});
  }
  return result;
}

}  // namespace

void validate(const Photograph& p, const std::stop_token& stop) {
  constexpr int kMaxSide = 16384;
  if (p.width < 1 || p.width > kMaxSide || p.height < 1 || p.height > kMaxSide) {
    throw invalid_input(fmt::format("the image is {} x {} pixels; each side must be in [1, {}]",
                                    p.width, p.height, kMaxSide));
  }
  if (p.channels != 1 && p.channels != 3) {
    throw invalid_input(fmt::format("the image has {} channels; it must have 1 or 3", p.channels));
  }
  const size_t pixels = static_cast<size_t>(p.width) * p.height;
  if (p.pixels.size() != pixels * p.channels) {
    throw invalid_input(fmt::format("the image has {} values; {} x {} x {} channels need {}",
                                    p.pixels.size(), p.width, p.height, p.channels,
                                    pixels * p.channels));
  }
  if (p.mask.size() != pixels) {
    throw invalid_input(fmt::format("the mask has {} values; {} x {} pixels need {}", p.mask.size(),
                                    p.width, p.height, pixels));
  }
  require_values("image", p.pixels, p, p.channels, HUGE_VALF, stop);
  require_values("mask", p.mask, p, 1, 1, stop);
  if (std::ranges::none_of(p.mask, is_on_object)) {
    throw invalid_input("the mask is empty; it must be above 0.5 on the object");
  }
  bool black = true;
  for (int channel = 0; black && channel < p.channels; ++channel) {
    black = is_black(p, channel, stop);
  }
  if (black) throw invalid_input("the image is black wherever the mask says that the object is");
}

bool is_black(const Photograph& p, int channel, const std::stop_token& stop) {
  for (int y = 0; y < p.height; ++y) {
    throw_if_stopped(stop);
    const auto mask = row_of(p.mask, y, p.width);
    const auto pixels = row_of(p.pixels, y, static_cast<size_t>(p.width) * p.channels);
    for (int x = 0; x < p.width; ++x) {
      if (is_on_object(mask[x]) && pixels[static_cast<size_t>(x) * p.channels + channel] > 0) {
        return false;
      }
    }
  }
  return true;
}

bool reaches_edge(const Photograph& p, const std::stop_token& stop) {
  const Extent object = extent_of_object(p, stop);
  return object.left == 0 || object.top == 0 || object.right == p.width - 1 ||
         object.bottom == p.height - 1;
}

Square frame(const Photograph& p, Framing framing, const std::stop_token& stop) {
  if (framing == Framing::kSquareWhole && p.width == p.height) return {0, 0, p.width};
  const Extent object = extent_of_object(p, stop);
  const int width = object.right - object.left + 1;
  const int height = object.bottom - object.top + 1;
  const int side = static_cast<int>(std::lround(std::max(width, height) / kObjectFraction));
  return {object.left + (width - side) / 2, object.top + (height - side) / 2, side};
}

namespace {

// Part of an image; it may reach beyond.
struct Window {
  int left = 0, top = 0, width = 0, height = 0;
};

// Without ever holding the whole of the window: each row of the photograph is averaged along
// itself, and added to the one or two rows of the result that it is a part of.
std::vector<float> averaged(std::span<const float> values, int channels, int width,
                            const Window& window, int columns, int rows,
                            const std::stop_token& stop) {
  const int height = static_cast<int>(values.size()) / channels / width;
  const std::vector<Share> across = shares(window.width, columns);
  const std::vector<Share> down = shares(window.height, rows);
  const size_t row_size = static_cast<size_t>(columns) * channels;
  std::vector<double> sums(row_size * rows), row_sums(row_size);
  const int left = std::max(0, window.left), right = std::min(width, window.left + window.width);
  const int top = std::max(0, window.top), bottom = std::min(height, window.top + window.height);
  for (int y = top; y < bottom; ++y) {
    throw_if_stopped(stop);
    // Along the row.
    std::ranges::fill(row_sums, 0);
    const float* value = &values[(static_cast<size_t>(y) * width + left) * channels];
    for (int x = left; x < right; ++x) {
      const auto [cell, part] = across[x - window.left];
      double* sum = &row_sums[static_cast<size_t>(cell) * channels];
      for (int c = 0; c < channels; ++c, ++value) {
        sum[c] += part * *value;
        if (part < 1) sum[c + channels] += (1 - part) * *value;
      }
    }
    // Into the result.
    const auto [cell, part] = down[y - window.top];
    for (size_t i = 0; i < row_size; ++i) {
      double* sum = &sums[cell * row_size + i];
      *sum += part * row_sums[i];
      if (part < 1) sum[row_size] += (1 - part) * row_sums[i];
    }
  }
  const double area =
      (static_cast<double>(window.width) / columns) * (static_cast<double>(window.height) / rows);
  std::vector<float> result(sums.size());
  std::ranges::transform(sums, result.begin(),
                         [area](double sum) { return static_cast<float>(sum / area); });
  return result;
}

}  // namespace

std::vector<float> averaged(std::span<const float> values, int channels, int width,
                            const Square& square, int side, const std::stop_token& stop) {
  const Window window{square.left, square.top, square.side, square.side};
  return averaged(values, channels, width, window, side, side, stop);
}

std::vector<float> averaged(std::span<const float> values, int channels, int width, int columns,
                            int rows, const std::stop_token& stop) {
  const int height = static_cast<int>(values.size()) / channels / width;
  return averaged(values, channels, width, Window{0, 0, width, height}, columns, rows, stop);
}

FramedPhotograph framed(const Photograph& photograph, const std::stop_token& stop,
                        Framing framing) {
  const Square square = frame(photograph, framing, stop);
  const int side = std::min(square.side, kMaxFrameSide);
  const auto at_side = [&](std::span<const float> values, int channels) {
    return averaged(values, channels, photograph.width, square, side, stop);
  };
  return {side, photograph.channels, at_side(photograph.pixels, photograph.channels),
          at_side(photograph.mask, 1), square};
}

}  // namespace itn
