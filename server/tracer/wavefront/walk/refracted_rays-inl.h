// Refracted shadow rays: next-event estimation through the boundary.
#if defined(ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_REFRACTED_RAYS_INL_H_
#endif

#include <cstddef>

#include "server/tracer/geometry/depth_grid-inl.h"
#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/phase/henyey_greenstein.h"
#include "server/tracer/wavefront/walk/aim-inl.h"
#include "server/tracer/wavefront/walk/state-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Light that leaves the medium through a boundary which refracts comes from a scattering at x to a
// point y of the boundary in direction w, and from there towards a light in direction l. With p the
// phase function, T the part of flights that reach y, b the density that the boundary draws l with
// and s that of the lights, three techniques find it, with these densities:
//
//   p(w) T b(l)   the walk flies to y, and meets the light behind it by itself
//   p(w) T s(l)   it flies to y, and sends a shadow ray from there
//   q(w) s(l)     x draws a light and sends a ray to y that is refracted towards it
//
// All are weighed by the balance heuristic. The second finds a small light in the few directions w
// that are refracted towards it alone, so it is noisy where light is not even; the third looks
// there. How likely it is against the walk, q / (p T), are its odds.
//
// q is a lobe of Henyey and Greenstein as wide as the boundary is rough, around the direction into
// which a smooth plane refracts the light, with the normal of the boundary nearby (CellNormals).
// Where the boundary is curved or far away, that aims badly, and the others find the light.
// Behind one that is nearly smooth (is_nearly_smooth) they hardly do: q aims by a search.
//
// Behind a smooth boundary, l follows from w. The walk finds it with p(w) T (1 - R), R being what
// the boundary reflects. A ray to a light that was drawn is aimed twice. First by the normal
// nearby, or straight if that faces elsewhere, to find a facet, a triangle of the boundary
// (Facets). It and those around it may refract the light to x, each by its plane or by the normals
// that are interpolated over it: one of the n that do is chosen, the ray is aimed at that, and
// counts if it is what it meets. Where none does, the search goes on by the plane of the facet that
// was found, once. So q(w) = s(l') dl'/dw / n, where l' is what the facet that w meets makes of w;
// or 0, if a search for l' does not find that facet. Where a walk has left the medium, a search is
// made to know that.
//
// Behind a nearly smooth boundary, the same search finds n ways of the light to x, and q is the
// mean of the lobes around them; where n is 0, it is the lobe from above. Walks that have left, and
// shadow rays that are sent from y, make a search to know q.
//
// A lamp is drawn by numbers, which make another l of it at x than at y: q is that at x, and s that
// at y, of the light that is seen in l. What lamps hide at x may be seen at y; so there is always a
// ray, unless a delta sends nothing to x. Behind a smooth boundary, the ray is sent to a point,
// that where l meets the plane across the middle of the lamp, and counts if that lamp is what is
// seen.
//
// After Hanika, Droske, Fascione, "Manifold next event estimation", EGSR 2015, who look for y.

// The normal of the boundary where it is nearest to points of the medium.
HWY_INLINE Vectors normal_near(const Wavefront& wave, Vectors x) {
  const Obstacles& obstacles = wave.scene.obstacles;
  return cell_normal(obstacles.cell_normals, cells_at(obstacles.depth_grid.cells, x));
}
HWY_INLINE Floats index_of(const Media& media, Uints medium) {
  return by_medium(media, medium, [](const Medium& of) { return set(of.refraction.index); });
}
// The plane of the boundary where it is nearest to what lies as far ahead as it is deep there.
HWY_INLINE Plane plane_ahead(const Wavefront& wave, Uints medium, Vectors x, Vectors direction) {
  const DepthGrid& depth_grid = wave.scene.obstacles.depth_grid;
  const Floats depth = quantized_depth(depth_grid, cells_at(depth_grid.cells, x));
  const auto third = static_cast<float>(depth_grid.cells.edge / 3);
  return {normal_near(wave, x + direction * (depth * third)), index_of(wave.media, medium)};
}

// The aim of the first ray from x for light in a direction `outer`.
HWY_INLINE Aim first_aim(const Wavefront& wave, Uints medium, Vectors x, Vectors outer) {
  return aim_at(wave.boundary_is_delta ? Plane{normal_near(wave, x), index_of(wave.media, medium)}
                                       : plane_ahead(wave, medium, x, outer),
                outer);
}

// The random numbers of refracted rays from the vertices of paths in any slots.
HWY_INLINE Words refraction_words(const Wavefront& wave, Ints slots) {
  const Paths& paths = wave.paths;
  return philox(gather(paths.vertex, slots), set(uint32_t{Sampler::kRefraction}),
                gather(paths.sample, slots), gather(paths.pixel, slots), wave.request.seed);
}

