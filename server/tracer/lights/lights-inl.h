// Lights for many directions at a time.
#if defined(ITN_TRACER_LIGHTS_LIGHTS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_LIGHTS_LIGHTS_INL_H_
#undef ITN_TRACER_LIGHTS_LIGHTS_INL_H_
#else
#define ITN_TRACER_LIGHTS_LIGHTS_INL_H_
#endif

#include <concepts>

#include "server/tracer/lights/kinds.h"
#include "server/tracer/lights/light-inl.h"
#include "server/tracer/lights/lights.h"
#include "server/tracer/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// What a kind computes, for many places or unit directions at a time. Who follows one path at a
// time has one lane.
template <typename Kind>
concept DeltaLight = requires(const Kind& kind, Vectors from) {
  // What it sends to places.
  { beam(kind, from) } -> std::same_as<Beam>;
};
// A light that is far away. One that was compiled for kRgb may have colours(kind, d), its radiance
// in red, green and blue where it is, if that differs.
template <typename Kind>
concept DistantLight = requires(const Kind& kind, Vectors d, const LightUniforms& u) {
  // Radiance, and the density per steradian with which `sample` draws d.
  { emission(kind, d) } -> std::same_as<Emission>;
  // A direction towards it.
  { sample(kind, u) } -> std::same_as<Vectors>;
};
// A lamp that paths meet, which is black to other light and hides what is behind it.
template <typename Kind>
concept LampMaths = requires(const Kind& kind, Vectors from, Vectors d, const LightUniforms& u) {
  // How it is seen in a direction.
  { look(kind, from, d) } -> std::same_as<Appearance>;
  // A direction towards it.
  { draw(kind, from, u) } -> std::same_as<LampDraw>;
  // What `draw` makes, in a place `other`, of the numbers that make d of it here.
  { redraw(kind, from, d, from) } -> std::same_as<Vectors>;
};
// A light whose place or direction has derivatives, and that is no delta.
template <typename Kind>
concept OutlinedLight = requires(const Kind& kind, Vectors from, Floats u, bool opposite) {
  // A place of its outline that u draws, or the one across from it, the other of the pair.
  { outline(kind, from, u, opposite) } -> std::same_as<Outline>;
};
template <typename Kind>
concept LightMaths = RenderedLight<Kind> &&
    (!Kind::kDelta || DeltaLight<Kind>)&&(Kind::kDelta || !Kind::kDistant ||
                                          DistantLight<Kind>)&&(!VisibleLamp<Kind> ||
                                                                LampMaths<Kind>);

// One light, if it is far away and no delta.
HWY_INLINE Emission emission(const Lights::Light& light, Vectors d) {
  Emission result{hn::Zero(FloatTag()), hn::Zero(FloatTag())};
  visit_kind(light.kind, [&]<LightMaths Kind>(const Kind& kind) {
    if constexpr (Kind::kDistant && !Kind::kDelta) result = emission(kind, d);
  });
  return result;
}

// Its radiance in each colour, given that of all together.
inline InColours colours(const Lights::Light& light, Vectors d, Floats radiance) {
  InColours result;
  for (size_t c = 0; c < kColours.size(); ++c) {
    result.radiance[c] = radiance * light.colour[c];
  }
  visit_kind(light.kind, [&]<typename Kind>(const Kind& kind) {
    if constexpr (requires { colours(kind, d); }) {
      const Mask shines = radiance > 0;
      const InColours own = colours(kind, d);
      for (size_t c = 0; c < kColours.size(); ++c) {
        result.radiance[c] = hn::IfThenElseZero(shines, own.radiance[c]);
      }
    }
  });
  return result;
}

// Nobody wants to know which light it comes from.
struct NoParts {
  HWY_INLINE void operator()(const Lights::Light& /*light*/, Floats /*radiance*/) const {}
};

// All that are: radiance, and density of `sample`. Calls part(light, radiance) for each.
template <typename Part = NoParts>
HWY_INLINE Emission emission(const Lights& lights, Vectors d, const Part& part = {}) {
  Emission all{hn::Zero(FloatTag()), hn::Zero(FloatTag())};
  for (const Lights::Light& light : lights.all()) {
    const Emission own = emission(light, d);
    part(light, own.radiance);
    all.radiance += own.radiance;
    all.pdf = mul_add(own.pdf, set(static_cast<float>(light.probability)), all.pdf);
  }
  return all;
}

// One light, if it is a lamp that lines meet.
HWY_INLINE Appearance look(const Lights::Light& light, Vectors from, Vectors d) {
  Appearance result{set(kInfinity), {hn::Zero(FloatTag()), hn::Zero(FloatTag())}};
  visit_kind(light.kind, [&]<typename Kind>(const Kind& kind) {
    if constexpr (VisibleLamp<Kind>) result = look(kind, from, d);
  });
  return result;
}

