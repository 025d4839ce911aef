#include "client/render/tiles.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "common/error.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace {

// Work of a tile: a few tenths of a second of work, far more than a request costs.
constexpr double kSamplesPerTile = 1 << 18;
// On a side, so that the pilot's margin is little against the tile, and no image has too many.
constexpr double kMinSide = 16;

// The place where part i of n begins.
uint32_t begin_of(uint32_t i, uint32_t n, uint32_t length) {
  return static_cast<uint32_t>(uint64_t{length} * i / n);
}

// Float32, not of pixels: those of all tiles are added up.
void add_numbers(const std::string& part, std::string& sum) {
  if (!sum.empty() && part.size() != sum.size()) {
    throw Error(ErrorKind::kInternal, "gradients of tiles are of several sizes");
  }
  if (sum.empty()) {
    sum = part;
    return;
  }
  std::vector<float> numbers = from_bytes<float>(sum);
  const std::vector<float> further = from_bytes<float>(part);
  for (size_t i = 0; i < numbers.size(); ++i) numbers[i] += further[i];
  sum = to_bytes(numbers);
}

}  // namespace

v1::Tile pixels_of(const RenderJob& job) {
  if (job.request.has_tile()) return job.request.tile();
  v1::Tile film;
  film.set_width(job.scene->width);
  film.set_height(job.scene->height);
  return film;
}

std::vector<v1::Tile> tiles_of(const v1::Tile& whole, uint32_t spp, uint32_t most) {
  const double side = std::max(std::sqrt(kSamplesPerTile / std::max(spp, 1U)), kMinSide);
  const auto number = [&](uint32_t length) {
    return std::min(most, static_cast<uint32_t>(std::max(1.0, std::round(length / side))));
  };
  const uint32_t columns = number(whole.width()), rows = number(whole.height());
  std::vector<v1::Tile> tiles;
  for (uint32_t row = 0; row < rows; ++row) {
    for (uint32_t column = 0; column < columns; ++column) {
      const uint32_t x = begin_of(column, columns, whole.width());
      const uint32_t y = begin_of(row, rows, whole.height());
      v1::Tile& tile = tiles.emplace_back();
      tile.set_x(whole.x() + x);
      tile.set_y(whole.y() + y);
      tile.set_width(begin_of(column + 1, columns, whole.width()) - x);
      tile.set_height(begin_of(row + 1, rows, whole.height()) - y);
    }
  }
  return tiles;
}

void TiledReply::add(const v1::Tile& tile, const v1::RenderGradReply& part) {
  reply_.set_width(whole_.width());
  reply_.set_height(whole_.height());
  while (reply_.estimates_size() < part.estimates_size()) reply_.add_estimates();
  for (int k = 0; k < part.estimates_size(); ++k) {
    const v1::Estimate& from = part.estimates(k);
    v1::Estimate& to = *reply_.mutable_estimates(k);
    copy(tile, from.radiance(), *to.mutable_radiance());
    copy(tile, from.derivatives(), *to.mutable_derivatives());
    copy(tile, from.at_albedos(), *to.mutable_at_albedos());
    copy(tile, from.colours(), *to.mutable_colours());
    while (to.gradient_size() < from.gradient_size()) to.add_gradient(0);
    for (int i = 0; i < from.gradient_size(); ++i) {
      to.set_gradient(i, to.gradient(i) + from.gradient(i));
    }
    add_numbers(from.light_gradient(), *to.mutable_light_gradient());
    add_numbers(from.normal_gradient(), *to.mutable_normal_gradient());
  }
  copy(tile, part.colour_standard_errors(), *reply_.mutable_colour_standard_errors());
  copy(tile, part.mask(), *reply_.mutable_mask());
  copy(tile, part.standard_error(), *reply_.mutable_standard_error());
  add_counters(part.counters(), *reply_.mutable_counters());
}

void add_counters(const v1::Counters& from, v1::Counters& to) {
  to.set_paths(to.paths() + from.paths());
  to.set_steps(to.steps() + from.steps());
  to.set_invalid_samples(to.invalid_samples() + from.invalid_samples());
  to.set_leaks(to.leaks() + from.leaks());
  to.set_cpu_seconds(to.cpu_seconds() + from.cpu_seconds());
}

void TiledReply::copy(const v1::Tile& tile, const Images& parts, Images& images) const {
  while (images.size() < parts.size()) images.Add();
  for (int i = 0; i < parts.size(); ++i) copy(tile, parts[i], images[i]);
}

// Row by row, float32.
void TiledReply::copy(const v1::Tile& tile, const std::string& part, std::string& image) const {
  image.resize(size_t{whole_.width()} * whole_.height() * sizeof(float));
  const size_t bytes = tile.width() * sizeof(float);
  for (uint32_t y = 0; y < tile.height(); ++y) {
    const size_t to = size_t{tile.y() - whole_.y() + y} * whole_.width() + tile.x() - whole_.x();
    part.copy(image.data() + to * sizeof(float), bytes, y * bytes);
  }
}

}  // namespace itn
