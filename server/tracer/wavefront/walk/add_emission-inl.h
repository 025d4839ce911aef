// Light that walks meet by themselves.
#if defined(ITN_TRACER_WAVEFRONT_WALK_ADD_EMISSION_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_ADD_EMISSION_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_ADD_EMISSION_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_ADD_EMISSION_INL_H_
#endif

#include <cstddef>

#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/wavefront/walk/contribution-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Light that walks meet by themselves, after leaving the scene.
inline void add_emission(Wavefront& wave, size_t i, Mask escaped) {
  const Paths& paths = wave.paths;
  LightParts parts(wave.differentiated_lights);
  const Emission light = emission(wave.scene.lights, load(paths.rays.direction, i), parts);
  const Mask delta_bounce = not_zero(load(paths.delta_bounce, i));
  const Floats pdf = load(paths.pdf, i);
  Floats mis_weight = set(1.0F);
  switch (wave.switches.techniques) {
    case Switches::Techniques::kLightsOnly: mis_weight = hn::Zero(FloatTag()); break;
    case Switches::Techniques::kPhaseOnly: break;
    case Switches::Techniques::kBoth: mis_weight = hn::Div(pdf, hn::Add(pdf, light.pdf)); break;
  }
  mis_weight = hn::IfThenElse(delta_bounce, set(1.0F), mis_weight);
  const Floats radiance = hn::IfThenElseZero(escaped, hn::Mul(light.radiance, mis_weight));
  add_contribution(
      wave, SlotRange{i}, radiance, [&] { return load(paths.score_sigma_t, i); },
      [&](size_t s) { return load(paths.score_slots[s], i); },
      [&](size_t l, Floats weight) {
        return hn::IfThenElseZero(escaped, hn::Mul(hn::Mul(weight, parts.radiance[l]), mis_weight));
      });
  if (wave.differentiated_map != nullptr) {
    const Ints slots = hn::Iota(IntTag(), static_cast<int32_t>(i));
    add_to_map(wave, load(paths.rays.direction, i), escaped,
               hn::Mul(load(paths.weight, i), mis_weight), slots);
  }
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