// How far lines may go until a lamp ends them, in mm, or infinite; but for one lamp.
HWY_INLINE Floats reach(const Lights& lights, Vectors from, Vectors d,
                        const Lights::Light* except = nullptr) {
  Floats distance = set(kInfinity);
  if (!lights.has_lamps()) return distance;
  for (const Lights::Light& light : lights.all()) {
    if (&light != except) distance = hn::Min(distance, look(light, from, d).distance);
  }
  return distance;
}

// What is seen along lines, but for deltas: the first lamp, or else what is far away. The density
// is that with which those lights draw the line.
template <typename Part = NoParts>
HWY_INLINE Appearance look(const Lights& lights, Vectors from, Vectors d, const Part& part = {},
                           const Lights::Light* except = nullptr) {
  if (!lights.has_lamps()) return {set(kInfinity), emission(lights, d, part)};
  const Floats distance = reach(lights, from, d, except);
  Emission all{hn::Zero(FloatTag()), hn::Zero(FloatTag())};
  for (const Lights::Light& light : lights.all()) {
    if (&light == except) continue;
    const Appearance lamp = look(light, from, d);
    const Emission far = emission(light, d);
    const Mask seen = hn::Eq(lamp.distance, distance);
    const Floats radiance = hn::IfThenElseZero(seen, lamp.emission.radiance + far.radiance);
    const Floats pdf = hn::IfThenElseZero(seen, lamp.emission.pdf + far.pdf);
    part(light, radiance);
    all.radiance += radiance;
    all.pdf = mul_add(pdf, set(static_cast<float>(light.probability)), all.pdf);
  }
  return {distance, all};
}

// Calls visit(kind, light) for each lamp that lines meet.
template <typename Visit>
HWY_INLINE void for_each_lamp(const Lights& lights, const Visit& visit) {
  for (const Lights::Light& light : lights.all()) {
    visit_kind(light.kind, [&]<typename Kind>(const Kind& kind) {
      if constexpr (VisibleLamp<Kind>) visit(kind, light);
    });
  }
}

// The number of the lamp that is seen in directions, the first of them; 0: none.
HWY_INLINE Uints lamp_seen(const Lights& lights, Vectors from, Vectors d) {
  Uints lamp = hn::Zero(UintTag());
  if (!lights.has_lamps()) return lamp;
  Floats distance = set(kInfinity);
  for_each_lamp(lights, [&](const auto& kind, const Lights::Light& light) {
    const Floats own = look(kind, from, d).distance;
    lamp = hn::IfThenElse(for_uints(own < distance), set(light.lamp), lamp);
    distance = hn::Min(distance, own);
  });
  return lamp;
}

// The middle of the lamp with this number; of 0 nothing that means anything.
HWY_INLINE Vectors middle_of(const Lights& lights, Uints lamp) {
  Vectors middle = set(Vec3f{});
  for_each_lamp(lights, [&](const auto& kind, const Lights::Light& light) {
    middle = if_then_else(equals(lamp, light.lamp), set(static_cast<Vec3f>(kind.center)), middle);
  });
  return middle;
}

// Density with which the lamp with this number draws directions, whatever is seen there; of 0, all
// that is far away.
HWY_INLINE Floats drawn_pdf(const Lights& lights, Uints lamp, Vectors from, Vectors d) {
  Floats pdf = emission(lights, d).pdf;
  if (!lights.has_lamps()) return pdf;
  for_each_lamp(lights, [&](const auto& kind, const Lights::Light& light) {
    const Floats own = look(kind, from, d).emission.pdf * static_cast<float>(light.probability);
    pdf = hn::IfThenElse(equals(lamp, light.lamp), own, pdf);
  });
  return pdf;
}

// What the numbers that draw what is seen in d make of it elsewhere.
HWY_INLINE Vectors redraw(const Lights& lights, Vectors from, Vectors d, Vectors other) {
  Vectors direction = d;
  if (!lights.has_lamps()) return direction;
  const Floats distance = reach(lights, from, d);
  for (const Lights::Light& light : lights.all()) {
    visit_kind(light.kind, [&]<typename Kind>(const Kind& kind) {
      if constexpr (VisibleLamp<Kind>) {
        const Mask seen = (distance < kInfinity) & hn::Eq(look(kind, from, d).distance, distance);
        direction = if_then_else(seen, redraw(kind, from, d, other), direction);
      }
    });
  }
  return direction;
}

// Directions towards the light, and how far it is, or what hides it. For deltas, `pdf` is 0 and
// `radiance` is irradiance / probability, the weight of the draw; else the weight is
// radiance / pdf.
struct LightSamples {
  Vectors direction;
  Floats distance, radiance, pdf;
  Uints source = hn::Zero(UintTag());  // Lights::Light::source

