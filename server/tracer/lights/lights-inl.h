// Lights for many directions at a time.
#if defined(ITN_TRACER_LIGHTS_LIGHTS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_LIGHTS_INL_H_
#undef ITN_TRACER_LIGHTS_LIGHTS_INL_H_
#else
#define ITN_TRACER_LIGHTS_LIGHTS_INL_H_
#endif

#include "server/tracer/lights/kinds.h"
#include "server/tracer/lights/light-inl.h"
#include "server/tracer/lights/lights.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// One light, unless it is a delta.
HWY_INLINE Emission emission(const Lights::Light& light, Vectors d) {
  Emission result{hn::Zero(FloatTag()), hn::Zero(FloatTag())};
  visit_kind(light.kind, [&]<typename Kind>(const Kind& kind) {
    if constexpr (!Kind::kDelta) result = emission(kind, d);
  });
  return result;
}

// Nobody wants to know which light it comes from.
struct NoParts {
  HWY_INLINE void add_radiance(size_t /*number*/, Floats /*radiance*/) {}
  HWY_INLINE void add_chosen(size_t /*number*/, Mask /*chosen*/) {}
};

// All lights but deltas: radiance, and density of `sample`. `parts` hears of each light, by the
// number of its description.
template <typename Parts = NoParts>
HWY_INLINE Emission emission(const Lights& lights, Vectors d, Parts&& parts = {}) {
  Emission all{hn::Zero(FloatTag()), hn::Zero(FloatTag())};
  for (const Lights::Light& light : lights.all()) {
    const Emission part = emission(light, d);
    parts.add_radiance(light.number, part.radiance);
    all.radiance = hn::Add(all.radiance, part.radiance);
    all.pdf = mul_add(part.pdf, set(static_cast<float>(light.probability)), all.pdf);
  }
  return all;
}

// Directions towards the light, and how far it is. For deltas, `pdf` is 0 and `radiance` is
// irradiance / probability, the weight of the draw; else the weight is radiance / pdf.
struct LightSamples {
  Vectors direction;
  Floats distance, radiance, pdf;
};

// From the words of one counter, and of another one where there is a map. The lower bytes of the
// first three words are left for a fifth uniform number. `parts` hears of the radiance in the
// direction that is drawn, which counts where pdf > 0, and where a delta is chosen.
template <typename Parts = NoParts>
HWY_INLINE LightSamples sample(const Lights& lights, Vectors from_where, const Words& words,
                               const Words& more, Parts&& parts = {}) {
  const Floats choice = uniform(words.w[0]);
  const LightUniforms uniforms{uniform(words.w[1]), uniform(words.w[2]),
                               coarse_uniform(hn::ShiftRight<16>(words.w[3])),
                               coarse_uniform(hn::And(words.w[3], set(uint32_t{0xFFFF}))), more};
  const Floats zero = hn::Zero(FloatTag());
  LightSamples draw{{zero, set(1.0F), zero}, set(kInfinity), zero, zero};
  Floats delta_weight = zero;
  Floats from = set(-1.0F);
  for (const Lights::Light& light : lights.all()) {
    const Floats to = set(light.cumulative);
    const Mask chosen = hn::And(hn::Ge(choice, from), hn::Lt(choice, to));
    from = to;
    if (hn::AllFalse(FloatTag(), chosen)) continue;
    Vectors direction = draw.direction;
    visit_kind(light.kind, [&]<typename Kind>(const Kind& kind) {
      if constexpr (Kind::kDelta) {
        const Beam arriving = beam(kind, from_where);
        parts.add_chosen(light.number, chosen);
        direction = arriving.direction;
        draw.distance = hn::IfThenElse(chosen, arriving.distance, draw.distance);
        const auto weight = static_cast<float>(kind.power() / light.probability);
        delta_weight =
            hn::IfThenElse(chosen, hn::Mul(set(weight), arriving.irradiance), delta_weight);
      } else {
        direction = sample(kind, uniforms);
      }
    });
    draw.direction = if_then_else(chosen, direction, draw.direction);
  }
  const Mask delta = hn::Gt(delta_weight, zero);
  const Emission light = emission(lights, draw.direction, parts);
  // A direction on the very rim of the sun may fall outside it by rounding.
  const Mask possible = hn::AndNot(delta, hn::Gt(light.pdf, zero));
  draw.pdf = hn::IfThenElseZero(possible, light.pdf);
  draw.radiance = hn::IfThenElse(delta, delta_weight, hn::IfThenElseZero(possible, light.radiance));
  return draw;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