// What such rays are for, with `lamp` the one that the light is of, or 0; `distance` is that of
// what is no lamp.
HWY_INLINE Target target_at(const Lights& lights, Vectors x, Vectors outer, Uints lamp,
                            Floats distance) {
  LampMiddle middle{};
  if (lights.has_lamps()) {
    middle = seen_middle(lights, lamp, x);
    distance = hn::IfThenElse(not_zero(lamp), way_to_plane(middle, set(Vec3f{}), outer), distance);
  }
  const Mask is_point = distance < kInfinity;
  const Uints number = hn::IfThenElse(hn::Eq(lamp, hn::Zero(UintTag())), set(kPointLight), lamp);
  return {if_then_else(is_point, outer * distance, outer),
          hn::IfThenElseZero(for_uints(is_point), number), is_point, middle};
}
HWY_INLINE Target target_drawn(const Lights& lights, Vectors x, Uints lamp,
                               const LightSamples& light) {
  return target_at(lights, x, light.direction, lamp,
                   hn::IfThenElse(light.dense(), set(kInfinity), light.distance));
}
// From their columns. A lobe asks no density of the plane of a lamp.
template <typename SentRays>
HWY_INLINE Target target_of(const Wavefront& wave, const SentRays& sent, size_t i) {
  const Uints lamp = load(sent.lamp, i);
  const Vectors place = load(sent.to_light, i);
  LampMiddle middle{};
  if (!wave.boundary_is_delta) {
    middle = {hn::Sqrt(dot(place, place)), normalize(place)};
  } else if (wave.scene.lights.has_lamps()) {
    middle = seen_middle(wave.scene.lights, lamp, load(sent.origin, i));
  }
  return {place, lamp, not_zero(lamp), middle};
}

// How rays were sent first that have searched in vain.
template <typename SentRays>
HWY_INLINE Aim first_aim_of(const Wavefront& wave, const SentRays& sent, size_t i, Uints medium,
                            Mask where) {
  const Vectors x = if_then_else(where, load(sent.origin, i), set(Vec3f{}));
  return first_aim(wave, medium, x, target_of(wave, sent, i).direction());
}

HWY_INLINE Vectors scattered_at(const Paths& paths, size_t i) {
  const auto& at = paths.scattered_at;
  return {load(at[0], i), load(at[1], i), load(at[2], i)};
}

// The part of light that arrives when it goes so far in a medium.
HWY_INLINE Floats part_arriving(const Wavefront& wave, Uints medium, Floats length) {
  return exp(-(length * sigma_t_of(wave.media, medium)));
}

// The density of the lobe around a direction.
HWY_INLINE Floats lobe_pdf(const Wavefront& wave, Uints medium, Vectors axis, Vectors direction) {
  const Vectors off = direction - axis;
  return by_medium(wave.media, medium,
                   [&](const Medium& of) { return density(of.refraction.lobe, dot(off, off)); });
}
HWY_INLINE Vectors draw_in_lobe(const Wavefront& wave, Uints medium, Vectors axis,
                                const Words& words) {
  const Floats u = uniform(words.w[1]);
  const Floats t = by_medium(wave.media, medium,
                             [&](const Medium& of) { return sample_lobe(of.refraction.lobe, u); });
  const Floats cosine = 1 - 0.5F * t;
  const Floats sine2 = t * (1 - 0.25F * t);
  const Floats sine = hn::Sqrt(hn::Max(hn::Zero(FloatTag()), sine2));
  const SinCos phi = sin_cos_2pi(uniform(words.w[2]));
  return renormalize(frame_to_world(axis, sine * phi.cos, sine * phi.sin, cosine));
}

// How far rays go that search for a facet, in mm. The roulette does not shorten them: it judges the
// ray that is aimed at what they find, which may be much shorter.
HWY_INLINE Floats longest_search(const Wavefront& wave, Uints medium) {
  return by_medium(wave.media, medium,
                   [](const Medium& of) { return set(kMaxOpticalDepth / of.sigma_t); });
}
// A distance from x within which there is no boundary, in mm: that of the depth grid, as short as
// its cells and its steps may make it.
HWY_INLINE Floats least_depth(const Wavefront& wave, Vectors x) {
  constexpr float kLongestStep = 1.1F, kMiddles = 1.74F;  // two half diagonals of a cell
  const DepthGrid& depth_grid = wave.scene.obstacles.depth_grid;
  const Floats thirds = quantized_depth(depth_grid, cells_at(depth_grid.cells, x));
  const auto edge = static_cast<float>(depth_grid.cells.edge);
  return mul_add(thirds, set(edge / (3 * kLongestStep)), set(-kMiddles * edge));
}

// One over the density with which the walk went from where it scattered to a rough boundary, for
// paths in slots i, i + 1 ...; 0 for others.
HWY_INLINE Floats per_arrival(const Wavefront& wave, size_t i, Uints medium) {
  const Floats zero = hn::Zero(FloatTag()), walk_pdf = load(wave.paths.scattered_pdf[0], i);
  const Mask scattered = walk_pdf > 0;
  if (hn::AllFalse(FloatTag(), scattered)) return zero;
  const Floats arriving = part_arriving(wave, medium, load(wave.paths.rays.medium_length, i));
  return hn::IfThenElseZero(scattered, 1 / (walk_pdf * arriving));
}
// The odds there for light in the direction `to_light`, as it is seen from where they scattered.
HWY_INLINE Floats refraction_odds(const Wavefront& wave, size_t i, Uints medium, Vectors to_light) {
  const Floats per = per_arrival(wave, i, medium);
  if (hn::AllFalse(FloatTag(), per > 0)) return per;
  const Aim aim =
      aim_at(plane_ahead(wave, medium, scattered_at(wave.paths, i), to_light), to_light);
  const Floats pdf = lobe_pdf(wave, medium, aim.direction, load(wave.paths.rays.direction, i));
  return hn::IfThenElseZero(aim.possible, per * pdf);
}

