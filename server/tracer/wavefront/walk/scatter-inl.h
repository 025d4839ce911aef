// Vertices: scatterings in the medium, diffuse reflections, and crossings of its boundary.
#if defined(ITN_TRACER_WAVEFRONT_WALK_SCATTER_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_SCATTER_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_SCATTER_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_SCATTER_INL_H_
#endif

#include <bit>
#include <cstddef>
#include <cstdint>
#include <numbers>

#include "server/tracer/collected/vertices-inl.h"
#include "server/tracer/geometry/lines/surface_search-inl.h"
#include "server/tracer/geometry/surface_normals-inl.h"
#include "server/tracer/surfaces/reflectance.h"
#include "server/tracer/wavefront/walk/outline_rays-inl.h"
#include "server/tracer/wavefront/walk/refraction_odds-inl.h"
#include "server/tracer/wavefront/walk/shadow_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

HWY_INLINE Vertices vertices_of(const Wavefront& wavefront, size_t i, Mask in_medium,
                                Mask on_surface, Mask at_boundary) {
  const FloatTag d;
  const Paths& paths = wavefront.paths;
  const Surfaces& surfaces = wavefront.scene.obstacles.surfaces;
  const Vectors before = load(paths.rays.direction, i);
  Vertices vertices{.in_medium = in_medium,
                    .on_surface = on_surface,
                    .at_boundary = at_boundary,
                    .medium = wavefront.medium(i),
                    .any_on_surface = !hn::AllFalse(d, on_surface),
                    .any_at_boundary = !hn::AllFalse(d, at_boundary),
                    .crossing = {},
                    .axis = before,
                    .flat_normal = before,
                    .factor = hn::Zero(d),
                    .triangles = hn::Set(IntTag(), -1)};
  vertices.factor =
      by_medium(wavefront.media, vertices.medium, [](const Medium& of) { return set(of.albedo); });
  if (vertices.any_at_boundary) {
    const Mask inside = is_inside(load(paths.rays.interaction, i));
    const Crossings& crossings = wavefront.crossings;
    vertices.crossing = crossing_of(
        before, load(crossings.smooth_normal, i), load(crossings.normal, i), inside,
        wavefront.scene.obstacles.corner_normals.flat(), wavefront.boundary_derivatives);
    vertices.factor = hn::IfThenElse(at_boundary, set(1.0F), vertices.factor);
  }
  if (vertices.any_on_surface) {
    const Floats zero = hn::Zero(d);
    const auto reflects = for_uints(on_surface);
    const Uints triangle = surface_of(load(paths.rays.interaction, i));
    const Ints number = hn::BitCast(IntTag(), hn::IfThenElseZero(reflects, triangle));
    vertices.triangles =
        hn::BitCast(IntTag(), hn::IfThenElse(reflects, triangle, set(Surfaces::kNone)));
    Floats reflectance = gather(surfaces.reflectances.data(), number);
    for (const Surfaces::Pattern& pattern : surfaces.patterned) {
      reflectance = hn::IfThenElse(
          among(pattern.triangles, vertices.triangles),
          reflectance_at(pattern.reflectance, load(paths.rays.position, i)), reflectance);
    }
    vertices.factor = hn::IfThenElse(on_surface, reflectance, vertices.factor);
    const Vectors normal = gather(surfaces.normals, number);
    const Mask flip = dot(normal, before) >= 0;
    const auto facing = [&](Vectors n) {
      return if_then_else(flip, Vectors{zero, zero, zero} - n, n);
    };
    vertices.axis = if_then_else(on_surface, facing(normal), before);
    if (surfaces.smooth()) {
      vertices.flat_normal = vertices.axis;
      const Vectors smooth = smooth_normal_at(surfaces, number, load(paths.rays.position, i));
      vertices.axis = if_then_else(on_surface, facing(smooth), before);
    }
  }
  return vertices;
}

// W takes the factor.
HWY_INLINE void multiply_by_factor(Wavefront& wavefront, size_t i, const Vertices& vertices) {
  Paths& paths = wavefront.paths;
  const Floats factor = vertices.factor, weight = load(paths.weight, i);
  const Mask by_albedo = in_object(wavefront.media, vertices.medium, vertices.in_medium);
  wavefront.collected.on_vertex({i, vertices, load(paths.rays.position, i), weight, by_albedo});
  store(weight * factor, paths.weight, i);
  for (FloatColumn& edge : paths.edge_weight) store(load(edge, i) * factor, edge, i);
}