  Mask dense() const { return pdf > 0; }
  // Whether all lights that are far away, but for deltas, send it.
  Mask from_far() const { return dense() & hn::Eq(distance, set(kInfinity)); }
};
HWY_INLINE LightSamples if_then_else(Mask mask, const LightSamples& a, const LightSamples& b) {
  return {if_then_else(mask, a.direction, b.direction),
          hn::IfThenElse(mask, a.distance, b.distance),
          hn::IfThenElse(mask, a.radiance, b.radiance), hn::IfThenElse(mask, a.pdf, b.pdf),
          hn::IfThenElse(for_uints(mask), a.source, b.source)};
}

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
           coarse_uniform(words.w[3] & set(uint32_t{0xFFFF})), more}};
}

// Calls visit(light, chosen) for every light that some draw.
template <typename Visit>
HWY_INLINE void for_each_drawn(const Lights& lights, Floats choice, const Visit& visit) {
  Floats from = set(-1.0F);
  for (const Lights::Light& light : lights.all()) {
    const Floats to = set(light.cumulative);
    const Mask chosen = (choice >= from) & (choice < to);
    from = to;
    if (!hn::AllFalse(FloatTag(), chosen)) visit(light, chosen);
  }
}

// The number of the lamp that is drawn; 0: it is none that lines meet.
HWY_INLINE Uints lamp_drawn(const Lights& lights, Floats choice) {
  Uints lamp = hn::Zero(UintTag());
  if (!lights.has_lamps()) return lamp;
  for_each_drawn(lights, choice, [&](const Lights::Light& light, Mask chosen) {
    lamp = hn::IfThenElse(for_uints(chosen), set(light.lamp), lamp);
  });
  return lamp;
}

// One that is a delta or a lamp, as it is drawn.
template <typename Kind>
HWY_INLINE LightSamples drawn_light(const Kind& kind, const Lights::Light& light, Vectors from,
                                    const LightUniforms& uniforms) {
  if constexpr (Kind::kDelta) {
    const Beam arriving = beam(kind, from);
    const auto weight = static_cast<float>(kind.power() / light.probability);
    return {arriving.direction, arriving.distance, weight * arriving.irradiance,
            hn::Zero(FloatTag()), set(light.source)};
  } else {
    const auto [direction, appearance] = draw(kind, from, uniforms);
    return {direction, appearance.distance, appearance.emission.radiance,
            static_cast<float>(light.probability) * appearance.emission.pdf, set(light.source)};
  }
}

// What is drawn and arrives at places; `far_direction(kind)` is that of what is far away and no
// delta.
template <typename FarDirection>
HWY_INLINE LightSamples arriving_light(const Lights& lights, Vectors from, const LightChoice& drawn,
                                       const FarDirection& far_direction) {
  const Floats zero = hn::Zero(FloatTag());
  LightSamples draw{{zero, set(1.0F), zero}, set(kInfinity), zero, zero};
  for_each_drawn(lights, drawn.choice, [&](const Lights::Light& light, Mask chosen) {
    visit_kind(light.kind, [&]<typename Kind>(const Kind& kind) {
      if constexpr (Kind::kDistant && !Kind::kDelta) {
        draw.direction = if_then_else(chosen, far_direction(kind), draw.direction);
      } else {
        LightSamples one = drawn_light(kind, light, from, drawn.uniforms);
        if (lights.has_lamps()) {
          const Mask hidden = reach(lights, from, one.direction, &light) < one.distance;
          one.radiance = hn::IfThenZeroElse(hidden, one.radiance);
        }
        draw = if_then_else(chosen, one, draw);
      }
    });
  });
  const Mask known = not_zero(draw.source);
  const Emission far = emission(lights, draw.direction);
  // A direction on the very rim of the sun may fall outside it by rounding.
  const Mask possible = hn::AndNot(known, far.pdf > 0);
  Mask seen = possible;
  if (lights.has_lamps()) {
    const Floats distance = reach(lights, from, draw.direction);
    draw.distance = hn::IfThenElse(known, draw.distance, distance);
    seen &= hn::Eq(distance, set(kInfinity));
  }
  draw.pdf = hn::IfThenElse(known, draw.pdf, hn::IfThenElseZero(possible, far.pdf));
  draw.radiance = hn::IfThenElse(known, draw.radiance, hn::IfThenElseZero(seen, far.radiance));
  return draw;
}

HWY_INLINE LightSamples sample(const Lights& lights, Vectors from, const LightChoice& drawn) {
  return arriving_light(lights, from, drawn,
                        [&](const auto& kind) { return sample(kind, drawn.uniforms); });
}

// What was drawn from one place, as it is seen from another by the same numbers. Where that is a
// delta that sends nothing there, the direction is 0.
HWY_INLINE LightSamples seen_from(const Lights& lights, Vectors from, const LightChoice& drawn,
                                  const LightSamples& before) {
  LightSamples light =
      arriving_light(lights, from, drawn, [&](const auto& /*kind*/) { return before.direction; });
  const Mask shines = light.dense() | (light.radiance > 0);
  light.direction = if_then_else(shines, light.direction, set(Vec3f{}));
  return light;
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
