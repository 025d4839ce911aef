// The media of a scene: the object's, which the request says, and those of the other objects.
#if defined(ITN_TRACER_COLLECTED_MEDIA_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_MEDIA_INL_H_
#undef ITN_TRACER_COLLECTED_MEDIA_INL_H_
#else
#define ITN_TRACER_COLLECTED_MEDIA_INL_H_
#endif

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <numbers>
#include <vector>

#include "server/tracer/boundary/boundary.h"
#include "server/tracer/phase/phase_function.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"
#include "server/tracer/simd/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// A lobe of Henyey and Greenstein around an axis, with 1 - g its width: half of it lies within the
// root of 3 times that. Directions are told by t, the square of the distance of their ends from
// that of the axis, so that narrow lobes are resolved: 1 + g^2 - 2 g cosine = width^2 + g t.
struct Lobe {
  float width;
};
HWY_INLINE Floats density(const Lobe& lobe, Floats t) {
  const float g = 1 - lobe.width;
  const Floats spread = mul_add(set(g), t, set(lobe.width * lobe.width));
  const auto norm = static_cast<float>(lobe.width * (2 - lobe.width) / (4 * std::numbers::pi));
  return norm / (spread * hn::Sqrt(spread));
}
// By its cumulative distribution, 1 / width - 1 / sqrt(width^2 + g t) over its value at t = 4.
HWY_INLINE Floats sample_lobe(const Lobe& lobe, Floats u) {
  const float g = 1 - lobe.width, width2 = lobe.width * lobe.width;
  const Floats part = u * (2 * g / (1 + g)), left = 1 - part;
  const Floats odds = part * (2 - part) / (left * left);
  return odds * (width2 / g);
}

// What refracted shadow rays are aimed by (refracted_rays-inl.h).
struct Refraction {
  float index;  // of the medium, relative to what is around it
  Lobe lobe;
};

inline Refraction refraction_of(const Boundary& boundary) {
  return {static_cast<float>(relative_index(boundary)),
          {static_cast<float>(refraction_spread(boundary))}};
}

struct Medium {
  PhaseFunction phase;
  const Boundary& boundary;
  Refraction refraction;
  float sigma_t, albedo;
  size_t number;  // in Media::all

  Medium(const Material& material, const PhaseFunction& scatters, const Boundary& crossed,
         size_t place)
      : phase(scatters),
        boundary(crossed),
        refraction(refraction_of(crossed)),
        sigma_t(static_cast<float>(material.sigma_t)),
        albedo(static_cast<float>(material.albedo)),
        number(place) {}
  // Derivatives are in this one alone.
  bool of_object() const { return number == 0; }
};

// That of the object, and those of the others: at least one.
struct Media {
  std::vector<Medium> all;
  std::vector<uint32_t> first_triangles;  // of the others
  const bool several;

  Media(const Scene::Compiled& scene, const RenderRequest& request)
      : several(!scene.other_media.empty()) {
    all.emplace_back(request.material, phase_of(request), scene.boundary, 0);
    for (const auto& other : scene.other_media) {
      const HenyeyGreenstein phase{static_cast<float>(other.material.g)};
      all.emplace_back(other.material, phase, other.boundary, all.size());
      first_triangles.push_back(other.first_triangle);
    }
  }
  const Medium& object() const { return all.front(); }
};

// The number of the medium that triangles bound.
HWY_INLINE Uints medium_at(const Media& media, Uints triangles) {
  Uints medium = hn::Zero(UintTag());
  for (const uint32_t first : media.first_triangles) {
    const auto below = hn::Set(IntTag(), static_cast<int32_t>(first) - 1);
    const auto behind = hn::RebindMask(UintTag(), hn::BitCast(IntTag(), triangles) > below);
    medium = hn::IfThenElse(behind, medium + set(uint32_t{1}), medium);
  }
  return medium;
}

// The lanes whose medium is the object's; their numbers, else 0.
HWY_INLINE Mask in_object(const Media& media, Uints medium, Mask where) {
  return media.several ? where & equals(medium, 0) : where;
}
HWY_INLINE Floats of_object(const Media& media, Uints medium, Floats number) {
  return media.several ? hn::IfThenElseZero(equals(medium, 0), number) : number;
}

