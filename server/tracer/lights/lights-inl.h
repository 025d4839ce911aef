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

// The light that is drawn is the one whose cumulative probability is the first above `choice`.
struct LightChoice {
  Floats choice;
  LightUniforms uniforms;
};

// From the words of one counter, and of another one where there is a map. The lower bytes of the
// first three words are left for a fifth uniform number.
HWY_INLINE LightChoice light_choice(const Words& words, const Words& more) {
  return {uniform(words.w[0]),
          {uniform(words.w[1]), uniform(words.w[2]), coarse_uniform(hn::ShiftRight<16>(words.w[3])),
           coarse_uniform(hn::And(words.w[3], set(uint32_t{0xFFFF}))), more}};
}

// Calls visit(light, chosen) for every light that some draw.
template <typename Visit>
HWY_INLINE void for_each_drawn(const Lights& lights, Floats choice, const Visit& visit) {
  Floats from = set(-1.0F);
  for (const Lights::Light& light : lights.all()) {
    const Floats to = set(light.cumulative);
    const Mask chosen = hn::And(hn::Ge(choice, from), hn::Lt(choice, to));
    from = to;
    if (!hn::AllFalse(FloatTag(), chosen)) visit(light, chosen);
  }
}

// What one that is a delta sends there, divided by the probability of drawing it.
template <typename Kind>
HWY_INLINE Beam drawn_beam(const Kind& kind, const Lights::Light& light, Vectors from,
                           const LightUniforms& uniforms) {
  Beam arriving = beam(kind, from, uniforms);
  const auto weight = static_cast<float>(kind.power() / light.probability);
  arriving.irradiance = hn::Mul(set(weight), arriving.irradiance);
  return arriving;
}

// `parts` hears of the radiance in the direction that is drawn, which counts where pdf > 0, and
// where a delta is chosen.
template <typename Parts = NoParts>
HWY_INLINE LightSamples sample(const Lights& lights, Vectors from, const LightChoice& drawn,
                               Parts&& parts = {}) {
  const Floats zero = hn::Zero(FloatTag());
  LightSamples draw{{zero, set(1.0F), zero}, set(kInfinity), zero, zero};
  Floats delta_weight = zero;
  Mask delta = hn::FirstN(FloatTag(), 0);
  for_each_drawn(lights, drawn.choice, [&](const Lights::Light& light, Mask chosen) {
    Vectors direction = draw.direction;
    visit_kind(light.kind, [&]<typename Kind>(const Kind& kind) {
      if constexpr (Kind::kDelta) {
        const Beam arriving = drawn_beam(kind, light, from, drawn.uniforms);
        parts.add_chosen(light.number, chosen);
        delta = hn::Or(delta, chosen);
        direction = arriving.direction;
        draw.distance = hn::IfThenElse(chosen, arriving.distance, draw.distance);
        delta_weight = hn::IfThenElse(chosen, arriving.irradiance, delta_weight);
      } else {
        direction = sample(kind, drawn.uniforms);
      }
    });
    draw.direction = if_then_else(chosen, direction, draw.direction);
  });
  const Emission light = emission(lights, draw.direction, parts);
  // A direction on the very rim of the sun may fall outside it by rounding.
  const Mask possible = hn::AndNot(delta, hn::Gt(light.pdf, zero));
  draw.pdf = hn::IfThenElseZero(possible, light.pdf);
  draw.radiance = hn::IfThenElse(delta, delta_weight, hn::IfThenElseZero(possible, light.radiance));
  return draw;
}

// What was drawn from one place, as it is seen from another by the same numbers. Where that is a
// lamp that sends nothing there, the direction is 0; what is far away stays as it is.
HWY_INLINE LightSamples seen_from(const Lights& lights, Vectors from, const LightChoice& drawn,
                                  LightSamples light) {
  for_each_drawn(lights, drawn.choice, [&](const Lights::Light& each, Mask chosen) {
    visit_kind(each.kind, [&]<typename Kind>(const Kind& kind) {
      if constexpr (Kind::kDelta) {
        if constexpr (!Kind::kDistant) {
          const Beam arriving = drawn_beam(kind, each, from, drawn.uniforms);
          const Mask shines = hn::Gt(arriving.irradiance, hn::Zero(FloatTag()));
          light.direction = if_then_else(
              chosen, if_then_else(shines, arriving.direction, set(Vec3f{})), light.direction);
          light.distance = hn::IfThenElse(chosen, arriving.distance, light.distance);
          light.radiance = hn::IfThenElse(chosen, arriving.irradiance, light.radiance);
        }
      }
    });
  });
  return light;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
