// The light of a panorama.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "common/vec.h"
#include "server/tracer/lights/descriptions.h"
#include "server/tracer/random/alias_table.h"

namespace itn::tracer {

// Radiances of a panorama's pixels, in its own orientation, and how directions are drawn.
class EnvironmentMapTable {
 public:
  // Throws Error (invalid input) if the pixels are not finite and >= 0, or beyond a float when
  // scaled.
  EnvironmentMapTable(const EnvironmentMapLight& light, Channel channel);

  double radiance_of(Vec3f d) const;
  double pdf(Vec3f d) const;
  Vec3f sample(double u, float u0, float u1) const;
  double power() const { return power_; }
  size_t memory() const;

  int width() const { return width_; }
  int height() const { return height_; }
  const float* values() const { return values_.data(); }
  // y at the edges of the rows, falling; and of a pixel, by row, 1 / solid angle.
  const float* edges() const { return edges_.data(); }
  const float* inverse_angles() const { return inverse_angles_.data(); }
  const AliasTable& cells() const { return *cells_; }  // where the map has power

 private:
  double value(int column, int row) const;
  void weigh_pixels();

  int width_, height_;
  std::vector<float> values_, edges_, inverse_angles_;
  double power_ = 0;
  std::optional<AliasTable> cells_;
};

// See ConstantLight for what its functions mean.
class EnvironmentMap {
 public:
  static constexpr bool kDelta = false;

  // `to_map`: turns directions into those of the table.
  EnvironmentMap(std::shared_ptr<const EnvironmentMapTable> table, const Rotation<double>& to_map)
      : table_(std::move(table)), to_map_(to_map) {}

  double radiance_of(Vec3f d) const { return table_->radiance_of(to_map_(d)); }
  double pdf(Vec3f d) const { return table_->pdf(to_map_(d)); }
  Vec3f sample(double u, float u0, float u1) const {
    return to_map_.inverse()(table_->sample(u, u0, u1));
  }
  double power() const { return table_->power(); }

  const EnvironmentMapTable& table() const { return *table_; }
  const Rotation<float>& to_map() const { return to_map_; }

 private:
  std::shared_ptr<const EnvironmentMapTable> table_;
  Rotation<float> to_map_;
};

}  // namespace itn::tracer
