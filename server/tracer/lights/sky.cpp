#include "server/tracer/lights/sky.h"

#include <algorithm>
#include <numbers>

#include "server/tracer/lights/channel.h"

namespace itn::tracer {
namespace {

constexpr int kColumns = SkyTable::kColumns, kRows = SkyTable::kRows;

size_t index(int column, int row) {
  return static_cast<size_t>(row) * kColumns + column % kColumns;
}

// Where a direction is in the table.
struct Position {
  int column, row;
  float x, y;      // within the cell
  float fraction;  // of the diamond angle
};

Position locate(Vec3f d) {
  // Sides 0..3 begin at -z, +x, +z, -x: azimuth grows from -z towards +x.
  const float ax = std::abs(d.x), az = std::abs(d.z), sum = std::max(ax + az, 1e-30F);
  const int side = d.x >= 0 ? (d.z < 0 ? 0 : 1) : (d.z >= 0 ? 2 : 3);
  const float fraction = (side % 2 == 0 ? ax : az) / sum;
  const float x = (static_cast<float>(side) + fraction) * (kColumns / 4.0F);
  const float y = (1 - std::sqrt(1 - std::min(1.0F, d.y))) * kRows;
  const int column = std::min(static_cast<int>(x), kColumns - 1);
  const int row = std::min(static_cast<int>(y), kRows - 1);
  return {column, row, x - static_cast<float>(column), y - static_cast<float>(row), fraction};
}

// Of diamond angle a in [0, 4] and s in [0, 1].
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
    : sun_irradiance_(select(tracer::sun_irradiance(turbidity, sun_elevation), channel)),
      values_(tabulate(Sky(turbidity, ground_albedo, sun_elevation), sun_elevation, channel)),
      cells_(weigh_cells()) {}

double SkyTable::radiance_of(Vec3f d) const {
  if (d.y < 0) return 0;
  const Position p = locate(d);
  const auto at = [&](int column, int row) { return values_[index(column, row)]; };
  return std::lerp(std::lerp(at(p.column, p.row), at(p.column + 1, p.row), p.x),
                   std::lerp(at(p.column, p.row + 1), at(p.column + 1, p.row + 1), p.x), p.y);
}

// Within a cell uniform in a and s. With d omega = dy d phi, dy = 2 (1 - s) ds, and
// d phi / da = 1 / (f^2 + (1 - f)^2) where f is the fraction of a.
double SkyTable::pdf(Vec3f d) const {
  if (d.y < 0) return 0;
  const Position p = locate(d);
  const float f = p.fraction;
  const float probability =
      cells_.probability(static_cast<size_t>(p.row / kMerged) * kCellColumns + p.column / kMerged);
  return probability * (kCellColumns / 4.0F) * kCellRows * (f * f + (1 - f) * (1 - f)) /
         std::max(2 * std::sqrt(1 - std::min(1.0F, d.y)), 1e-12F);
}

Vec3f SkyTable::sample(double u, float u0, float u1) const {
  const uint32_t cell = cells_.sample(u);
  const uint32_t column = cell % kCellColumns, row = cell / kCellColumns;
  const float a = (static_cast<float>(column) + u0) * (4.0F / kCellColumns);
  const float s = (static_cast<float>(row) + u1) / kCellRows;
  return direction(a, s);
}

size_t SkyTable::memory() const {
  return sizeof(*this) + values_.size() * sizeof(float) + cells_.memory();
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