// Sends rays from paths that leave the medium through a smooth boundary to find out whether a
// refracted one would have gone there (check_odds), and then, with which odds.
inline void send_odds(Wavefront& wave, size_t i, Mask leaving, Uints medium, const Crossing& at) {
  Paths& paths = wave.paths;
  OddsRays& sent = wave.odds_rays;
  const FloatTag d;
  const Floats zero = hn::Zero(d), walk_pdf = load(paths.scattered_pdf[0], i);
  Mask where = leaving & (walk_pdf > 0);
  if (hn::AllFalse(d, where)) return;
  const Lights& lights = wave.scene.lights;
  const Vectors up = set(Vec3f{0, 1, 0}), x = scattered_at(paths, i);
  const Floats index = index_of(wave.media, medium);
  const bool flat = wave.scene.obstacles.corner_normals.flat();
  const VectorColumn& normals = flat ? wave.crossings.normal : wave.crossings.smooth_normal;
  const Plane plane{if_then_else(where, load(normals, i), up), index};
  const Vectors inner = load(paths.rays.direction, i);
  const Aim along = aim_along(plane, inner);
  const auto [outer, reflected] = transmit_boundary(wave.media, medium, at);
  where &= along.possible;
  Vectors to_light = if_then_else(where, along.direction, up);
  Floats by_drawn = along.inner_by_outer, far = zero;
  Target target{to_light, hn::Zero(UintTag()), hn::FirstN(d, 0), {}};
  const Vectors y = load(paths.rays.position, i), to_boundary = y - x;
  if (lights.has_lamps()) {
    const Uints lamp = lamp_seen(lights, y, if_then_else(where, outer, up));
    const LampMiddle middle = seen_middle(lights, lamp, x);
    far = way_to_plane(middle, to_boundary, to_light);
    const Vectors to_point = to_boundary + to_light * far;
    const Mask to_lamp = not_zero(lamp);
    where = hn::AndNot(to_lamp & (far >= kInfinity), where);
    const Floats near = hn::Sqrt(dot(to_boundary, to_boundary));
    by_drawn = hn::IfThenElse(
        to_lamp, inner_by_straight(plane, middle, to_point, inner, to_light, near, far), by_drawn);
    target = {if_then_else(to_lamp, to_point, to_light), lamp, to_lamp, middle};
  }
  const Uints triangle = hn::IfThenElseZero(for_uints(where), load(wave.crossings.triangle, i));
  if (!flat) {
    const CurvedFacet facet =
        curved_facet(wave.scene.obstacles, hn::BitCast(IntTag(), triangle), x);
    by_drawn =
        inner_by_drawn(facet, bend_at(facet, index, to_boundary, target), index, target, far);
  }
  to_light = if_then_else(where, target.direction(), up);
  const Aim first = aim_at({normal_near(wave, x), index}, to_light);
  const Vectors search = if_then_else(first.possible, first.direction, to_light);
  const Floats pdf = drawn_pdf(lights, target.lamp, x, to_light) * by_drawn;
  where &= pdf < kMostDensity;
  const Floats arriving =
      (1 - reflected) * part_arriving(wave, medium, load(paths.rays.medium_length, i));
  const Mask asked = where & (pdf > 0);
  const Append append{asked, sent.count};
  append(x, sent.rays.position);
  append(search, sent.rays.direction);
  append(set(Rays::kInside), sent.rays.interaction);
  append(longest_search(wave, medium), sent.rays.max_medium_length);
  append(slots_from(i), sent.slot);
  append(pdf / (walk_pdf * arriving), sent.odds);
  append(x, sent.origin);
  append(target.place, sent.to_light);
  append(target.lamp, sent.lamp);
  append(triangle, sent.facet);
  append(to_boundary, sent.left);
  sent.count += hn::CountTrue(d, asked);
}

// Sends rays from paths at a nearly smooth boundary to find out how a refracted one would have gone
// there for a target (check_odds). `per` is what the odds are multiplied by, and `shadow_ray` the
// shadow ray that they are of.
inline void send_lobe_odds(Wavefront& wave, OddsRays& sent, size_t i, Mask where, Uints medium,
                           const Target& target, Floats per, Uints shadow_ray) {
  const Floats arrival = per_arrival(wave, i, medium);
  where &= arrival > 0;
  if (hn::AllFalse(FloatTag(), where)) return;
  const Vectors x = scattered_at(wave.paths, i), outer = target.direction();
  const Aim aim = first_aim(wave, medium, x, outer);
  const Append append{where, sent.count};
  append(x, sent.rays.position);
  append(if_then_else(aim.possible, aim.direction, outer), sent.rays.direction);
  append(set(Rays::kInside), sent.rays.interaction);
  append(longest_search(wave, medium), sent.rays.max_medium_length);
  append(slots_from(i), sent.slot);
  append(arrival * per, sent.odds);
  append(x, sent.origin);
  append(target.place, sent.to_light);
  append(target.lamp, sent.lamp);
  append(load(wave.paths.rays.direction, i), sent.left);
  append(shadow_ray, sent.shadow_ray);
  sent.count += hn::CountTrue(FloatTag(), where);
}

