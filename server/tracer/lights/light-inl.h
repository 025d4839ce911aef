// What the lights of this folder share when they are evaluated many directions at a time.
#if defined(ITN_TRACER_LIGHTS_LIGHT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_LIGHT_INL_H_
#undef ITN_TRACER_LIGHTS_LIGHT_INL_H_
#else
#define ITN_TRACER_LIGHTS_LIGHT_INL_H_
#endif

#include "server/tracer/colour/channel.h"
#include "server/tracer/random/alias_table.h"
#include "server/tracer/random/philox-inl.h"
#include "server/tracer/simd/kinds-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// What arrives from directions: radiance, and the density per steradian with which they are drawn.
struct Emission {
  Floats radiance, pdf;
};

// Radiance in red, green and blue.
struct InColours {
  Floats radiance[kColours.size()];
};

// How a lamp is seen in directions: how far it is, in mm, or infinite; and what it sends.
struct Appearance {
  Floats distance;
  Emission emission;
};

// It, where it is met; else nothing.
HWY_INLINE Appearance where(Mask met, const Appearance& appearance) {
  return {hn::IfThenElse(met, appearance.distance, set(kInfinity)),
          {hn::IfThenElseZero(met, appearance.emission.radiance),
           hn::IfThenElseZero(met, appearance.emission.pdf)}};
}

// A direction that is drawn towards a lamp, and how that is seen there.
struct LampDraw {
  Vectors direction;
  Appearance appearance;
};

// What a delta sends to places: from which direction, how far from there, in mm, infinite if it is
// distant; and its irradiance as a multiple of power().
struct Beam {
  Vectors direction;
  Floats distance, irradiance;
};

// What comes from a place, alike in all directions; multiples of that at `distance2`, a distance in
// mm, squared.
HWY_INLINE Beam beam_from(Vectors place, double distance2, Vectors from) {
  const Vectors to = place - from;
  const Floats d2 = hn::Max(dot(to, to), set(1e-20F)), distance = hn::Sqrt(d2);
  return {to * (1 / distance), distance, static_cast<float>(distance2) / d2};
}

// A place of the outline of a light: its direction, and how far it is, in mm, or infinite. And how
// much the solid angle that the light is seen in grows there, by each coordinate of the light's
// place (in mm) or unit direction, over the density with which the pair was drawn.
struct Outline {
  Vectors direction;
  Floats distance;
  Vectors growth;
  Floats radiance;  // of the light there
};

// What a direction, or a place of a lamp, is drawn by: uniform numbers in [0, 1), for a cell, a
// coin and a place within; and the words of another counter, which are there if a light is a map.
struct LightUniforms {
  Floats cell, coin, u0, u1;
  Words more;
};

// Directions turned by a rotation, and back.
HWY_INLINE Vectors rotated(const Rotation<float>& r, Vectors d) {
  return {dot(set(r.x), d), dot(set(r.y), d), dot(set(r.z), d)};
}
HWY_INLINE Vectors rotated_back(const Rotation<float>& r, Vectors d) {
  return rotated(r.inverse(), d);
}

// Drawn from an alias table: i of n, unless a coin turns it into another.
HWY_INLINE Ints draw(const AliasTable::Entry* entries, Ints i, Floats coin) {
  static_assert(sizeof(AliasTable::Entry) == 2 * sizeof(float));
  const auto* words = reinterpret_cast<const int32_t*>(entries);
  const Ints at = i + i;
  const Floats own = hn::BitCast(FloatTag(), hn::GatherIndex(IntTag(), words, at));
  const Ints other = hn::GatherIndex(IntTag(), words + 1, at);
  return hn::IfThenElse(hn::RebindMask(IntTag(), coin < own), i, other);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
