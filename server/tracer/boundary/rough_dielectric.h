// A rough surface between two transparent media: microfacets of the distribution GGX, each smooth
// (Walter et al., "Microfacet models for refraction through rough surfaces", EGSR 2007). Light that
// meets more than one of them, which that model loses, goes on without a preferred direction.
#ifndef ITN_TRACER_BOUNDARY_ROUGH_DIELECTRIC_H_
#define ITN_TRACER_BOUNDARY_ROUGH_DIELECTRIC_H_

#include <array>
#include <cstddef>
#include <memory>

namespace itn::tracer {

// Which part M of the light that arrives under an angle meets more than one microfacet.
struct LostLight {
  // By side, first that around the medium, and by the root of the angle's cosine at equal distances
  // in [0, 1]: M.
  static constexpr size_t kCosines = 32;
  using Table = std::array<float, 2 * kCosines>;
  Table part{};
  // By side: the mean of M over light from all directions alike.
  std::array<float, 2> mean{};
  // 1 / (mean outside + index^2 mean inside).
  float norm = 0;
  // The derivatives of M and the norm, by slot: in the index and the roughness.
  std::array<Table, 2> slopes{};
  std::array<float, 2> norm_slopes{};
};

struct RoughDielectric {
  float index = 1.5F;       // of refraction, of the medium, relative to what is around it
  float roughness = 0.25F;  // alpha of GGX

  // Walter's model alone, as in other renderers: what meets more than one microfacet is lost.
  bool single_scattering = false;
  // Once it is compiled, unless that is so.
  std::shared_ptr<const LostLight> lost = nullptr;

  static constexpr const char* kName = "rough_dielectric";
  template <typename Self, typename Fields>
  static void fields(Self& self, Fields& to) {
    to.slot("index", self.index, 1.1, 2.5);
    to.slot("roughness", self.roughness, 0.001, 1);
    to.flag("single_scattering", self.single_scattering);
  }
  RoughDielectric compile() const;

  static constexpr bool kStopsLines = true, kDelta = false;
  static constexpr size_t kIndexSlot = 0, kRoughnessSlot = 1;
  double relative_index() const { return double{index}; }
  double refraction_spread() const { return double{roughness} * (1 - 1 / double{index}); }
};

}  // namespace itn::tracer

#endif