// The odds for light that the walk meets behind a nearly smooth boundary in a direction.
inline void send_walk_odds(Wavefront& wavefront, size_t i, Mask where, const Vertices& vertices,
                           Vectors direction) {
  const Lights& lights = wavefront.scene.lights;
  const Vectors position = load(wavefront.paths.rays.position, i);
  direction = if_then_else(where, direction, set(Vec3f{0, 1, 0}));
  where &= look(lights, position, direction).emission.pdf > 0;
  const Target target =
      target_at(lights, scattered_at(wavefront.paths, i),
                redraw(lights, position, direction, scattered_at(wavefront.paths, i)),
                lamp_seen(lights, position, direction), set(kInfinity));
  send_lobe_odds(wavefront, wavefront.odds_rays, i, where, vertices.medium, target, set(1.0F),
                 hn::Zero(UintTag()));
}

// Remembers how paths cross the boundary, for a gradient in its normals.
inline void note_turns(Wavefront& wavefront, size_t i, Mask where, const Crossing& crossing,
                       const BoundarySample& next, Mask edge) {
  Paths& paths = wavefront.paths;
  const Mask goes_on = edge | (next.weight > 0);
  const Mask scored = dot(next.by_normal, next.by_normal) > 0;
  VectorColumn score;
  store(slope_outwards(crossing, next.by_normal), score, 0);
  const Bits edges = bits_of(edge);
  for (Bits bits = bits_of(where & goes_on & scored); bits != 0; bits &= bits - 1) {
    const auto lane = static_cast<size_t>(std::countr_zero(bits));
    const size_t slot = i + lane;
    wavefront.collected.normal_gradient->note(
        slot, {wavefront.crossings.triangle[slot], paths.rays.position.at(slot), score.at(lane)},
        (edges >> lane & 1) != 0);
  }
}

// At a boundary that stops lines: draws the next direction with its pdf, and which side it is on.
// Paths that rounding has trapped there are dropped.
inline void cross(Wavefront& wavefront, size_t i, const Vertices& vertices, Vectors& direction,
                  Floats& pdf) {
  Paths& paths = wavefront.paths;
  const Mask where = vertices.at_boundary;
  const Uints one = set(uint32_t{1});
  const Uints count = hn::IfThenElseZero(for_uints(where), load(paths.crossings, i) + one);
  store(count, paths.crossings, i);
  store(set(1.0F), paths.crossing_weight, i);
  for (FloatColumn& edge : paths.crossing_edge_weight) store(hn::Zero(FloatTag()), edge, i);
  if (wavefront.refracts_shadow_rays) store(hn::Zero(FloatTag()), paths.odds[0], i);
  if (!vertices.any_at_boundary) return;
  store(hn::IfThenElse(count > set(kMaxConsecutiveCrossings), one, load(paths.leaked, i)),
        paths.leaked, i);
  const BoundarySample next =
      sample_boundary(wavefront.media, vertices.medium, vertices.crossing,
                      random(wavefront, i, load(paths.vertex, i), Sampler::kBoundary));
  // No shadow ray competes with those that follow an edge either.
  const Mask edge = where & (next.edge_weight > 0);
  const Mask delta = wavefront.boundary_is_delta ? where : edge;
  Uints bounce = hn::IfThenElse(for_uints(delta), one, load(paths.delta_bounce, i));
  if (wavefront.mirrors_shadow_rays) {
    const Mask mirrors = hn::AndNot(next.transmitted | vertices.crossing.leaving, where);
    bounce = hn::IfThenElse(for_uints(mirrors), set(PathState::kFound), bounce);
  }
  store(bounce, paths.delta_bounce, i);
  for (FloatColumn& by : paths.crossing_edge_weight) {
    store(hn::IfThenElseZero(edge, next.edge_weight), by, i);
  }
  if (wavefront.collected.normal_gradient)
    note_turns(wavefront, i, where, vertices.crossing, next, edge);
  direction = if_then_else(where, next.direction, direction);
  pdf = hn::IfThenElse(where, next.pdf, pdf);
  store(hn::IfThenElse(where, next.weight, set(1.0F)), paths.crossing_weight, i);
  wavefront.collected.scores.on_crossing(i, where, next);
  if (wavefront.refracts_shadow_rays) {
    // For light that the walk meets next.
    if (wavefront.boundary_is_delta) {
      const Mask leaves = vertices.crossing.leaving & next.transmitted;
      send_odds(wavefront, i, where & leaves, vertices.medium, vertices.crossing);
    } else if (wavefront.searches_facets) {
      send_walk_odds(wavefront, i, hn::AndNot(edge, where), vertices, direction);
    } else {
      const Vectors to_light = redraw(wavefront.scene.lights, load(paths.rays.position, i),
                                      direction, scattered_at(paths, i));
      const Floats odds = refraction_odds(wavefront, i, vertices.medium, to_light);
      store(hn::IfThenElseZero(hn::AndNot(edge, where), odds), paths.odds[0], i);
    }
  }
  const Uints toggled = hn::IfThenElseZero(for_uints(where & next.transmitted), set(Rays::kInside));
  const Uints interaction = load(paths.rays.interaction, i) ^ toggled;
  const Uints at_boundary = hn::IfThenElseZero(for_uints(where), set(Rays::kAtBoundary));
  store(interaction | at_boundary, paths.rays.interaction, i);
  store(load(wavefront.crossings.normal, i), paths.rays.normal, i);
}

