// Adds light to what paths have collected, and to its derivatives.
#if defined(ITN_TRACER_WAVEFRONT_WALK_CONTRIBUTION_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_CONTRIBUTION_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_CONTRIBUTION_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_CONTRIBUTION_INL_H_
#endif

#include <bit>
#include <cstddef>
#include <cstdint>

#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/wavefront/walk/state-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Finds the parts of light from `source` (Lights::Light), or from far away in these directions.
// Inlined, it slows down who asks for none.
HWY_NOINLINE inline void find_parts(const Wavefront& wavefront, Vectors direction, Uints source,
                                    LightParts& parts) {
  const Lights& lights = wavefront.scene.lights;
  const std::vector<size_t>& numbers = wavefront.collected.light_scales.lights();
  const bool in_colours = wavefront.collected.colours.asked();
  const Floats zero = hn::Zero(FloatTag());
  for (size_t l = 0; l < wavefront.part_count; ++l) parts.of[l] = zero;
  const auto add = [&](const Lights::Light& light, Floats radiance) {
    const InColours own = in_colours ? colours(light, direction, radiance) : InColours();
    for (size_t l = 0; l < wavefront.part_count; ++l) {
      const Floats part = in_colours                   ? own.radiance[l]
                          : numbers[l] == light.number ? radiance
                                                       : zero;
      parts.of[l] += part;
    }
  };
  const Floats far = emission(lights, direction, add).radiance;
  const Mask shines = equals(source, 0) & (far > 0);
  for (size_t l = 0; l < wavefront.part_count; ++l) {
    parts.of[l] = hn::IfThenElseZero(shines, parts.of[l] / far);
  }
  for (const Lights::Light& light : lights.all()) {
    if (light.source == 0) continue;
    add(light, hn::IfThenElseZero(equals(source, light.source), set(1.0F)));
  }
}

// Light that arrives along paths, which weigh it, through a `length` in the object's medium since
// their last vertex. Of lanes where none arrives, it is 0.
HWY_INLINE void add_contribution(Wavefront& wavefront, SlotGather path, Floats light, Floats length,
                                 const LightParts& parts, const PathScores& scores) {
  Paths& paths = wavefront.paths;
  const Floats weight = path.get(paths.weight);
  const Floats contribution = weight * light;
  path.add(contribution, paths.radiance);
  Floats by_edges = hn::Zero(FloatTag());
  for (const FloatColumn& edge : paths.edge_weight) by_edges = path.get(edge) * light;
  if (wavefront.collected.normal_gradient) {
    path.add(by_edges, wavefront.collected.normal_gradient->edge_radiance());
  }
  wavefront.collected.on_light({path, light, contribution, length, parts, scores, by_edges});
}

// The same, for the gradient in normals: `light` reaches the pixels of the paths in `slots` by the
// boundary at the places where shadow rays with these numbers begin.
inline void add_to_normals(Wavefront& wavefront, Ints numbers, Floats light, Ints slots) {
  const ShadowRays& rays = wavefront.shadow_rays;
  alignas(64) int32_t slot[kMaxLanes], number[kMaxLanes];
  alignas(64) float part[kMaxLanes];
  hn::Store(slots, IntTag(), slot);
  hn::Store(numbers, IntTag(), number);
  hn::Store(light, FloatTag(), part);
  const Vectors score = gather(rays.normal_score, numbers);
  const Mask some = (light > 0) & (dot(score, score) > 0);
  for (Bits bits = bits_of(some); bits != 0; bits &= bits - 1) {
    const auto lane = static_cast<size_t>(std::countr_zero(bits));
    const auto ray = static_cast<size_t>(number[lane]);
    wavefront.collected.normal_gradient->add(
        wavefront.paths.pixel[slot[lane]], wavefront.paths.sample[slot[lane]],
        {rays.triangle[ray], rays.rays.position.at(ray), rays.normal_score.at(ray)},
        double{part[lane]});
  }
}

// Light that the walks of paths in such slots meet by themselves, at lamps or after leaving the
// scene.
inline void add_emission(Wavefront& wavefront, Ints slots, Mask live) {
  const Paths& paths = wavefront.paths;
  const SlotGather path{slots};
  const Vectors direction = if_then_else(live, path.get(paths.rays.direction), set(Vec3f{0, 1, 0}));
  const Vectors from = path.get(paths.flight_from);
  const auto [distance, light] = look(wavefront.scene.lights, from, direction);
  const Uints delta_bounce = path.get(paths.delta_bounce);
  const Floats pdf = path.get(paths.pdf);
  Floats mis_weight = set(1.0F);
  switch (wavefront.switches.techniques) {
    case Switches::Techniques::kLightsOnly: mis_weight = hn::Zero(FloatTag()); break;
    case Switches::Techniques::kPhaseOnly: break;
    case Switches::Techniques::kBoth: {
      Floats others = light.pdf;
      if (wavefront.refracts_shadow_rays) others = mul_add(path.get(paths.odds[0]), others, others);
      mis_weight = pdf / (pdf + others);
      break;
    }
  }
  Floats alone = set(1.0F);
  if (wavefront.refracts_shadow_rays) alone /= alone + path.get(paths.odds[0]);
  mis_weight = hn::IfThenElse(not_zero(delta_bounce), alone, mis_weight);
  if (wavefront.mirrors_shadow_rays) {
    mis_weight = hn::IfThenZeroElse(equals(delta_bounce, PathState::kFound), mis_weight);
  }
  mis_weight = hn::IfThenElseZero(live, mis_weight);
  const Floats arriving = light.radiance * mis_weight;
  LightParts parts;
  if (wavefront.part_count > 0) {
    find_parts(wavefront, direction, lamp_seen(wavefront.scene.lights, from, direction), parts);
  }
  const PathScores scores = wavefront.collected.scores.of_paths(path);
  if (wavefront.collected.colours.asked()) {
    path.add(
        wavefront.collected.colours.add(
            path, hn::Zero(FloatTag()), [&](size_t c) { return arriving * parts.of[c]; }, scores),
        wavefront.paths.radiance);
    return;
  }
  add_contribution(wavefront, path, arriving, hn::Zero(FloatTag()), parts, scores);
  if (wavefront.collected.map_gradient.asked()) {
    wavefront.collected.map_gradient.add(paths.pixel, paths.sample, direction,
                                         live & hn::Eq(distance, set(kInfinity)),
                                         path.get(paths.weight) * mis_weight, slots);
  }
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