// What it computes, once for each set of instructions.
#if defined(ITN_KERNEL) && \
    defined(ITN_TRACER_BOUNDARY_ROUGH_DIELECTRIC_MATHS_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_BOUNDARY_ROUGH_DIELECTRIC_MATHS_
#undef ITN_TRACER_BOUNDARY_ROUGH_DIELECTRIC_MATHS_
#else
#define ITN_TRACER_BOUNDARY_ROUGH_DIELECTRIC_MATHS_
#endif

#include <numbers>

#include "server/tracer/boundary/fresnel-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// How much of the microfacets that face a direction it sees (Smith's G_1), with c the cosine of its
// angle to the normal, and the derivatives of the logarithm of that in alpha and c:
//   2 c / (c + r),    r^2 = c^2 + alpha^2 (1 - c^2).
struct Seen {
  Floats part, score, by_cosine;
};
HWY_INLINE Seen seen(Floats cosine, float alpha) {
  const Floats c2 = cosine * cosine;
  const Floats sine2 = hn::Max(hn::Zero(FloatTag()), 1 - c2);
  const Floats r = hn::Sqrt(mul_add(set(alpha * alpha), sine2, c2)), sum = cosine + r;
  const Floats d_r = (1 - alpha * alpha) * cosine / r;
  return {(cosine + cosine) / sum, -(alpha * sine2 / (r * sum)),
          1 / hn::Max(cosine, set(1e-6F)) - (1 + d_r) / sum};
}

// Along the boundary there is nothing to divide by.
HWY_INLINE Floats cosine_of_arrival(const Crossing& crossing) {
  return hn::Max(-dot(crossing.direction, crossing.normal), set(1e-6F));
}

// With i the direction back to where the path came from, o where it goes, m the normal of the
// microfacet that sends it there, n that of the boundary, and alpha the roughness, i sees m with
// the density
//   G_1(i) (i.m) D / (i.n),    D = alpha^2 / (pi (alpha^2 (m.n)^2 + |m x n|^2)^2).
// With e the index ahead, and F the reflectance by Fresnel, m and the density of o are
//   m ~ i + o,      pdf = F density / (4 (i.m))                       of a reflection,
//   m ~ i + e o,    pdf = (1 - F) density e^2 |o.m| / |i + e o|^2     of a refraction,
// and value = pdf G_1(o): what of it o sees. For the score in the index, o stays and m turns by
//   dm/de = (o - (o.m) m) / (m.(i + e o)).
HWY_INLINE BoundaryValue walter(const RoughDielectric& boundary, const Crossing& crossing,
                                Vectors o) {
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  const float alpha = boundary.roughness, alpha2 = alpha * alpha;
  const Vectors n = crossing.normal, i = Vectors{zero, zero, zero} - crossing.direction;
  const Floats i_n = cosine_of_arrival(crossing), o_n = dot(o, n);
  const Mask reflects = o_n > 0;
  const Floats e = index_ahead(boundary.index, crossing.leaving);

  const Vectors h = i + o * hn::IfThenElse(reflects, one, e);
  const Floats h2 = hn::Max(dot(h, h), set(1e-12F));
  const Floats per_h = hn::CopySign(one, dot(h, n)) / hn::Sqrt(h2);
  const Vectors m = h * per_h;
  const Floats i_m = dot(i, m), o_m = dot(o, m), n_m = dot(n, m);
  const Mask on_their_sides = !(reflects ^ (o_m > 0));
  const Mask possible = (i_m > 0) & on_their_sides;

  const Vectors off = cross(m, n);
  const Floats n_m2 = n_m * n_m, spread = mul_add(set(alpha2), n_m2, dot(off, off));
  const Seen by_i = seen(i_n, alpha), by_o = seen(hn::Abs(o_n), alpha);
  const Floats density = alpha2 * std::numbers::inv_pi_v<float> * by_i.part /
                         (i_n * (spread * spread));  // without i.m
  const Floats reflected = fresnel(hn::Max(i_m, zero), e).reflected;
  const Floats reflection = 0.25F * reflected;
  const Floats refraction = (1 - reflected) * i_m * (e * e * hn::Abs(o_m)) / h2;
  const Floats pdf =
      hn::IfThenElseZero(possible, density * hn::IfThenElse(reflects, reflection, refraction));
  const Floats by_roughness = by_i.score + by_o.score - (4 * alpha * n_m2 / spread - 2 / alpha);

  Floats by_index = zero;
  if (crossing.asked.index) {
    const Floats least = set(1e-6F), i_o = dot(i, o);
    const Floats d_i_m = per_h * (i_o - i_m * o_m);
    const Floats d_o_m = per_h * (1 - o_m * o_m);
    const Floats d_n_m = per_h * (o_n - n_m * o_m);
    const Floats d_reflected =
        reflected_slope(hn::Max(i_m, zero), e, hn::IfThenZeroElse(reflects, d_i_m), one);
    const Floats of_reflection = d_reflected / hn::Max(reflected, least);
    const auto log_slope = [&](Floats d, Floats x) { return d / hn::Max(x, least); };
    const Floats of_power =
        log_slope(d_i_m, i_m) - log_slope(d_o_m, -o_m) - log_slope(d_reflected, 1 - reflected);
    const Floats of_angles = 1 / e - (i_o + e) / h2;
    const Floats of_spread = 2 * (1 - alpha2) * n_m * d_n_m / spread;
    const Floats of_refraction = mul_add(set(2.0F), of_angles + of_spread, of_power);
    const Floats d_e = hn::IfThenElse(crossing.leaving, -(e * e), one);
    by_index = hn::IfThenElse(reflects, of_reflection, of_refraction) * d_e;
  }
  BoundaryValue result{
      pdf * by_o.part,
      pdf,
      {hn::IfThenElseZero(possible, by_index), hn::IfThenElseZero(possible, by_roughness)}};
  if (crossing.asked.normal) {
    const Floats by_spread = 4 * (1 - alpha2) * n_m / spread;
    const Vectors slope =
        i * (by_i.by_cosine - 1 / i_n) + o * hn::CopySign(by_o.by_cosine, o_n) + m * by_spread;
    result.by_normal = if_then_else(possible, slope, result.by_normal);
  }
  return result;
}

// The model is not 0 where it ends: level microfacets, n.m = 0, refract, and whereto turns with the
// index and the normal. So the derivative of light in the index has another part than value times
// score: the light from there, by the density of level microfacets times n.dm/de; and that in the
// normal, by the same density times m. They are drawn by their i.m.
HWY_INLINE BoundaryEdge edge(const RoughDielectric& boundary, const Crossing& crossing, Floats u) {
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  const Vectors n = crossing.normal, i = Vectors{zero, zero, zero} - crossing.direction;
  const Floats i_n = cosine_of_arrival(crossing);
  const Vectors level = i - n * i_n;
  const Floats sine = hn::Sqrt(dot(level, level));
  const Vectors axis = level * (1 / hn::Max(sine, set(1e-6F)));
  const Floats across = u + u - 1;
  const Floats along = hn::Sqrt(hn::Max(zero, 1 - across * across));
  const Vectors m = axis * along + cross(n, axis) * across;
  const Floats i_m = sine * along, e = index_ahead(boundary.index, crossing.leaving);
  const auto [reflected, refracted_cosine] = fresnel(i_m, e);
  const Vectors o = refracted(crossing.direction, m, i_m, refracted_cosine, e), h = i + o * e;
  const float alpha = boundary.roughness;
  const Floats o_n = hn::Max(-dot(o, n), zero);
  const Floats d_e = hn::IfThenElse(crossing.leaving, e * e, one);
  const Floats turn = o_n * d_e / hn::Sqrt(hn::Max(dot(h, h), set(1e-12F)));
  const Floats density = seen(i_n, alpha).part * sine / i_n;
  const Floats passing = (1 - reflected) * seen(o_n, alpha).part;
  return {o, 2 * alpha * alpha * std::numbers::inv_pi_v<float> * density * passing, turn, m};
}

// M of light that arrives under an angle on either side, and its derivatives by slot.
struct Lost {
  Floats part, slopes[2], by_cosine;  // and in that
};
HWY_INLINE Lost lost_at(const LostLight& table, Mask inside, Floats cosine,
                        BoundaryDerivatives asked) {
  constexpr auto kLast = static_cast<float>(LostLight::kCosines - 1);
  const Floats place = hn::Sqrt(hn::Min(cosine, set(1.0F))) * kLast;
  const Floats below = hn::Min(hn::Floor(place), set(kLast - 1)), t = place - below;
  const Floats first = hn::IfThenElseZero(inside, set(kLast + 1));
  const Ints k = hn::ConvertTo(IntTag(), first + below);
  const auto step = [&](const auto& column, Floats a) {
    return hn::GatherIndex(FloatTag(), column.data() + 1, k) - a;
  };
  const auto mixed = [&](const auto& column) {
    const Floats a = hn::GatherIndex(FloatTag(), column.data(), k);
    return mul_add(t, step(column, a), a);
  };
  const Floats none = hn::Zero(FloatTag());
  Lost lost{mixed(table.part),
            {asked.index ? mixed(table.slopes[RoughDielectric::kIndexSlot]) : none,
             mixed(table.slopes[RoughDielectric::kRoughnessSlot])},
            none};
  if (asked.normal) {  // by the root of the cosine
    const Floats a = hn::GatherIndex(FloatTag(), table.part.data(), k);
    lost.by_cosine = step(table.part, a) * (kLast * kLast / 2) / hn::Max(place, set(1e-3F));
  }
  return lost;
}

// To Walter's value, light is added that keeps all: with M of the two angles and sides, n_o the
// index where it goes, and the norm K,
//   M(i) M(o) K n_o^2 |o.n| / pi,
// which over all o, on both sides, makes M(i), and is reciprocal (after Kulla, Conty, "Revisiting
// physically based shading at Imageworks", SIGGRAPH course 2017). It is drawn with probability
// M(i), by the means on both sides, and the cosine law.
HWY_INLINE BoundaryValue evaluate(const RoughDielectric& boundary, const Crossing& crossing,
                                  Vectors o) {
  const BoundaryValue once = walter(boundary, crossing, o);
  if (boundary.lost == nullptr) return once;
  const LostLight& table = *boundary.lost;
  const Floats zero = hn::Zero(FloatTag());
  const Floats o_n = dot(o, crossing.normal), cosine = hn::Abs(o_n);
  const Mask inside = crossing.leaving ^ (o_n <= 0);
  const Lost i_lost = lost_at(table, crossing.leaving, cosine_of_arrival(crossing), crossing.asked);
  const Lost o_lost = lost_at(table, inside, cosine, crossing.asked);
  const Floats index2 = hn::IfThenElse(inside, set(boundary.index * boundary.index), set(1.0F));
  const Floats law = index2 * cosine * std::numbers::inv_pi_v<float>;
  const Floats both = i_lost.part * o_lost.part;
  const Floats more = both * law * table.norm;
  const Floats mean = hn::IfThenElse(inside, set(table.mean[1]), set(table.mean[0]));
  const Floats more_pdf = law * mean * table.norm;
  const Floats value = once.value + more;
  BoundaryValue result{value, mul_add(i_lost.part, more_pdf - once.pdf, once.pdf), {zero, zero}};
  for (size_t s = 0; s < kMaxBoundarySlots; ++s) {
    if (s == RoughDielectric::kIndexSlot && !crossing.asked.index) continue;
    const Floats both_slope =
        mul_add(i_lost.slopes[s], o_lost.part, i_lost.part * o_lost.slopes[s]);
    Floats more_slope = law * mul_add(both_slope, set(table.norm), both * table.norm_slopes[s]);
    if (s == RoughDielectric::kIndexSlot) {  // and of the law
      const Floats by_law = hn::IfThenElseZero(inside, set(2 / boundary.index));
      more_slope = mul_add(more, by_law, more_slope);
    }
    const Floats slope = mul_add(once.value, once.scores[s], more_slope);
    result.scores[s] = slope / hn::Max(value, set(1e-20F));
  }
  if (crossing.asked.normal) {
    const auto log_slope = [](const Lost& of) { return of.by_cosine / of.part; };
    const Floats by_o = log_slope(o_lost) + 1 / hn::Max(cosine, set(1e-6F));
    const Vectors more_slope = o * (more * by_o * hn::CopySign(set(1.0F), o_n)) -
                               crossing.direction * (more * log_slope(i_lost));
    result.by_normal =
        (once.by_normal * once.value + more_slope) * (1 / hn::Max(value, set(1e-20F)));
  }
  return result;
}

// The microfacet, among those that i sees (Dupuy, Benyoub, "Sampling visible GGX normals with
// spherical caps", HPG 2023).
HWY_INLINE Vectors sample_microfacet(const RoughDielectric& boundary, const Crossing& crossing,
                                     Floats u0, Floats u1) {
  const Floats zero = hn::Zero(FloatTag());
  const Vectors n = crossing.normal;
  const Floats alpha = set(boundary.roughness), i_n = cosine_of_arrival(crossing);
  // With all stretched along the boundary so that the microfacets make a hemisphere.
  const auto stretched = [&](Vectors v, Floats v_n) {
    return normalize((v - n * v_n) * alpha + n * v_n);
  };
  const Vectors w = stretched(Vectors{zero, zero, zero} - crossing.direction, i_n);
  const Floats w_n = dot(w, n);
  const Floats z = (1 - u0) * (1 + w_n) - w_n;
  const Floats sine = hn::Sqrt(hn::Max(zero, 1 - z * z));
  const SinCos phi = sin_cos_2pi(u1);
  const Vectors h = w + frame_to_world(n, sine * phi.cos, sine * phi.sin, z);
  return stretched(h, hn::Max(dot(h, n), set(1e-7F)));
}

HWY_INLINE BoundaryDraw draw(const RoughDielectric& boundary, const Crossing& crossing,
                             const Words& words) {
  const Floats zero = hn::Zero(FloatTag()), one = set(1.0F);
  const Floats u0 = uniform(words.w[0]), u1 = uniform(words.w[1]), u2 = uniform(words.w[2]);
  const Vectors m = sample_microfacet(boundary, crossing, u0, u1);
  const Floats i_m = hn::Max(zero, -dot(crossing.direction, m));
  const Floats index = index_ahead(boundary.index, crossing.leaving);
  const auto [reflected, refracted_cosine] = fresnel(i_m, index);
  Mask transmitted = u2 >= reflected;
  Vectors o =
      if_then_else(transmitted, refracted(crossing.direction, m, i_m, refracted_cosine, index),
                   mirrored(crossing.direction, m));
  if (boundary.lost != nullptr) {
    const LostLight& table = *boundary.lost;
    const Lost lost = lost_at(table, crossing.leaving, cosine_of_arrival(crossing), crossing.asked);
    const Mask more = uniform(words.w[3]) < lost.part;
    const Mask outside = u2 < table.norm * table.mean[0];
    const Mask through = !(crossing.leaving ^ outside);
    const SinCos phi = sin_cos_2pi(u1);
    const Floats sine = hn::Sqrt(u0), cosine = hn::Sqrt(1 - u0);
    const Vectors spread = frame_to_world(crossing.normal, sine * phi.cos, sine * phi.sin,
                                          hn::IfThenElse(through, -cosine, cosine));
    o = if_then_else(more, spread, o);
    transmitted = (more & through) | hn::AndNot(more, transmitted);
  }
  const Mask on_its_side = transmitted ^ (dot(o, crossing.normal) > 0);
  return {o, transmitted, hn::IfThenElseZero(on_its_side, one)};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