// Draws the next direction: by the phase function around the last one, by the cosine law around the
// normal (its pdf is cosine / pi: cosine^2 is uniform), or as the boundary says.
HWY_INLINE void sample_direction(Wavefront& wavefront, size_t i, const Vertices& vertices) {
  Paths& paths = wavefront.paths;
  const Floats zero = hn::Zero(FloatTag());
  const Floats u1 = load(paths.u1, i);
  Floats cosine = by_medium(wavefront.media, vertices.medium,
                            [&](const Medium& of) { return sample_cosine(of.phase, u1); });
  Floats sine = hn::Sqrt(hn::Max(zero, 1 - cosine * cosine));
  const PhaseValue phase = evaluate_phase(wavefront.media, vertices.medium, cosine);
  Floats pdf = phase.value;
  if (vertices.any_on_surface) {
    const Mask on_surface = vertices.on_surface;
    const Floats diffuse = hn::Sqrt(1 - u1);
    cosine = hn::IfThenElse(on_surface, diffuse, cosine);
    sine = hn::IfThenElse(on_surface, hn::Sqrt(u1), sine);
    pdf = hn::IfThenElse(on_surface, diffuse * std::numbers::inv_pi_v<float>, pdf);
  }
  const SinCos phi = sin_cos_2pi(load(paths.u2, i));
  Vectors direction =
      renormalize(frame_to_world(vertices.axis, sine * phi.cos, sine * phi.sin, cosine));
  if (vertices.any_on_surface && wavefront.scene.obstacles.surfaces.smooth()) {
    // What a smooth normal would send through the triangle ends there.
    const Mask above = dot(vertices.flat_normal, direction) > 0;
    const auto ends = for_uints(hn::AndNot(above, vertices.on_surface));
    store(hn::IfThenZeroElse(ends, load(paths.alive, i)), paths.alive, i);
  }
  wavefront.collected.scores.on_scattering(i, vertices.in_medium, phase, load(paths.weight, i));
  const auto where = for_uints(vertices.where());
  store(hn::IfThenZeroElse(where, load(paths.delta_bounce, i)), paths.delta_bounce, i);
  if (wavefront.stops_at_boundary) cross(wavefront, i, vertices, direction, pdf);
  if (wavefront.refracts_shadow_rays) {
    store(hn::IfThenElseZero(vertices.in_medium, phase.value), paths.scattered_pdf[0], i);
    // Paths that have escaped are at no place.
    const Vectors position =
        if_then_else(vertices.where(), load(paths.rays.position, i), set(Vec3f{}));
    store(position.x, paths.scattered_at[0], i);
    store(position.y, paths.scattered_at[1], i);
    store(position.z, paths.scattered_at[2], i);
  }
  // Paths that have ended keep their direction: NaN would slow the lanes down.
  const Vectors before = load(paths.rays.direction, i);
  store(if_then_else(vertices.where(), direction, before), paths.rays.direction, i);
  store(pdf, paths.pdf, i);
}

// What happens at the vertices of the paths in slots i, i + 1 ..., where there are any.
inline void scatter(Wavefront& wavefront, size_t i, Mask in_medium, Mask on_surface,
                    Mask at_boundary) {
  for (UintColumn& medium : wavefront.paths.medium) {
    const Uints met = medium_at(wavefront.media, load(wavefront.crossings.triangle, i));
    store(hn::IfThenElse(for_uints(at_boundary), met, load(medium, i)), medium, i);
  }
  const Vertices vertices = vertices_of(wavefront, i, in_medium, on_surface, at_boundary);
  multiply_by_factor(wavefront, i, vertices);
  if (wavefront.switches.techniques != Switches::Techniques::kPhaseOnly) {
    send_shadow_rays(wavefront, i, vertices);
  }
  send_outline_rays(wavefront, i, vertices);
  sample_direction(wavefront, i, vertices);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
