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

// The part of the light that arrives and goes on, averaged over a lattice of microfacets; and the
// derivatives of that in the index, a difference over the same lattice, and in the roughness.
std::array<double, 3> going_on(const RoughDielectric& boundary, bool leaving, float cosine) {
  constexpr size_t kMicrofacets = 4096;
  constexpr float kGolden = 0.618034F;
  const FloatTag d;
  const Floats zero = hn::Zero(d), half = set(0.5F);
  const float sine = std::sqrt(1 - cosine * cosine);
  const Vectors up = set(Vec3f{0, 0, 1});
  const Crossing crossing = crossing_of(set(Vec3f{sine, 0, leaving ? cosine : -cosine}), up, up,
                                        hn::FirstN(d, leaving ? lanes() : 0), true, {});
  const Floats index = index_ahead(boundary.index, crossing.leaving);
  // With a third of it, microfacets at which total reflection sets in make 2 to 7 times the error.
  constexpr float kStep = 0.03F;
  const Floats above = index_ahead(boundary.index + kStep, crossing.leaving);
  const Floats below = index_ahead(boundary.index - kStep, crossing.leaving);
  std::array<double, 3> means{};
  for (size_t k = 0; k < kMicrofacets; k += lanes()) {
    const Floats number = hn::Iota(d, static_cast<float>(k));
    const Floats u0 = (number + half) * (1.0F / kMicrofacets);
    const Floats turns = number * kGolden, u1 = turns - hn::Floor(turns);
    const Vectors m = sample_microfacet(boundary, crossing, u0, u1);
    const Floats i_m = hn::Max(zero, -dot(crossing.direction, m));
    const auto [reflected, refracted_cosine] = fresnel(i_m, index);
    Floats sum = zero, slopes = zero;
    const auto add = [&, reflected = reflected](Vectors to, bool transmitted) {
      const BoundaryValue value = walter(boundary, crossing, to);
      const Floats off = dot(to, crossing.normal);
      const Mask on_its_side = (transmitted ? -off : off) > 0;
      const Mask possible = on_its_side & (value.pdf > 0);
      const Floats probability = transmitted ? 1 - reflected : reflected;
      const Floats weight = value.value / hn::Max(value.pdf, set(1e-20F));
      const Floats added = hn::IfThenElseZero(possible, probability * weight);
      sum += added;
      slopes = mul_add(added, value.scores[RoughDielectric::kRoughnessSlot], slopes);
    };
    add(mirrored(crossing.direction, m), false);
    add(refracted(crossing.direction, m, i_m, refracted_cosine, index), true);
    // What o sees of it is its weight.
    const auto sum_at = [&](Floats other_index) {
      const Fresnel other = fresnel(i_m, other_index);
      const Vectors through =
          refracted(crossing.direction, m, i_m, other.refracted_cosine, other_index);
      const auto seen_at = [&](Floats off) {
        return seen(hn::Max(off, zero), boundary.roughness).part;
      };
      return mul_add(other.reflected,
                     seen_at(dot(mirrored(crossing.direction, m), crossing.normal)),
                     (1 - other.reflected) * seen_at(-dot(through, crossing.normal)));
    };
    const Floats by_index = (sum_at(above) - sum_at(below)) / (2 * kStep);
    // One after the other, so that every width of vectors adds up to the same.
    for (size_t s = 0; const Floats addend : {sum, by_index, slopes}) {
      alignas(64) float parts[kMaxLanes];
      hn::Store(addend, d, parts);
      for (size_t lane = 0; lane < lanes(); ++lane) means[s] += double{parts[lane]} / kMicrofacets;
      ++s;
    }
  }
  return means;
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

// M and its slopes.
LostLight lost_by_angle(const RoughDielectric& boundary) {
  LostLight lost;
  for (size_t cell = 0; cell < lost.part.size(); ++cell) {
    const float root = static_cast<float>(cell % kCosines) / (kCosines - 1);
    const auto [part, by_index, by_roughness] =
        HWY_DYNAMIC_DISPATCH(going_on)(boundary, cell >= kCosines, std::max(root * root, 1e-4F));
    lost.part[cell] = static_cast<float>(std::clamp(1 - part, 1e-6, 1.0));
    lost.slopes[RoughDielectric::kIndexSlot][cell] = static_cast<float>(-by_index);
    lost.slopes[RoughDielectric::kRoughnessSlot][cell] = static_cast<float>(-by_roughness);
  }
  return lost;
}

}  // namespace

RoughDielectric RoughDielectric::compile() const {
  RoughDielectric result = *this;
  if (single_scattering) return result;
  LostLight table = lost_by_angle(*this);
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