// From scatterings of the paths in slots i, i + 1 ..., towards lights that were drawn from there.
// Roulette before anything is traced, as of other shadow rays (send_shadow_rays). What they will
// carry is not known yet: where the aim was good a rough boundary lets through about q / index^2,
// and it may let 1 through where it was not.
inline void send_refracted_rays(Wavefront& wave, size_t i, Mask scattered, Uints medium,
                                Vectors position, const LightChoice& drawn,
                                const LightSamples& light, Floats roulette) {
  const FloatTag d;
  const Paths& paths = wave.paths;
  RefractedRays& sent = wave.refracted_rays;
  const Floats one = set(1.0F);
  const Mask dense = light.dense();
  const Floats index = index_of(wave.media, medium);
  const Uints lamp = lamp_drawn(wave.scene.lights, drawn.choice);
  const Target target = wave.searches_facets
                            ? target_drawn(wave.scene.lights, position, lamp, light)
                            : far_target(light.direction);
  const Aim aim = first_aim(wave, medium, position, light.direction);
  Mask where = wave.searches_facets ? scattered : scattered & aim.possible;
  if (hn::AllFalse(d, where)) return;
  Vectors direction = if_then_else(aim.possible, aim.direction, light.direction);
  Floats pdf = light.pdf, passing = one;
  Floats light_pdf = one;  // of q s, what is not in `pdf`
  if (wave.boundary_is_delta) {
    pdf = light.pdf * hn::IfThenElse(aim.possible, aim.inner_by_outer, one);
    where &= hn::RebindMask(d, hn::Eq(target.lamp, lamp));
  } else {
    const Vectors axis = direction;
    if (!wave.searches_facets) {
      direction = draw_in_lobe(wave, medium, axis,
                               random(wave, i, load(paths.vertex, i), Sampler::kRefraction));
    }
    pdf = lobe_pdf(wave, medium, axis, direction);
    passing = mul_add(pdf, 1 / (index * index), one);
    light_pdf = hn::IfThenElse(dense, light.pdf, one);
  }
  const PhaseValue phase =
      evaluate_phase(wave.media, medium, dot(load(paths.rays.direction, i), direction));
  Floats radiance = light.radiance;
  if (wave.scene.lights.has_lamps() || wave.collected.map_gradient.asked()) {
    radiance = hn::Max(radiance, hn::IfThenElseZero(dense, set(wave.mean_radiance())));
  }
  const Floats worth = radiance * (phase.value * passing) / (light_pdf * (pdf + phase.value));
  const Floats importance = path_importance(wave, i) * worth;
  const Floats limit = depth_limit(wave, importance, roulette);
  const Floats limit_mm = limit * free_path_of(wave.media, medium);
  where &= (worth > 0) & (limit > 0);
  if (wave.searches_facets) where = hn::AndNot(limit_mm < least_depth(wave, position), where);

  const Append append{where, sent.count};
  append(position, sent.rays.position);
  append(direction, sent.rays.direction);
  append(set(Rays::kInside), sent.rays.interaction);
  append(wave.searches_facets ? longest_search(wave, medium) : limit_mm,
         sent.rays.max_medium_length);
  append(slots_from(i), sent.slot);
  append(importance, sent.importance);
  append(target.place, sent.to_light);
  append(light.pdf, sent.light_pdf);
  if (wave.searches_facets) {  // what they bring is known later
    append(position, sent.origin);
    append(load(paths.rays.direction, i), sent.before);
    append(target.lamp, sent.lamp);
    append(limit_mm, sent.limit);
  } else {
    append(phase.value, sent.phase);
    append(pdf, sent.pdf);
  }
  if (!wave.boundary_is_delta) {
    append(light.radiance, sent.radiance);
    if (wave.part_count > 0) append(light.source, sent.source);
    if (wave.shadow_rays.rays.bounded) {
      append(drawn.choice, sent.choice);
      append(drawn.uniforms.u0, sent.u0);
      append(drawn.uniforms.u1, sent.u1);
    }
  }
  const Scores& scores = wave.collected.scores;
  const size_t of_phase = wave.searches_facets ? 0 : scores.phase_count();
  for (size_t s = 0; s < sent.scores.size(); ++s) {
    const Floats score = load(scores.of_path(s), i);
    append(s < of_phase ? score + phase.scores[s] : score, sent.scores[s]);
  }
  sent.count += hn::CountTrue(d, where);
}

// Copies how light was drawn, of rays to a rough boundary.
template <typename Copy>
inline void for_each_light_column(const RefractedRays& from, RefractedRays& to, const Copy& copy) {
  copy(from.radiance, to.radiance);
  copy(from.choice, to.choice);
  copy(from.u0, to.u0);
  copy(from.u1, to.u1);
  copy(from.source, to.source);
}
// Calls visit(column) for what shadow rays bring.
template <typename Visit>
inline void for_each_light_column(ShadowRays& rays, const Visit& visit) {
  visit(rays.light);
  for (FloatColumn& column : rays.per_radiance) visit(column);
}

// How they go on behind the boundary.
struct Exit {
  Vectors to_light;
  Floats distance, radiance;
  Uints source;         // as of LightSamples
  Floats per_radiance;  // what comes by radiance, its part that reaches the boundary apart
  Floats scores[kMaxBoundarySlots];
  Vectors normal_score = set(Vec3f{});  // see NormalScore
};

