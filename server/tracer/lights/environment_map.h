// The light of a panorama.
#ifndef ITN_TRACER_LIGHTS_ENVIRONMENT_MAP_H_
#define ITN_TRACER_LIGHTS_ENVIRONMENT_MAP_H_

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/vec.h"
#include "server/tracer/lights/light_frame.h"
#include "server/tracer/random/alias_table.h"

namespace itn::tracer {

class EnvironmentMap;

// Latitude-longitude panorama, u = atan2(x, -z) / 2 pi, v = acos(y) / pi, bilinear.
struct EnvironmentMapLight {
  int width = 0;
  int height = 0;
  std::vector<float> rgb;  // 3 * width * height, top row first
  double scale = 1;
  double rotate_y = 0;
  // The digest of the pixels, for scenes that share them; empty: not shared.
  std::string digest = {};

  // The largest pixel times scale, where a sun may be far above all else. Its fourth power is a
  // float's.
  static constexpr double kMaxRadiance = 1e9;

  static constexpr const char* kName = "environment_map";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.number("scale", self.scale, 0, 1e6);
    to.angle("rotate_y_degrees", self.rotate_y);
    to.pixels("pixels", self);
  }
  EnvironmentMap compile(const LightFrame& frame) const;
};

// Radiances of a panorama's pixels, in its own orientation, and how directions are drawn.
class EnvironmentMapTable {
 public:
  // Throws Error (invalid input) if the pixels are not finite and >= 0, or above
  // EnvironmentMapLight::kMaxRadiance when scaled.
  EnvironmentMapTable(const EnvironmentMapLight& light, Channel channel);

  double power() const { return power_; }
  double scale() const { return scale_; }  // of the radiances, by which pixels are multiplied
  size_t memory() const;

  int width() const { return width_; }
  int height() const { return height_; }
  size_t pixels() const { return values_.size(); }
  const float* values() const { return values_.data(); }
  // The same of each colour, for kRgb.
  const RgbTable& colours() const { return colours_; }
  // y at the edges of the rows, falling; and of a pixel, by row, 1 / solid angle.
  const float* edges() const { return edges_.data(); }
  const float* inverse_angles() const { return inverse_angles_.data(); }
  const AliasTable& cells() const { return *cells_; }  // where the map has power

 private:
  double value(int column, int row) const;
  void weigh_pixels();

  int width_, height_;
  double scale_;
  std::vector<float> values_, edges_, inverse_angles_;
  RgbTable colours_;
  double power_ = 0;
  std::optional<AliasTable> cells_;
};

class EnvironmentMap {
 public:
  static constexpr bool kDelta = false, kDistant = true;

  // `to_map`: turns directions into those of the table.
  EnvironmentMap(std::shared_ptr<const EnvironmentMapTable> table, const Rotation<double>& to_map)
      : table_(std::move(table)), to_map_(to_map) {}

  double power() const { return table_->power(); }

  const EnvironmentMapTable& table() const { return *table_; }
  const Rotation<float>& to_map() const { return to_map_; }