HWY_INLINE Floats if_then_else(Mask where, Floats a, Floats b) {
  return hn::IfThenElse(where, a, b);
}
template <typename Value>
HWY_INLINE Value with_scores(Mask where, const Value& a, Value b) {
  for (size_t s = 0; s < std::size(b.scores); ++s) {
    b.scores[s] = if_then_else(where, a.scores[s], b.scores[s]);
  }
  return b;
}
HWY_INLINE PhaseValue if_then_else(Mask where, const PhaseValue& a, PhaseValue b) {
  b.value = if_then_else(where, a.value, b.value);
  return with_scores(where, a, b);
}
HWY_INLINE BoundaryValue if_then_else(Mask where, const BoundaryValue& a, BoundaryValue b) {
  b.value = if_then_else(where, a.value, b.value);
  b.pdf = if_then_else(where, a.pdf, b.pdf);
  b.by_normal = if_then_else(where, a.by_normal, b.by_normal);
  return with_scores(where, a, b);
}
HWY_INLINE BoundarySample if_then_else(Mask where, const BoundarySample& a, BoundarySample b) {
  b.direction = if_then_else(where, a.direction, b.direction);
  b.transmitted = (where & a.transmitted) | hn::AndNot(where, b.transmitted);
  b.weight = if_then_else(where, a.weight, b.weight);
  b.pdf = if_then_else(where, a.pdf, b.pdf);
  b.edge_weight = if_then_else(where, a.edge_weight, b.edge_weight);
  b.by_normal = if_then_else(where, a.by_normal, b.by_normal);
  return with_scores(where, a, b);
}
HWY_INLINE Transmission if_then_else(Mask where, const Transmission& a, const Transmission& b) {
  return {if_then_else(where, a.direction, b.direction),
          if_then_else(where, a.reflected, b.reflected)};
}

// of(medium) of the medium that each lane is in.
template <typename Of>
HWY_INLINE auto by_medium(const Media& media, Uints medium, const Of& of) {
  auto result = of(media.object());
  for (uint32_t m = 1; m < media.all.size(); ++m) {
    result = if_then_else(equals(medium, m), of(media.all[m]), result);
  }
  return result;
}

HWY_INLINE Floats sigma_t_of(const Media& media, Uints medium) {
  return by_medium(media, medium, [](const Medium& of) { return set(of.sigma_t); });
}
HWY_INLINE Floats free_path_of(const Media& media, Uints medium) {
  return by_medium(media, medium, [](const Medium& of) { return set(1 / of.sigma_t); });
}

// What phase functions and boundaries say; those of the other objects have no scores.
template <typename Value>
HWY_INLINE Value scored(const Medium& of, Value value) {
  if (of.of_object()) return value;
  for (Floats& score : value.scores) score = hn::Zero(FloatTag());
  return value;
}
HWY_INLINE Crossing crossing_of(const Medium& of, Crossing at) {
  if (!of.of_object()) at.asked = {};
  return at;
}
HWY_INLINE PhaseValue evaluate_phase(const Media& media, Uints medium, Floats cosine) {
  return by_medium(media, medium,
                   [&](const Medium& of) { return scored(of, evaluate(of.phase, cosine)); });
}
HWY_INLINE BoundaryValue evaluate_boundary(const Media& media, Uints medium, const Crossing& at,
                                           Vectors to) {
  return by_medium(media, medium, [&](const Medium& of) {
    return scored(of, evaluate(of.boundary, crossing_of(of, at), to));
  });
}
HWY_INLINE BoundarySample sample_boundary(const Media& media, Uints medium, const Crossing& at,
                                          const Words& words) {
  return by_medium(media, medium, [&](const Medium& of) {
    return scored(of, sample(of.boundary, crossing_of(of, at), words));
  });
}
HWY_INLINE Transmission transmit_boundary(const Media& media, Uints medium, const Crossing& at) {
  return by_medium(media, medium, [&](const Medium& of) { return transmit(of.boundary, at); });
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