// Towards the light that was drawn.
HWY_INLINE Exit exit_of_rough(const Wavefront& wave, const RefractedRays& sent, size_t i,
                              Uints medium, const Crossing& at, Floats arriving) {
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  LightSamples light{load(sent.to_light, i), set(kInfinity), load(sent.radiance, i),
                     load(sent.light_pdf, i), load(sent.source, i)};
  if (wave.shadow_rays.rays.bounded) {
    const LightChoice drawn{load(sent.choice, i),
                            {zero, zero, load(sent.u0, i), load(sent.u1, i), Words{}}};
    light = seen_from(wave.scene.lights, load(sent.rays.position, i), drawn, light);
  }
  Exit exit{light.direction, light.distance, light.radiance, light.source, one, {zero}};
  const BoundaryValue boundary = evaluate_boundary(wave.media, medium, at, exit.to_light);
  const Floats phase = load(sent.phase, i), light_pdf = light.pdf;
  const Floats walk_pdf = phase * arriving;
  const Mask dense = light.dense();
  Floats pdf_sum = hn::IfThenElse(dense, light_pdf, one) * (load(sent.pdf, i) + walk_pdf);
  if (wave.switches.techniques == Switches::Techniques::kBoth) {
    pdf_sum += hn::IfThenElseZero(dense, walk_pdf * boundary.pdf);
  }
  exit.per_radiance = phase * boundary.value / pdf_sum;
  for (size_t s = 0; s < kMaxBoundarySlots; ++s) exit.scores[s] = boundary.scores[s];
  if (at.asked.normal) exit.normal_score = slope_outwards(at, boundary.by_normal);
  return exit;
}

// Whereto the boundary refracts them, where there are any.
HWY_INLINE Exit exit_of_smooth(const Wavefront& wave, const RefractedRays& sent, size_t i,
                               Uints medium, const Crossing& at, Floats arriving, Mask where) {
  const auto [direction, reflected] = transmit_boundary(wave.media, medium, at);
  const Vectors to_light = if_then_else(where, direction, set(Vec3f{0, 1, 0}));
  const Lights& lights = wave.scene.lights;
  const Vectors position = load(sent.rays.position, i);
  const auto [distance, light] = look(lights, position, to_light);
  const Floats passing = load(sent.phase, i) * (1 - reflected);
  const Uints lamp = lamp_seen(lights, position, to_light);
  const Mask as_drawn = hn::RebindMask(FloatTag(), hn::Eq(lamp, load(sent.lamp, i)));
  return {to_light,
          distance,
          hn::IfThenElseZero(as_drawn, light.radiance),
          lamp,
          hn::IfThenElseZero(as_drawn, passing / mul_add(passing, arriving, load(sent.pdf, i))),
          {hn::Zero(FloatTag())}};
}

// From the boundary they go on as shadow rays.
inline void leave(Wavefront& wave, const RefractedRays& sent, size_t i, Uints medium, Mask where) {
  const FloatTag d;
  if (hn::AllFalse(d, where)) return;
  const Floats zero = hn::Zero(d);
  const Vectors direction = load(sent.rays.direction, i);
  const Vectors flat_normal = load(wave.crossings.normal, i);
  const Crossing at = crossing_of(
      direction, load(wave.crossings.smooth_normal, i), flat_normal, hn::FirstN(d, lanes()),
      wave.scene.obstacles.corner_normals.flat(), wave.boundary_derivatives);
  const Floats length = load(sent.rays.medium_length, i);
  const Floats arriving = part_arriving(wave, medium, length);
  const Exit exit = wave.boundary_is_delta
                        ? exit_of_smooth(wave, sent, i, medium, at, arriving, where)
                        : exit_of_rough(wave, sent, i, medium, at, arriving);
  where &= (dot(flat_normal, exit.to_light) > 0) & (exit.per_radiance > 0);
  const Mask from_far = (load(sent.light_pdf, i) > 0) & hn::Eq(exit.distance, set(kInfinity));
  const size_t of_phase = wave.collected.scores.phase_count();
  add_shadow_rays(wave, where,
                  {.position = load(sent.rays.position, i),
                   .direction = exit.to_light,
                   .interaction = hn::Zero(UintTag()),
                   .slot = load(sent.slot, i),
                   .light = exit.radiance * exit.per_radiance,
                   .source = exit.source,
                   .importance = load(sent.importance, i),
                   .per_radiance = hn::IfThenElseZero(from_far, exit.per_radiance),
                   .distance = exit.distance,
                   .max_medium_length = zero,
                   .length_before = length,
                   .normal_score = exit.normal_score,
                   .triangle = load(wave.crossings.triangle, i)},
                  [&](size_t s) {
                    const Floats score = load(sent.scores[s], i);
                    return s < of_phase ? score : score + exit.scores[s - of_phase];
                  });
}

