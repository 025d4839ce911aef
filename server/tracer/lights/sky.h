// The light of a clear sky, from a table.
#ifndef ITN_TRACER_LIGHTS_SKY_H_
#define ITN_TRACER_LIGHTS_SKY_H_

#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "common/vec.h"
#include "server/tracer/colour/channel.h"
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

  double power() const { return power_; }  // radiance integrated over all directions
  // On a surface that faces the sun.
  double sun_irradiance() const { return select(sun_irradiance_, channel_); }
  const Rgb& sun_colours() const { return sun_irradiance_; }
  size_t memory() const;

  static constexpr int kColumns = 256, kRows = 256;
  // Directions are drawn from larger cells, whose weights fit into the nearest cache.
  static constexpr int kMerged = 4, kCellColumns = kColumns / kMerged, kCellRows = kRows / kMerged;
  // By row and column; kRows + 1 rows.
  const float* values() const { return values_.data(); }
  // The same of each colour, for kRgb.
  const RgbTable& colours() const { return colours_; }
  const AliasTable& cells() const { return cells_; }

 private:
  std::vector<double> weigh_cells();

  Channel channel_;
  Rgb sun_irradiance_;
  double power_ = 0;
  std::vector<float> values_;
  RgbTable colours_;
  AliasTable cells_;
};

class SkyLight {
 public:
  static constexpr bool kDelta = false, kDistant = true;

