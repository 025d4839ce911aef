#include "client/dataset/ground_texture.h"

#include <algorithm>
#include <vector>

#include "common/random.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace {

// In [0, 1).
float number_of(uint64_t bits) {
  return static_cast<float>(bits >> 40) * 0x1p-24F;
}

// Adds `amplitude` times random numbers on a lattice of so many cells a side.
void add_octave(uint64_t seed, uint32_t cells, float amplitude, std::vector<float>& values) {
  std::vector<float> lattice;
  for (uint64_t i = 0; i < uint64_t{cells} * cells; ++i) {
    lattice.push_back(number_of(derive_seed(seed, {cells, i})));
  }
  const uint32_t pixels_per_cell = kTexturePixels / cells;
  // The cell before a pixel's middle, and how far it is to the next, smoothed.
  const auto place = [&](uint32_t pixel) {
    const float part =
        (static_cast<float>(pixel % pixels_per_cell) + 0.5F) / static_cast<float>(pixels_per_cell);
    return std::pair{pixel / pixels_per_cell, part * part * (3 - 2 * part)};
  };
  for (uint32_t y = 0; y < kTexturePixels; ++y) {
    const auto [row, down] = place(y);
    for (uint32_t x = 0; x < kTexturePixels; ++x) {
      const auto [column, right] = place(x);
      const auto at = [&, row = row, column = column](uint32_t r, uint32_t c) {
        return lattice[(row + r) % cells * cells + (column + c) % cells];
      };
      const float upper = at(0, 0) + right * (at(0, 1) - at(0, 0));
      const float lower = at(1, 0) + right * (at(1, 1) - at(1, 0));
      values[y * kTexturePixels + x] += amplitude * (upper + down * (lower - upper));
    }
  }
}

}  // namespace

v1::Pixels mottled(const v1::GroundTexture& texture) {
  std::vector<float> values(size_t{kTexturePixels} * kTexturePixels);
  float amplitude = 1;
  for (uint32_t cells = 4; cells <= kTexturePixels / 2; cells *= 2) {
    add_octave(texture.seed(), cells, amplitude, values);
    amplitude *= texture.persistence();
  }
  const auto [low, high] = std::ranges::minmax(values);
  std::vector<float> rgb;
  for (const float value : values) {
    const float part = (value - low) / (high - low);
    const float reflectance =
        texture.reflectance() + part * (texture.other_reflectance() - texture.reflectance());
    rgb.insert(rgb.end(), 3, std::clamp(reflectance, 0.0F, 1.0F));
  }
  v1::Pixels pixels;
  pixels.set_width(kTexturePixels);
  pixels.set_height(kTexturePixels);
  pixels.set_rgb(to_bytes(rgb));
  return pixels;
}

}  // namespace itn