// Calls visit(number, place, live) for the facets around the ones that rays have met, one of each.
template <typename SentRays, typename Visit>
HWY_INLINE void for_each_facet(const Wavefront& wave, const SentRays& sent, size_t i, Uints medium,
                               Mask met, const Visit& visit) {
  const FloatTag d;
  const IntTag di;
  const Obstacles& obstacles = wave.scene.obstacles;
  const Facets& facets = obstacles.facets;
  const auto int_gather = [&](const std::vector<uint32_t>& from, Ints at) {
    return hn::GatherIndex(di, reinterpret_cast<const int32_t*>(from.data()), at);
  };
  const auto int_mask = [&](Mask mask) { return hn::RebindMask(di, mask); };
  const Ints triangle =
      hn::IfThenElseZero(int_mask(met), hn::BitCast(di, load(wave.crossings.triangle, i)));
  const Ints begin = int_gather(facets.first, triangle);
  const Ints end = int_gather(facets.first, triangle + hn::Set(di, 1));
  const Vectors x = load(sent.origin, i);
  const Target target = target_of(wave, sent, i);
  const Floats index = index_of(wave.media, medium);
  for (Ints at = begin;; at = at + hn::Set(di, 1)) {
    const Mask live = met & hn::RebindMask(d, at < end);
    if (hn::AllFalse(d, live)) return;
    const Ints number = int_gather(facets.around, hn::IfThenElse(int_mask(live), at, begin));
    visit(number, place_on(obstacles, number, index, x, target), live);
  }
}

// The facets that refract the light to where the rays begin: how many there are, and one of them,
// which u chooses, and where on it.
struct FacetChoice {
  Floats count;
  Ints facet;
  Vectors to;
};
// `known`: one that does, at `left` from there, if it is among them; `found`: whether it is.
template <typename SentRays>
HWY_INLINE FacetChoice choose_facet(const Wavefront& wave, const SentRays& sent, size_t i,
                                    Uints medium, Mask met, Floats u, Uints known, Vectors left,
                                    Mask& found) {
  constexpr float kSame = 1e-3F;
  const FloatTag d;
  const IntTag di;
  const Floats zero = hn::Zero(d), one = set(1.0F);
  const bool flat = wave.scene.obstacles.corner_normals.flat();
  FacetChoice choice{zero, hn::Zero(di), set(Vec3f{0, 1, 0})};
  found = hn::FirstN(d, 0);
  for_each_facet(wave, sent, i, medium, met, [&](Ints number, const Place& place, Mask live) {
    const Mask is_number = live & hn::RebindMask(d, hn::Eq(number, hn::BitCast(di, known)));
    Mask is_known = is_number, refracts = live & place.possible;
    if (flat) {
      refracts = is_known | refracts;
    } else {
      const Vectors beside = place.to - left;
      const Floats most = kSame * kSame * dot(place.to, place.to);
      is_known = is_number & refracts & (dot(beside, beside) < most);
    }
    found |= is_known;
    choice.count += hn::IfThenElseZero(refracts, one);
    // One in n is what u says of the n-th, and what is left of u says which of those before.
    const Floats part = 1 / choice.count;
    const Mask taken = refracts & (u < part);
    choice.facet = hn::IfThenElse(hn::RebindMask(di, taken), number, choice.facet);
    choice.to = if_then_else(taken, place.to, choice.to);
    const Floats other = hn::Min((u - part) / (1 - part), set(0x1.fffffep-1F));
    u = hn::IfThenElse(taken, u * choice.count, hn::IfThenElse(refracts, other, u));
  });
  return choice;
}

// The facets again, behind which the boundary is rough: how many there are, and the sum of the
// densities at `direction` of the lobes around where they aim.
struct LobeSum {
  Floats count, pdf;
};
template <typename SentRays>
HWY_INLINE LobeSum sum_lobes(const Wavefront& wave, const SentRays& sent, size_t i, Uints medium,
                             Mask met, Vectors direction) {
  const Floats zero = hn::Zero(FloatTag());
  LobeSum sum{zero, zero};
  for_each_facet(wave, sent, i, medium, met, [&](Ints /*number*/, const Place& place, Mask live) {
    const Mask refracts = live & place.possible;
    const Floats pdf = lobe_pdf(wave, medium, normalize(place.to), direction);
    sum.count += hn::IfThenElseZero(refracts, set(1.0F));
    sum.pdf += hn::IfThenElseZero(refracts, pdf);
  });
  return sum;
}

// Rays in these directions, from where those began that searched for a facet.
struct AimedRays {
  Vectors direction;
  Floats pdf;  // with which that was drawn, per steradian, times that of the light if it is a delta
  Ints facet;
};
inline void add_aimed(Wavefront& wave, size_t i, Uints medium, Mask where, const AimedRays& aimed) {
  const RefractedRays& sent = wave.refracted_rays;
  RefractedRays& again = wave.aimed_again;
  const PhaseValue phase =
      evaluate_phase(wave.media, medium, dot(load(sent.before, i), aimed.direction));
  const Append append{where, again.count};
  append(load(sent.origin, i), again.rays.position);
  append(aimed.direction, again.rays.direction);
  append(set(Rays::kInside), again.rays.interaction);
  append(load(sent.limit, i), again.rays.max_medium_length);
  append(load(sent.slot, i), again.slot);
  append(load(sent.importance, i), again.importance);
  append(phase.value, again.phase);
  append(aimed.pdf, again.pdf);
  append(load(sent.light_pdf, i), again.light_pdf);
  if (wave.boundary_is_delta) {
    append(load(sent.lamp, i), again.lamp);
    append(hn::BitCast(UintTag(), aimed.facet), again.facet);
  } else {
    append(target_of(wave, sent, i).direction(), again.to_light);
    for_each_light_column(sent, again,
                          [&](const auto& from, auto& to) { append(load(from, i), to); });
  }
  const size_t of_phase = wave.collected.scores.phase_count();
  for (size_t s = 0; s < sent.scores.size(); ++s) {
    const Floats score = load(sent.scores[s], i);
    append(s < of_phase ? score + phase.scores[s] : score, again.scores[s]);
  }
  again.count += hn::CountTrue(FloatTag(), where);
}

