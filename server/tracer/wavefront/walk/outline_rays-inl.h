// Shadow rays to the outlines of lights, for derivatives in where these are.
#if defined(ITN_TRACER_WAVEFRONT_WALK_OUTLINE_RAYS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_OUTLINE_RAYS_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_OUTLINE_RAYS_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_OUTLINE_RAYS_INL_H_
#endif

#include <cstddef>

#include "server/tracer/wavefront/walk/shadow_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// A vertex collects f L over all directions, f being what it makes of light from there and what
// reaches it. Where a light is, only L depends on: inside its outline L is the light's radiance,
// and outside what else is seen. So the derivative is an integral over the outline, of f times the
// step of L, times how fast the outline goes outwards. From every vertex, a pair of rays goes to
// places across the outline from one another, which are weighed alike: of a small light, their
// difference is small, as the light is. So they go through no roulette, which would part them.
//
// Left out is what a lamp hides that is no light: reflecting surfaces and the medium; and how it is
// seen by the camera itself. After Li, Aittala, Durand, Lehtinen, "Differentiable Monte Carlo ray
// tracing through edge sampling", SIGGRAPH Asia 2018.

// `light`: the step of radiance times what the vertex makes of it.
inline void add_outline_rays(Wavefront& wavefront, OutlineRays& outline_rays, size_t i,
                             const Vertices& vertices, Mask where, const Outline& outline,
                             Floats distance, Floats light, const std::vector<size_t>& places) {
  where &= hn::Abs(light) > 0;
  const Uints interaction = load(wavefront.paths.rays.interaction, i);
  const Append append{where, outline_rays.count};
  append(load(wavefront.paths.rays.position, i), outline_rays.rays.position);
  append(outline.direction, outline_rays.rays.direction);
  append(hn::IfThenZeroElse(for_uints(vertices.at_boundary), interaction),
         outline_rays.rays.interaction);
  append(kMaxOpticalDepth * free_path_of(wavefront.media, vertices.medium),
         outline_rays.rays.max_medium_length);
  if (outline_rays.rays.bounded) append(distance, outline_rays.rays.distance);
  for (size_t p = 0; p < places.size(); ++p) {
    append(light * dot(outline.growth, set(wavefront.collected.light_places.axis(places[p]))),
           outline_rays.light[p]);
  }
  append(slots_from(i), outline_rays.slot);
  outline_rays.count += hn::CountTrue(FloatTag(), where);
}

inline void send_outline_rays(Wavefront& wavefront, size_t i, const Vertices& vertices) {
  if (wavefront.collected.light_places.outlined().empty()) return;
  const Mask sends = sending(wavefront, i, vertices);
  if (hn::AllFalse(FloatTag(), sends)) return;
  const Lights& lights = wavefront.scene.lights;
  const Vectors position =
      if_then_else(sends, load(wavefront.paths.rays.position, i), set(Vec3f{}));
  const Words words = random(wavefront, i, load(wavefront.paths.vertex, i), Sampler::kOutline);
  for (LightPlaces::Outlined& outlined : wavefront.collected.light_places.outlined()) {
    visit_kind(outlined.light.kind, [&]<typename Kind>(const Kind& kind) {
      if constexpr (OutlinedLight<Kind>) {
        for (const bool opposite : {false, true}) {
          const Outline place = outline(kind, position, uniform(words.w[0]), opposite);
          const Floats value = evaluate_turn(wavefront, vertices, place.direction).value;
          const Appearance behind =
              look(lights, position, place.direction, NoParts(), &outlined.light);
          const Mask shows = sends & (behind.distance >= place.distance);
          OutlineRays* const rays = &outlined.rays[opposite ? 2 : 0];
          add_outline_rays(wavefront, rays[0], i, vertices, shows, place, place.distance,
                           value * place.radiance, outlined.places);
          if constexpr (VisibleLamp<Kind>) {
            add_outline_rays(wavefront, rays[1], i, vertices, shows, place, behind.distance,
                             -(value * behind.emission.radiance), outlined.places);
          }
        }
      }
    });
  }
}

// Traces them, and adds the light that they bring to the derivatives.
inline void trace_outline_rays(Wavefront& wavefront) {
  Paths& paths = wavefront.paths;
  const FloatTag d;
  for (LightPlaces::Outlined& outlined : wavefront.collected.light_places.outlined()) {
    for (OutlineRays& rays : outlined.rays) {
      follow_lines(wavefront.scene.obstacles, rays.rays, rays.count, Report::kLengths,
                   wavefront.at_boundary());
      for (size_t i = 0; i < rays.count; i += lanes()) {
        const Mask live = hn::FirstN(d, rays.count - i);
        const Uints end = load(rays.rays.outcome, i) & set(Rays::kEndMask);
        const SlotGather path{slots_in(rays.slot, i, live)};
        mark_leaked(paths, live & equals(end, Rays::kLeaked), path.slots);
        const Mask arrived = live & equals(end, Rays::kEscaped);
        const Floats part = part_arriving(wavefront, wavefront.medium_in(path.slots),
                                          load(rays.rays.medium_length, i));
        const Floats weight = hn::IfThenElseZero(arrived, path.get(paths.weight) * part);
        for (size_t p = 0; p < outlined.places.size(); ++p) {
          wavefront.collected.light_places.add(path, weight * load(rays.light[p], i),
                                               outlined.places[p]);
        }
      }
      rays.count = 0;
    }
  }
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
