#include "server/tracer/simd/targets.h"
// After targets.h:
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/tracer/boundary/rough_dielectric.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h:
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "server/tracer/boundary/rough_dielectric.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Of the light that arrives, which part goes on, and the derivative of that in the roughness:
// averaged over a lattice of microfacets.
std::array<double, 2> going_on(const RoughDielectric& boundary, bool leaving, float cosine) {
  constexpr size_t kMicrofacets = 4096;
  constexpr float kGolden = 0.618034F;
  const FloatTag d;
  const Floats zero = hn::Zero(d), one = set(1.0F), half = set(0.5F);
  const float sine = std::sqrt(1 - cosine * cosine);
  const Vectors up = set(Vec3f{0, 0, 1});
  const Crossing at = crossing_of(set(Vec3f{sine, 0, leaving ? cosine : -cosine}), up, up,
                                  hn::FirstN(d, leaving ? lanes() : 0), true, false);
  const Floats index = index_ahead(boundary.index, at.leaving);
  double part = 0, slope = 0;
  for (size_t k = 0; k < kMicrofacets; k += lanes()) {
    const Floats number = hn::Iota(d, static_cast<float>(k));
    const Floats u0 = hn::Mul(hn::Add(number, half), set(1.0F / kMicrofacets));
    const Floats turns = hn::Mul(number, set(kGolden)), u1 = hn::Sub(turns, hn::Floor(turns));
    const Vectors m = sample_microfacet(boundary, at, u0, u1);
    const Floats i_m = hn::Max(zero, hn::Neg(dot(at.direction, m)));
    const auto [reflected, refracted_cosine] = fresnel(i_m, index);
    Floats sum = zero, slopes = zero;
    const auto add = [&, reflected = reflected](Vectors to, bool transmitted) {
      const BoundaryValue value = walter(boundary, at, to);
      const Floats off = dot(to, at.normal);
      const Mask on_its_side = hn::Gt(transmitted ? hn::Neg(off) : off, zero);
      const Mask possible = hn::And(on_its_side, hn::Gt(value.pdf, zero));
      const Floats probability = transmitted ? hn::Sub(one, reflected) : reflected;
      const Floats weight = hn::Div(value.value, hn::Max(value.pdf, set(1e-20F)));
      const Floats added = hn::IfThenElseZero(possible, hn::Mul(probability, weight));
      sum = hn::Add(sum, added);
      slopes = mul_add(added, value.scores[RoughDielectric::kRoughnessSlot], slopes);
    };
    add(mirrored(at.direction, m), false);
    add(refracted(at.direction, m, i_m, refracted_cosine, index), true);
    // One after the other, so that every width of vectors adds up to the same.
    alignas(64) float parts[kMaxLanes], part_slopes[kMaxLanes];
    hn::Store(sum, d, parts);
    hn::Store(slopes, d, part_slopes);
    for (size_t lane = 0; lane < lanes(); ++lane) {
      part += double{parts[lane]} / kMicrofacets;
      slope += double{part_slopes[lane]} / kMicrofacets;
    }
  }
  return {part, slope};
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace itn::tracer {

HWY_EXPORT(going_on);

namespace {

constexpr size_t kCosines = LostLight::kCosines;

// The integral over directions of a function of the cosine that is linear between the places of the
// table, times cosine / pi.
double mean(const float* table) {
  constexpr size_t kParts = 64 * (kCosines - 1);
  double sum = 0;
  for (size_t k = 0; k < kParts; ++k) {
    const double root = (static_cast<double>(k) + 0.5) / kParts;
    const double place = root * static_cast<double>(kCosines - 1);
    const auto below = static_cast<size_t>(place);
    const double t = place - static_cast<double>(below);
    const double value = double{table[below]} * (1 - t) + double{table[below + 1]} * t;
    sum += value * 4 * root * root * root / kParts;  // 2 c dc
  }
  return sum;
}

// M and its derivative in the roughness.
struct LostByAngle {
  LostLight::Table part, slope;
};
LostByAngle lost_by_angle(const RoughDielectric& boundary) {
  LostByAngle lost{};
  for (size_t at = 0; at < lost.part.size(); ++at) {
    const float root = static_cast<float>(at % kCosines) / (kCosines - 1);
    const auto [part, slope] =
        HWY_DYNAMIC_DISPATCH(going_on)(boundary, at >= kCosines, std::max(root * root, 1e-4F));
    lost.part[at] = static_cast<float>(std::clamp(1 - part, 1e-6, 1.0));
    lost.slope[at] = static_cast<float>(-slope);
  }
  return lost;
}

// In the index, by a difference: the lattice of microfacets is the same.
LostLight::Table slope_by_index(const RoughDielectric& boundary) {
  constexpr float kStep = 0.01F;
  const auto part_at = [&](float index) {
    RoughDielectric other = boundary;
    other.index = index;
    return lost_by_angle(other).part;
  };
  const LostLight::Table above = part_at(boundary.index + kStep);
  const LostLight::Table below = part_at(boundary.index - kStep);
  LostLight::Table slope{};
  for (size_t at = 0; at < slope.size(); ++at) slope[at] = (above[at] - below[at]) / (2 * kStep);
  return slope;
}

}  // namespace

RoughDielectric RoughDielectric::compile() const {
  RoughDielectric result = *this;
  if (single_scattering) return result;
  const LostByAngle lost_here = lost_by_angle(*this);
  LostLight table;
  table.part = lost_here.part;
  table.slopes[kIndexSlot] = slope_by_index(*this);
  table.slopes[kRoughnessSlot] = lost_here.slope;
  const double index2 = double{index} * double{index};
  const double outside = mean(table.part.data()), inside = mean(table.part.data() + kCosines);
  const double norm = 1 / (outside + index2 * inside);
  table.mean = {static_cast<float>(outside), static_cast<float>(inside)};
  table.norm = static_cast<float>(norm);
  for (size_t s = 0; s < table.slopes.size(); ++s) {
    const float* slopes = table.slopes[s].data();
    double slope = mean(slopes) + index2 * mean(slopes + kCosines);
    if (s == kIndexSlot) slope += 2 * double{index} * inside;
    table.norm_slopes[s] = static_cast<float>(-norm * norm * slope);
  }
  result.lost = std::make_shared<const LostLight>(table);
  return result;
}

}  // namespace itn::tracer
#endif