// In a lobe around an axis; `pdf_of(direction)` is the density of all lobes that it may be of.
template <typename PdfOf>
inline void aim_lobe(Wavefront& wave, size_t i, Ints slots, Uints medium, Mask where, Vectors axis,
                     const PdfOf& pdf_of) {
  if (hn::AllFalse(FloatTag(), where)) return;
  axis = if_then_else(where, axis, set(Vec3f{0, 1, 0}));
  const Vectors direction = draw_in_lobe(wave, medium, axis, refraction_words(wave, slots));
  add_aimed(wave, i, medium, where, {direction, pdf_of(direction), hn::Zero(IntTag())});
}

// At one of the facets around the one that they have met; returns where there is one.
inline Mask aim_again(Wavefront& wave, size_t i, Ints slots, Uints medium, Mask where) {
  const RefractedRays& sent = wave.refracted_rays;
  if (hn::AllFalse(FloatTag(), where)) return where;
  const Vectors x = load(sent.origin, i);
  const Floats u = uniform(refraction_words(wave, slots).w[0]);
  Mask found;
  const auto [count, facet, to] =
      choose_facet(wave, sent, i, medium, where, u, set(~uint32_t{0}), x, found);
  const Mask solved = where & (count > 0);
  if (hn::AllFalse(FloatTag(), solved)) return solved;
  if (!wave.boundary_is_delta) {
    const Vectors axis = normalize(to);
    const bool one_each = hn::AllFalse(FloatTag(), solved & (count > 1));
    aim_lobe(wave, i, slots, medium, solved, axis, [&](Vectors direction) {
      return one_each ? lobe_pdf(wave, medium, axis, direction)
                      : sum_lobes(wave, sent, i, medium, solved, direction).pdf / count;
    });
    return solved;
  }
  const Aim aim = aim_at_place(wave.scene.obstacles, facet, index_of(wave.media, medium), x,
                               target_of(wave, sent, i), to);
  const Floats pdf = load(sent.light_pdf, i) * aim.inner_by_outer / count;
  add_aimed(wave, i, medium, solved & (pdf > 0) & (pdf < kMostDensity),
            {aim.direction, pdf, facet});
  return solved;
}

// Moves rays that search on to the front of their list, behind those that are there already.
template <typename SentRays>
inline void keep_searching(Wavefront& wave, SentRays& sent, size_t i, Mask where, Vectors direction,
                           size_t& kept) {
  if (hn::AllFalse(FloatTag(), where)) return;
  const Append append{where, kept};
  const auto keep = [&](auto& column) { append(load(column, i), column); };
  if constexpr (requires { sent.limit; }) {
    for (auto* column : {&sent.limit, &sent.importance, &sent.light_pdf}) keep(*column);
    keep(sent.before);
    for (FloatColumn& score : sent.scores) keep(score);
    if (!wave.boundary_is_delta) {
      for_each_light_column(sent, sent,
                            [&](const auto& from, auto& to) { append(load(from, i), to); });
    }
  } else {
    keep(sent.odds);
    keep(sent.left);
    for (UintColumn* column : {&sent.facet, &sent.shadow_ray}) keep(*column);
  }
  append(load(sent.origin, i), sent.rays.position);
  for (VectorColumn* column : {&sent.origin, &sent.to_light}) keep(*column);
  for (UintColumn* column : {&sent.slot, &sent.lamp}) keep(*column);
  keep(sent.rays.max_medium_length);
  append(direction, sent.rays.direction);
  append(set(Rays::kInside), sent.rays.interaction);
  kept += hn::CountTrue(FloatTag(), where);
}

// Follows rays inside to the boundary, and calls visit(i, slots, met): of which paths they are, and
// which of them meet it.
template <typename SentRays, typename Visit>
inline void follow_to_boundary(Wavefront& wave, SentRays& sent, const Visit& visit) {
  const FloatTag d;
  follow_lines(wave.scene.obstacles, sent.rays, sent.count, Report::kEnds, &wave.crossings);
  for (size_t i = 0; i < sent.count; i += lanes()) {
    const Mask live = hn::FirstN(d, sent.count - i);
    const Uints end = load(sent.rays.outcome, i) & set(Rays::kEndMask);
    const Ints slots = slots_in(sent.slot, i, live);
    mark_leaked(wave.paths, live & equals(end, Rays::kLeaked), slots);
    visit(i, slots, live & equals(end, Rays::kCrossing));
  }
}