  // `to_sky`: turns directions into those of the table.
  SkyLight(std::shared_ptr<const SkyTable> table, const Rotation<double>& to_sky, double scale)
      : table_(std::move(table)),
        to_sky_(to_sky),
        is_turned_(to_sky_ != Rotation<float>()),
        scale_(scale) {}

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

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && defined(ITN_TRACER_LIGHTS_SKY_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_SKY_MATHS_
#undef ITN_TRACER_LIGHTS_SKY_MATHS_
#else
#define ITN_TRACER_LIGHTS_SKY_MATHS_
#endif

#include "server/tracer/lights/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The place of a direction in the table: between the corners `here` and `beside` and those a row
// above, at the fractions fx and fy; and what else is known of it.
struct SkyPlace {
  Ints here, beside;
  Floats fx, fy;
  Floats column, row, fraction, per_below;  // `fraction` of a, and 1 / (2 - 2 s)
  Mask up;
};
HWY_INLINE SkyPlace place_of(const SkyLight& sky, Vectors direction) {
  const Vectors d = sky.is_turned() ? rotated(sky.to_sky(), direction) : direction;
  constexpr int kColumns = SkyTable::kColumns, kRows = SkyTable::kRows;
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  // Sides 0..3 begin at -z, +x, +z, -x.
  const Floats ax = hn::Abs(d.x), az = hn::Abs(d.z);
  const Floats sum = hn::Max(ax + az, set(1e-12F));
  const Mask right = d.x >= 0, front = d.z < 0;
  const Mask even = !(right ^ front);  // sides 0 and 2
  const Floats side = hn::IfThenElse(right, hn::IfThenElse(front, zero, one),
                                     hn::IfThenElse(front, set(3.0F), set(2.0F)));
  const Floats below = hn::Sqrt(1 - hn::Clamp(d.y, zero, one));
  const Floats twice_below = hn::Max(below + below, set(1e-12F));
  // One division, which is slow, serves for both.
  const Floats per_both = 1 / (sum * twice_below);
  const Floats per_sum = twice_below * per_both, per_below = sum * per_both;
  const Floats fraction = hn::Min(one, hn::IfThenElse(even, ax, az) * per_sum);
  const Floats x = (side + fraction) * (kColumns / 4.0F);
  const Floats y = (1 - below) * static_cast<float>(kRows);
  const Floats column = hn::Min(hn::Floor(x), set(kColumns - 1.0F));
  const Floats row = hn::Min(hn::Floor(y), set(kRows - 1.0F));
  const Floats next = hn::IfThenElseZero(column < kColumns - 1.0F, column + 1);
  const Floats start = row * static_cast<float>(kColumns);
  const Ints here = to_int(start + column), beside = to_int(start + next);
  return {here, beside, x - column, y - row, column, row, fraction, per_below, d.y >= 0};
}

// The radiance by the table of a channel, whose values lie so far apart.
HWY_INLINE Floats radiance_at(const SkyLight& sky, const SkyPlace& place, const float* values,
                              int stride = 1) {
  const float* const above = values + ptrdiff_t{stride} * SkyTable::kColumns;
  const Ints by = hn::Set(IntTag(), stride);
  const Ints here = place.here * by, beside = place.beside * by;
  const Floats radiance = mix(mix(gather(values, here), gather(values, beside), place.fx),
                              mix(gather(above, here), gather(above, beside), place.fx), place.fy);
  return hn::IfThenElseZero(place.up, radiance * static_cast<float>(sky.scale()));
}

HWY_INLINE Emission emission(const SkyLight& sky, Vectors direction) {
  const SkyTable& table = sky.table();
  const SkyPlace place = place_of(sky, direction);
  // Within a cell uniform in a and s. With d omega = dy d phi, dy = 2 (1 - s) ds, and
  // d phi / da = 1 / (f^2 + (1 - f)^2) where f is the fraction of a.
  const Floats cell = mul_add(hn::Floor(place.row * (1.0F / SkyTable::kMerged)),
                              set(static_cast<float>(SkyTable::kCellColumns)),
                              hn::Floor(place.column * (1.0F / SkyTable::kMerged)));
  const Floats probability = gather(table.cells().probabilities(), to_int(cell));
  const Floats rest = 1 - place.fraction;
  const Floats stretch = mul_add(rest, rest, place.fraction * place.fraction);
  const Floats pdf = probability * stretch *
                     ((SkyTable::kCellColumns / 4.0F) * SkyTable::kCellRows) * place.per_below;
  return {radiance_at(sky, place, table.values()), hn::IfThenElseZero(place.up, pdf)};
}
HWY_INLINE InColours colours(const SkyLight& sky, Vectors direction) {
  const SkyPlace at = place_of(sky, direction);
  InColours result;
  for (size_t c = 0; c < kColours.size(); ++c) {
    result.radiance[c] = radiance_at(sky, at, sky.table().colours().data() + c, 3);
  }
  return result;
}

// Draws a cell, and within it uniformly in a and s. With 1 - y^2 = (1 - s)^2 (1 + y), and f the
// fraction of a, the horizontal part has the length (1 - s) sqrt(1 + y).
HWY_INLINE Vectors sample(const SkyLight& sky, const LightUniforms& u) {
  const auto& [cell01, coin, u0, u1, more] = u;
  constexpr float kColumns = SkyTable::kCellColumns, kRows = SkyTable::kCellRows;
  const Floats one = set(1.0F), zero = hn::Zero(FloatTag());
  const Floats cell =
      to_float(draw(sky.table().cells().entries(), to_int(cell01 * (kColumns * kRows)), coin));
  const Floats row = hn::Floor(cell * (1 / kColumns));
  const Floats column = cell - row * kColumns;
  const Floats a = (column + u0) * (4 / kColumns);
  const Floats s = (row + u1) * (1 / kRows);
  const Floats side = hn::Min(hn::Floor(a), set(3.0F));
  const Floats f = a - side, rest = 1 - f;
  const Floats y = hn::Min(one, s * (2 - s));
  const Floats r = (1 - s) * hn::Sqrt((1 + y) / mul_add(rest, rest, f * f));
  const Floats rf = r * f, rr = r * rest;
  // Quarter turns of (r f, -r (1 - f)).
  const Mask odd = hn::Eq(side, one) | hn::Eq(side, set(3.0F));
  const Mask left = side >= 2;
  const Mask back = (side >= 1) & (side < 3);  // z >= 0
  const Floats x = hn::IfThenElse(odd, rr, rf), z = hn::IfThenElse(odd, rf, rr);
  const Vectors d{hn::IfThenElse(left, zero - x, x), y, hn::IfThenElse(back, z, zero - z)};
  return sky.is_turned() ? rotated_back(sky.to_sky(), d) : d;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
