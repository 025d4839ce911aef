#include "server/tracer/lights/sky.h"

#include <algorithm>
#include <numbers>

#include "server/tracer/colour/channel.h"

namespace itn::tracer {
namespace {

constexpr int kColumns = SkyTable::kColumns, kRows = SkyTable::kRows;

size_t index(int column, int row) {
  return static_cast<size_t>(row) * kColumns + column % kColumns;
}

// The direction of the diamond angle a in [0, 4] and of s in [0, 1].
Vec3f direction(float a, float s) {
  const int side = std::min(static_cast<int>(a), 3);
  const float f = a - static_cast<float>(side);
  const float y = std::min(1.0F, s * (2 - s));
  // 1 - y^2 = (1 - s)^2 (1 + y).
  const float r = (1 - s) * std::sqrt((1 + y) / (f * f + (1 - f) * (1 - f)));
  switch (side) {
    case 0: return {r * f, y, -r * (1 - f)};
    case 1: return {r * (1 - f), y, r * f};
    case 2: return {-r * f, y, r * (1 - f)};
    default: return {-r * (1 - f), y, -r * f};
  }
}

double azimuth_of_column(int column) {
  const double a = 4.0 * column / kColumns, f = a - std::floor(a);
  return (std::floor(a) + std::atan2(f, 1 - f) / (std::numbers::pi / 2)) * (std::numbers::pi / 2);
}

double height_of_row(int row) {
  const double s = static_cast<double>(row) / kRows;
  return s * (2 - s);
}

// Radiances at the corners of the cells. The sky is the same on both sides of the sun.
std::vector<float> tabulate(const Sky& sky, double sun_elevation, Channel channel) {
  const Vec3d sun{0, std::sin(sun_elevation), -std::cos(sun_elevation)};
  std::vector<float> values(static_cast<size_t>(kColumns) * (kRows + 1));
  for (int row = 0; row <= kRows; ++row) {
    for (int column = 0; column <= kColumns / 2; ++column) {
      const auto d = static_cast<Vec3d>(
          direction(static_cast<float>(column) * 4 / kColumns, static_cast<float>(row) / kRows));
      // The angle from the chord keeps its digits close to the sun, unlike acos.
      const double gamma = 2 * std::asin(std::min(1.0, length(d - sun) / 2));
      values[index(column, row)] = values[index(kColumns - column, row)] =
          static_cast<float>(select(sky.radiance(std::max(0.0, d.y), gamma), channel));
    }
  }
  return values;
}

}  // namespace

SkyTable::SkyTable(double turbidity, double ground_albedo, double sun_elevation, Channel channel)
    : channel_(channel),
      sun_irradiance_(tracer::sun_irradiance(turbidity, sun_elevation)),
      values_(tabulate(Sky(turbidity, ground_albedo, sun_elevation), sun_elevation, channel)),
      cells_(weigh_cells()) {
  if (channel != Channel::kRgb) return;
  colours_.resize(kColours.size() * values_.size());
  for (size_t c = 0; c < kColours.size(); ++c) {
    const std::vector<float> own =
        tabulate(Sky(turbidity, ground_albedo, sun_elevation), sun_elevation, kColours[c]);
    for (size_t i = 0; i < own.size(); ++i) colours_[kColours.size() * i + c] = own[i];
  }
}

size_t SkyTable::memory() const {
  return sizeof(*this) + (values_.size() + colours_.size()) * sizeof(float) + cells_.memory();
}

// Power of every cell; where there is no light at all, any distribution will do.
std::vector<double> SkyTable::weigh_cells() {
  std::vector<double> weights(static_cast<size_t>(kCellColumns) * kCellRows), widths(kColumns);
  for (int column = 0; column < kColumns; ++column) {
    widths[column] = azimuth_of_column(column + 1) - azimuth_of_column(column);
  }
  for (int row = 0; row < kRows; ++row) {
    const double height = height_of_row(row + 1) - height_of_row(row);
    for (int column = 0; column < kColumns; ++column) {
      const auto at = [&](int c, int r) { return static_cast<double>(values_[index(c, r)]); };
      const double power =
          (at(column, row) + at(column + 1, row) + at(column, row + 1) + at(column + 1, row + 1)) /
          4 * widths[column] * height;
      weights[static_cast<size_t>(row / kMerged) * kCellColumns + column / kMerged] += power;
      power_ += power;
    }
  }
  return power_ > 0 ? weights : std::vector<double>(weights.size(), 1.0);
}

}  // namespace itn::tracer