// Searches for facets: calls solve(i, slots, medium, met), which returns where there are some, for
// rays that have met the boundary. The others are aimed by the plane of what they have met, once
// more; where that is in vain, it calls give_up(i, slots, medium, met).
template <typename SentRays, typename Solve, typename GiveUp>
inline void search_facets(Wavefront& wave, SentRays& sent, const Solve& solve,
                          const GiveUp& give_up) {
  constexpr int kSearches = 2;
  for (int search = 1; sent.count > 0; ++search) {
    size_t kept = 0;
    follow_to_boundary(wave, sent, [&](size_t i, Ints slots, Mask met) {
      const Uints medium = wave.medium_in(slots);
      const Mask left = hn::AndNot(solve(i, slots, medium, met), met);
      if (hn::AllFalse(FloatTag(), left)) return;
      const Vectors normal =
          if_then_else(left, load(wave.crossings.normal, i), set(Vec3f{0, 1, 0}));
      const Aim next =
          aim_at({normal, index_of(wave.media, medium)}, target_of(wave, sent, i).direction());
      const Mask goes_on = search < kSearches ? left & next.possible : hn::FirstN(FloatTag(), 0);
      give_up(i, slots, medium, hn::AndNot(goes_on, left));
      keep_searching(wave, sent, i, goes_on, next.direction, kept);
    });
    sent.count = kept;
  }
}

inline void cross_refracted_rays(Wavefront& wave) {
  RefractedRays &first = wave.refracted_rays, &again = wave.aimed_again;
  if (!wave.searches_facets) {
    return follow_to_boundary(wave, first, [&](size_t i, Ints slots, Mask met) {
      leave(wave, first, i, wave.medium_in(slots), met);
    });
  }
  search_facets(
      wave, first,
      [&](size_t i, Ints slots, Uints medium, Mask met) {
        return aim_again(wave, i, slots, medium, met);
      },
      [&](size_t i, Ints slots, Uints medium, Mask met) {
        if (wave.boundary_is_delta) return;
        const Aim aim = first_aim_of(wave, first, i, medium, met);
        aim_lobe(wave, i, slots, medium, met & aim.possible, aim.direction, [&](Vectors direction) {
          return lobe_pdf(wave, medium, aim.direction, direction);
        });
      });
  if (again.count == 0) return;
  follow_to_boundary(wave, again, [&](size_t i, Ints slots, Mask met) {
    if (wave.boundary_is_delta) {
      const auto as_aimed = hn::Eq(load(wave.crossings.triangle, i), load(again.facet, i));
      met &= hn::RebindMask(FloatTag(), as_aimed);
    }
    leave(wave, again, i, wave.medium_in(slots), met);
  });
}

// The odds of walks (send_odds), where a search finds the facet that they left by.
inline void check_facets(Wavefront& wave) {
  OddsRays& sent = wave.odds_rays;
  FloatColumn& odds = wave.paths.odds[0];
  search_facets(
      wave, sent,
      [&](size_t i, Ints slots, Uints medium, Mask met) {
        const Floats zero = hn::Zero(FloatTag());
        Mask found;
        const FacetChoice choice = choose_facet(wave, sent, i, medium, met, zero,
                                                load(sent.facet, i), load(sent.left, i), found);
        const Floats own = load(sent.odds, i) / choice.count;
        hn::ScatterIndex(hn::IfThenElse(found, own, gather(odds.data(), slots)), FloatTag(),
                         odds.data(), slots);
        return met & (choice.count > 0);
      },
      [](size_t /*i*/, Ints /*slots*/, Uints /*medium*/, Mask /*met*/) {});
}

// The odds of what leaves through a nearly smooth boundary (send_lobe_odds): calls
// visit(i, slots, odds, where).
template <typename Visit>
inline void check_lobes(Wavefront& wave, OddsRays& sent, const Visit& visit) {
  search_facets(
      wave, sent,
      [&](size_t i, Ints slots, Uints medium, Mask met) {
        const LobeSum sum = sum_lobes(wave, sent, i, medium, met, load(sent.left, i));
        const Mask solved = met & (sum.count > 0);
        visit(i, slots, load(sent.odds, i) * (sum.pdf / sum.count), solved);
        return solved;
      },
      [&](size_t i, Ints slots, Uints medium, Mask met) {
        const Aim aim = first_aim_of(wave, sent, i, medium, met);
        const Floats pdf = lobe_pdf(wave, medium, aim.direction, load(sent.left, i));
        visit(i, slots, load(sent.odds, i) * pdf, met & aim.possible);
      });
}

inline void check_odds(Wavefront& wave) {
  if (!wave.searches_facets) return;
  if (wave.boundary_is_delta) return check_facets(wave);
  const FloatTag d;
  check_lobes(wave, wave.odds_rays, [&](size_t /*i*/, Ints slots, Floats odds, Mask where) {
    float* const of_paths = wave.paths.odds[0].data();
    hn::ScatterIndex(hn::IfThenElse(where, odds, gather(of_paths, slots)), d, of_paths, slots);
  });
  check_lobes(wave, wave.shadow_odds, [&](size_t i, Ints /*slots*/, Floats odds, Mask where) {
    const Ints rays = slots_in(wave.shadow_odds.shadow_ray, i, where);
    const Floats part = 1 / (1 + odds);
    for_each_light_column(wave.shadow_rays, [&](FloatColumn& light) {
      hn::ScatterIndex(gather(light.data(), rays) * part, d, light.data(), rays);
    });
  });
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
