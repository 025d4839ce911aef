// The light of a clear sky, from a table.
#pragma once

#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "common/vec.h"
#include "server/tracer/lights/descriptions.h"
#include "server/tracer/lights/sky_model.h"
#include "server/tracer/random/alias_table.h"

namespace itn::tracer {

// The sky, tabulated: the model's exponentials at every look-up would cost as much as tracing it.
// The sun stands at azimuth 0, over -z, so that one table serves all azimuths.
//
// A direction is found in the table without trigonometry. Columns are uniform in the diamond angle
//   a = side + x' / (x' + z'),   x', z' >= 0 the coordinates turned into side's quarter of the
//   plane,
// rows in s = 1 - sqrt(1 - y), which straightens the model's rise towards the horizon. In between,
// bilinear: within 0.3 % of the model but for the last degree above the horizon and the cusp at the
// sun's centre.
class SkyTable {
 public:
  // Numbers in the ranges of SunSkyLight.
  SkyTable(double turbidity, double ground_albedo, double sun_elevation, Channel channel);

  double radiance_of(Vec3f d) const;
  double pdf(Vec3f d) const;
  Vec3f sample(double u, float u0, float u1) const;
  double power() const { return power_; }  // radiance integrated over all directions
  // On a surface that faces the sun.
  double sun_irradiance() const { return sun_irradiance_; }
  size_t memory() const;

  static constexpr int kColumns = 256, kRows = 256;
  // Directions are drawn from larger cells, whose weights fit into the nearest cache.
  static constexpr int kMerged = 4, kCellColumns = kColumns / kMerged, kCellRows = kRows / kMerged;
  // By row and column; kRows + 1 rows.
  const float* values() const { return values_.data(); }
  const AliasTable& cells() const { return cells_; }

 private:
  std::vector<double> weigh_cells();

  double sun_irradiance_;
  double power_ = 0;
  std::vector<float> values_;
  AliasTable cells_;
};

// See ConstantLight for what its functions mean.
class SkyLight {
 public:
  static constexpr bool kDelta = false;

  // `to_sky`: turns directions into those of the table.
  SkyLight(std::shared_ptr<const SkyTable> table, const Rotation<double>& to_sky, double scale)
      : table_(std::move(table)),
        to_sky_(to_sky),
        is_turned_(to_sky_ != Rotation<float>()),
        scale_(scale) {}

  double radiance_of(Vec3f d) const { return scale_ * table_->radiance_of(to_sky_(d)); }
  double pdf(Vec3f d) const { return table_->pdf(to_sky_(d)); }
  Vec3f sample(double u, float u0, float u1) const {
    return to_sky_.inverse()(table_->sample(u, u0, u1));
  }
  double power() const { return scale_ * table_->power(); }

  const SkyTable& table() const { return *table_; }
  const Rotation<float>& to_sky() const { return to_sky_; }
  // False where `to_sky` changes nothing, as for most skies: for a shorter way.
  bool is_turned() const { return is_turned_; }
  double scale() const { return scale_; }

 private:
  std::shared_ptr<const SkyTable> table_;
  Rotation<float> to_sky_;
  bool is_turned_;
  double scale_;
};

}  // namespace itn::tracer