 private:
  std::shared_ptr<const EnvironmentMapTable> table_;
  Rotation<float> to_map_;
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_LIGHTS_ENVIRONMENT_MAP_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_ENVIRONMENT_MAP_MATHS_
#undef ITN_TRACER_LIGHTS_ENVIRONMENT_MAP_MATHS_
#else
#define ITN_TRACER_LIGHTS_ENVIRONMENT_MAP_MATHS_
#endif

#include "server/tracer/lights/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// The place where the map is looked up: its pixel at (u, v), and the four pixels between whose
// middles that is, at the fractions fx and fy, numbered row by row.
struct MapPlace {
  Floats u, v, fx, fy;
  Ints upper[2], lower[2];
};
HWY_INLINE MapPlace place_of(const EnvironmentMap& light, Vectors direction) {
  const EnvironmentMapTable& map = light.table();
  const Vectors d = rotated(light.to_map(), direction);
  const Floats zero = hn::Zero(FloatTag());
  const Floats width = set(static_cast<float>(map.width()));
  const Floats height = set(static_cast<float>(map.height()));
  const Floats u = atan2_turns(d.x, -d.z);
  const Floats across = hn::Sqrt(mul_add(d.z, d.z, d.x * d.x));
  const Floats v = 2 * atan2_turns(across, d.y);

  const Floats x = u * width - 0.5F, y = v * height - 0.5F;
  const Floats column = hn::Floor(x), row = hn::Floor(y);
  const Floats fx = x - column, fy = y - row;
  const auto wrapped = [&](Floats c) {
    c = hn::IfThenElse(c < 0, c + width, c);
    return to_int(hn::IfThenElse(c >= width, c - width, c));
  };
  const auto start = [&](Floats r) {
    return to_int(hn::Clamp(r, zero, height - 1)) * hn::Set(IntTag(), map.width());
  };
  const Ints c0 = wrapped(column), c1 = wrapped(column + 1);
  const Ints r0 = start(row), r1 = start(row + 1);
  return {u, v, fx, fy, {r0 + c0, r0 + c1}, {r1 + c0, r1 + c1}};
}

// The radiance by the table of a channel, whose values lie so far apart.
HWY_INLINE Floats radiance_at(const MapPlace& at, const float* values, int stride = 1) {
  const auto value = [&](Ints pixel) { return gather(values, pixel * hn::Set(IntTag(), stride)); };
  return mix(mix(value(at.upper[0]), value(at.upper[1]), at.fx),
             mix(value(at.lower[0]), value(at.lower[1]), at.fx), at.fy);
}

HWY_INLINE InColours colours(const EnvironmentMap& light, Vectors direction) {
  const MapPlace at = place_of(light, direction);
  InColours result;
  for (size_t c = 0; c < kColours.size(); ++c) {
    result.radiance[c] = radiance_at(at, light.table().colours().data() + c, 3);
  }
  return result;
}

HWY_INLINE Emission emission(const EnvironmentMap& light, Vectors direction) {
  const EnvironmentMapTable& map = light.table();
  const MapPlace place = place_of(light, direction);
  const Floats radiance = radiance_at(place, map.values());

  const Floats zero = hn::Zero(FloatTag());
  const Floats width = set(static_cast<float>(map.width()));
  const Floats height = set(static_cast<float>(map.height()));
  const Floats pixel_row = hn::Clamp(hn::Floor(place.v * height), zero, height - 1);
  const Ints pixel_column = to_int(hn::Min(hn::Floor(place.u * width), width - 1));
  const Floats probability =
      gather(map.cells().probabilities(),
             to_int(pixel_row) * hn::Set(IntTag(), map.width()) + pixel_column);
  const Floats pdf = probability * gather(map.inverse_angles(), to_int(pixel_row));
  return {radiance, pdf};
}

HWY_INLINE Vectors sample(const EnvironmentMap& light, const LightUniforms& u) {
  const Words& words = u.more;
  const Floats u0 = u.u0, u1 = u.u1;
  const EnvironmentMapTable& map = light.table();
  // A pixel of n from 64 bits: the upper half of their product with n.
  const auto n = static_cast<uint32_t>(map.width()) * static_cast<uint32_t>(map.height());
  const WideProduct high = multiply(words.w[0], n), low = multiply(words.w[1], n);
  const Uints sum = high.low + low.high;
  const Uints carry = hn::IfThenElseZero(sum < high.low, set(uint32_t{1}));
  const Ints first = hn::BitCast(IntTag(), high.high + carry);
  const Ints pixel = draw(map.cells().entries(), first, uniform(words.w[2]));
  // Row and column by a division that rounding may have put off by one.
  const Ints width = hn::Set(IntTag(), map.width()), one = hn::Set(IntTag(), 1);
  Ints row = to_int(to_float(pixel) * (1.0F / static_cast<float>(map.width())));
  Ints column = pixel - row * width;
  const auto under = column < hn::Zero(IntTag());
  row = hn::IfThenElse(under, row - one, row);
  column = hn::IfThenElse(under, column + width, column);
  const auto over = hn::Not(column < width);
  row = hn::IfThenElse(over, row + one, row);
  column = hn::IfThenElse(over, column - width, column);

  const Floats turn = (to_float(column) + u0) * (1.0F / static_cast<float>(map.width()));
  const Floats y = mix(gather(map.edges(), row), gather(map.edges() + 1, row), u1);
  const Floats r = hn::Sqrt(hn::Max(hn::Zero(FloatTag()), (1 - y) * (1 + y)));
  const SinCos azimuth = sin_cos_2pi(turn);
  return renormalize(rotated_back(light.to_map(), {r * azimuth.sin, y, -(r * azimuth.cos)}));
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
