// The model of rough refraction, against its formulas as they are published.
#include "server/tracer/boundary/rough_dielectric.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "server/tracer/random/sampler.h"
#include "tests/server/tracer/lane_probes.h"
#include "tests/support/statistics.h"

namespace itn::testing {
namespace {

using namespace tracer;
constexpr double kPi = std::numbers::pi;
constexpr Vec3d kOutwards{0.36, 0.48, 0.8};

// Walter et al. 2007, equations 16 to 22, 33 and 34: f |o.n| for a path that goes from i back to
// where it came from on to o, where the index is n_i and n_o, radiance being counted over index^2.
double walter(Vec3d i, Vec3d o, double n_i, double n_o, double alpha) {
  const double cos_i = dot(i, kOutwards), cos_o = dot(o, kOutwards);
  const bool reflects = cos_i * cos_o > 0;
  Vec3d h = reflects ? i + o : i * -n_i - o * n_o;
  h = itn::normalize(h);
  if (dot(h, kOutwards) * cos_i < 0) h = -h;  // on the side of i
  const double i_h = dot(i, h), o_h = dot(o, h);
  if (i_h <= 0 || (reflects ? o_h <= 0 : o_h >= 0)) return 0;
  const auto tangent2 = [&](Vec3d v) { return 1 / std::pow(dot(v, kOutwards), 2) - 1; };
  const double cos_h = dot(h, kOutwards);
  const double d =
      alpha * alpha / (kPi * std::pow(cos_h, 4) * std::pow(alpha * alpha + tangent2(h), 2));
  const auto shadowing = [&](Vec3d v) {
    return 2 / (1 + std::sqrt(1 + alpha * alpha * tangent2(v)));
  };
  const double g = shadowing(i) * shadowing(o);
  const double k2 = std::pow(n_o / n_i, 2) - 1 + i_h * i_h;
  double f = 1;
  if (k2 > 0) {
    const double k = std::sqrt(k2), c = i_h;
    f = 0.5 * std::pow((k - c) / (k + c), 2) *
        (1 + std::pow((c * (k + c) - 1) / (c * (k - c) + 1), 2));
  }
  if (reflects) return f * g * d / (4 * std::abs(cos_i));
  return i_h * -o_h * n_o * n_o * (1 - f) * g * d /
         (std::abs(cos_i) * std::pow(n_i * i_h + n_o * o_h, 2));
}

struct Case {
  double index, roughness;
  bool leaving;
  double cosine;  // of the angle that the path arrives under
};
std::vector<Case> cases() {
  std::vector<Case> all;
  for (const double index : {1.1, 1.33, 1.5, 2.5}) {
    for (const double roughness : {0.003, 0.1, 0.25, 1.0}) {
      for (const bool leaving : {false, true}) {
        for (const double cosine : {1.0, 0.7, 0.05}) {
          all.push_back({index, roughness, leaving, cosine});
        }
      }
    }
  }
  return all;
}

RoughDielectric boundary_of(const Case& row) {
  return {static_cast<float>(row.index), static_cast<float>(row.roughness)};
}
// Walter's model alone, and with the light that it loses.
std::vector<RoughDielectric> both_of(const Case& row) {
  return {boundary_of(row), boundary_of(row).compile()};
}
std::string name_of(const Case& row) {
  return fmt::format("index {} roughness {} {} {}", row.index, row.roughness,
                     row.leaving ? "leaving" : "entering", row.cosine);
}

// The path of a case arrives.
BoundaryProbe probe_of(const Case& row) {
  BoundaryProbe probe;
  const Basis<double> basis(kOutwards);
  const double sine = std::sqrt(1 - row.cosine * row.cosine);
  probe.direction = static_cast<Vec3f>(
      basis.to_world(0.6 * sine, 0.8 * sine, row.leaving ? row.cosine : -row.cosine));
  probe.outwards = static_cast<Vec3f>(kOutwards);
  probe.leaving = row.leaving;
  return probe;
}
double oracle(const Case& row, const BoundaryProbe& probe, size_t slot) {
  const auto unit = [](Vec3f v) { return itn::normalize(static_cast<Vec3d>(v)); };
  return walter(unit(-probe.direction), unit(probe.to.at(slot)), row.leaving ? row.index : 1,
                row.leaving ? 1 : row.index, row.roughness);
}
// The same case, and its index or its roughness changed.
Case changed(Case row, size_t slot, double by) {
  (slot == RoughDielectric::kIndexSlot ? row.index : row.roughness) += by;
  return row;
}

// Directions that are drawn, and the same turned a little: where the model is not 0.
TEST(RoughDielectricTest, IsTheModelOfWalterWithItsSlopes) {
  for (const Case& row : cases()) {
    BoundaryProbe probe = probe_of(row);
    sample_boundary(boundary_of(row), 0, probe);
    for (size_t k = 0; k < kSlots; ++k) {
      const Uniforms u = Sampler(3, 0, static_cast<uint32_t>(k)).uniforms(0, 0);
      const float turn = static_cast<float>(row.roughness) * 0.3F;
      probe.to.set(
          k, itn::normalize(probe.to.at(k) + Vec3f{u[0] - 0.5F, u[1] - 0.5F, u[2] - 0.5F} * turn));
    }
    probe.asked.index = true;
    evaluate_boundary(boundary_of(row), probe);
    size_t looked_at = 0;
    for (size_t k = 0; k < kSlots; ++k) {
      const double cosine = dot(static_cast<Vec3d>(probe.to.at(k)), kOutwards);
      if (std::abs(cosine) < 1e-3) continue;  // rounding decides on which side it is
      const double expected = oracle(row, probe, k);
      // What rounding of directions does to the microfacet's, over how wide the model is.
      const double rounding = 3e-3 + 2e-6 / ((row.index - 1) * row.roughness);
      EXPECT_NEAR(double{probe.value[k]}, expected, rounding * (expected + 1e-3)) << name_of(row);
      if (expected < 1e-3) continue;
      ++looked_at;
      for (const size_t slot : {RoughDielectric::kIndexSlot, RoughDielectric::kRoughnessSlot}) {
        const bool is_index = slot == RoughDielectric::kIndexSlot;
        const double scale = is_index ? (row.index - 1) * row.roughness : row.roughness;
        const double step = scale * 1e-4;
        const double above = std::log(oracle(changed(row, slot, step), probe, k));
        const double below = std::log(oracle(changed(row, slot, -step), probe, k));
        const double slope = (above - below) / (2 * step);
        if (!std::isfinite(slope)) continue;  // next to where the model ends
        EXPECT_NEAR(double{probe.scores[slot][k]}, slope,
                    3 * rounding * (std::abs(slope) + 1 / scale))
            << name_of(row) << " slot " << slot;
      }
    }
    EXPECT_GT(looked_at, kSlots / 4) << name_of(row);
  }
}

// Integrals over all directions, by the midpoint rule.
double integral(const RoughDielectric& boundary, BoundaryProbe& probe,
                const std::function<double(const BoundaryProbe&, size_t)>& integrand,
                int rings = 2048) {
  constexpr int kAround = 2 * static_cast<int>(kSlots);
  const Basis<double> basis(kOutwards);
  double sum = 0;
  for (int ring = 0; ring < rings; ++ring) {
    const double z = (2 * ring + 1.0) / rings - 1, s = std::sqrt(1 - z * z);
    for (int first = 0; first < kAround; first += static_cast<int>(kSlots)) {
      for (size_t k = 0; k < kSlots; ++k) {
        const double phi = 2 * kPi * (first + static_cast<double>(k) + 0.5) / kAround;
        probe.to.set(k,
                     static_cast<Vec3f>(basis.to_world(s * std::cos(phi), s * std::sin(phi), z)));
      }
      evaluate_boundary(boundary, probe);
      for (size_t k = 0; k < kSlots; ++k) {
        sum += integrand(probe, k);
      }
    }
  }
  return sum * 4 * kPi / rings / kAround;
}

// The density of what is drawn integrates to the part that is not lost, and so do its moments; the
// weight is the value over it.
TEST(RoughDielectricTest, SamplesFollowTheDensity) {
  const std::vector<std::function<double(Vec3d)>> moments{
      [](Vec3d) { return 1.0; }, [](Vec3d o) { return dot(o, kOutwards); },
      [](Vec3d o) { return dot(o, kOutwards) > 0 ? 1.0 : 0.0; }, [](Vec3d o) { return o.x; },
      [](Vec3d o) { return o.y * o.z; }};
  for (const Case& row :
       {Case{1.5, 0.25, false, 0.7}, Case{1.5, 0.25, true, 0.8}, Case{1.33, 1, false, 0.3},
        Case{2.5, 0.5, true, 0.5}, Case{1.5, 1, true, 0.7}}) {
    for (const RoughDielectric& boundary : both_of(row)) {
      std::vector<std::vector<double>> drawn(moments.size());
      BoundaryProbe probe = probe_of(row);
      for (uint32_t batch = 0; batch < 2000; ++batch) {
        sample_boundary(boundary, batch, probe);
        BoundaryProbe again = probe;
        evaluate_boundary(boundary, again);
        std::vector<double> sums(moments.size());
        for (size_t k = 0; k < kSlots; ++k) {
          if (!(probe.weight[k] > 0)) continue;
          EXPECT_NEAR(double{probe.weight[k]}, double{again.value[k] / again.pdf[k]}, 1e-4);
          for (size_t m = 0; m < moments.size(); ++m) {
            sums[m] += moments[m](static_cast<Vec3d>(probe.to.at(k))) / kSlots;
          }
        }
        for (size_t m = 0; m < moments.size(); ++m) drawn[m].push_back(sums[m]);
      }
      for (size_t m = 0; m < moments.size(); ++m) {
        const std::string what =
            name_of(row) + (boundary.lost ? " all" : "") + fmt::format(", moment {}", m);
        const double expected = integral(boundary, probe, [&](const BoundaryProbe& p, size_t k) {
          return double{p.pdf[k]} * moments[m](static_cast<Vec3d>(p.to.at(k)));
        });
        expect_equal(over_batches(drawn[m]), {expected, 2e-5}, 50, what);
        if (m == 0) expect_resolution(over_batches(drawn[m]), expected, 0.01, what);
      }
    }
  }
}

using Moment = std::function<double(Vec3d)>;

// Moments of what goes on by Walter's model, over microfacets: as these do not turn with the index,
// all is smooth in it. With a quarter of the heights, derivatives in roughness are 3 % off; of
// those in the index, likewise, with a quarter of the places around.
std::vector<double> by_microfacets(const Case& row, const std::vector<Moment>& moments) {
  constexpr int kHeights = 2000, kAround = 1200;
  const Basis<double> basis(kOutwards);
  const BoundaryProbe probe = probe_of(row);
  const Vec3d i = itn::normalize(static_cast<Vec3d>(-probe.direction));
  const Vec3d n = row.leaving ? -kOutwards : kOutwards;
  const double e = row.leaving ? 1 / row.index : row.index;
  std::vector<double> sums(moments.size());
  for (int height = 0; height < kHeights; ++height) {
    const double z = (height + 0.5) / kHeights, s = std::sqrt(1 - z * z);
    for (int around = 0; around < kAround; ++around) {
      const double phi = 2 * kPi * (around + 0.5) / kAround;
      const Vec3d m = basis.to_world(s * std::cos(phi), s * std::sin(phi), row.leaving ? -z : z);
      const double i_m = dot(i, m);
      if (i_m <= 0) continue;
      // The model's value over the density of o, by that of m: reflected and refracted.
      const Vec3d mirrored = m * (2 * i_m) - i;
      const auto add = [&](Vec3d o, double factor) {
        const double value =
            walter(i, o, row.leaving ? row.index : 1, row.leaving ? 1 : row.index, row.roughness) *
            factor * 2 * kPi / kHeights / kAround;
        for (size_t k = 0; k < moments.size(); ++k) sums[k] += value * moments[k](o);
      };
      if (dot(mirrored, n) > 0) add(mirrored, 4 * i_m);
      const double k2 = 1 - (1 - i_m * i_m) / (e * e);
      if (k2 <= 0) continue;
      const double k = std::sqrt(k2);
      const Vec3d refracted = m * (i_m / e - k) - i * (1 / e);
      const Vec3d h = i + refracted * e;
      if (dot(refracted, n) < 0) add(refracted, dot(h, h) / (e * e * k));
    }
  }
  return sums;
}

// The table of what is lost, from within, where total reflection makes it hard.
TEST(RoughDielectricTest, TheTableKnowsItsSlopes) {
  constexpr size_t kCosines = LostLight::kCosines, kFirst = 13, kEvery = 6;
  for (Case row : {Case{1.4, 0.4, true, 0}, Case{1.4, 0.9, true, 0}, Case{1.5, 0.25, true, 0},
                   Case{2.5, 0.5, true, 0}}) {
    const RoughDielectric boundary = boundary_of(row).compile();
    for (const size_t slot : {RoughDielectric::kIndexSlot, RoughDielectric::kRoughnessSlot}) {
      double squares = 0;
      int places = 0;
      for (size_t at = kFirst; at < kCosines; at += kEvery, ++places) {
        row.cosine = std::pow(static_cast<double>(at) / (kCosines - 1), 2);
        const auto kept = [&](double by) {
          return by_microfacets(changed(row, slot, by), {[](Vec3d) { return 1; }})[0];
        };
        const double slope = (kept(-0.01) - kept(0.01)) / 0.02;
        squares += std::pow(double{boundary.lost->slopes[slot][kCosines + at]} - slope, 2);
      }
      fmt::print("  {} slot {}: rms {:.4f}\n", name_of(row), slot, std::sqrt(squares / places));
      EXPECT_LT(std::sqrt(squares / places), 0.008) << name_of(row) << " slot " << slot;
    }
  }
}

// What paths estimate of the derivative of a moment: by what is drawn, weight times score; by the
// edges that some follow, what these weigh.
Estimated derivative(const RoughDielectric& boundary, size_t slot, BoundaryProbe probe,
                     const Moment& moment) {
  probe.asked.index = slot == RoughDielectric::kIndexSlot;
  std::vector<double> batches;
  for (uint32_t batch = 0; batch < 2000; ++batch) {
    sample_boundary(boundary, batch, probe);
    double sum = 0;
    for (size_t k = 0; k < kSlots; ++k) {
      const double by_score = double{probe.weight[k]} * double{probe.scores[slot][k]};
      sum += (by_score + double{probe.edge_weight[k]}) *
             moment(static_cast<Vec3d>(probe.to.at(k))) / kSlots;
    }
    batches.push_back(sum);
  }
  return over_batches(batches);
}

const std::vector<Moment> kMoments{[](Vec3d) { return 1; },
                                   [](Vec3d o) { return dot(o, kOutwards); },
                                   [](Vec3d o) { return o.x; }};

// Moments of what is added for the light that is lost, as parts of that.
std::vector<double> moments_of_added(const Case& row) {
  BoundaryProbe probe = probe_of(row);
  const std::vector<RoughDielectric> both = both_of(row);
  std::vector<double> parts;
  for (const Moment& moment : kMoments) {
    const auto part = [&](const BoundaryProbe& p, size_t k) {
      return double{p.value[k]} * moment(static_cast<Vec3d>(p.to.at(k)));
    };
    parts.push_back(integral(both[1], probe, part, 256) - integral(both[0], probe, part, 256));
  }
  const double whole = parts[0];
  for (double& part : parts) part /= whole;
  return parts;
}

TEST(RoughDielectricTest, PathsEstimateDerivatives) {
  for (const Case& row :
       {Case{1.5, 0.25, false, 0.7}, Case{1.5, 0.4, true, 0.8}, Case{1.4, 0.4, true, 0.5},
        Case{2.5, 0.5, true, 0.5}, Case{1.5, 0.9, false, 0.4}, Case{1.4, 0.9, true, 0.3}}) {
    for (const size_t slot : {RoughDielectric::kIndexSlot, RoughDielectric::kRoughnessSlot}) {
      const auto by = [&](double step) { return changed(row, slot, step); };
      const std::vector<double> above = by_microfacets(by(0.01), kMoments),
                                below = by_microfacets(by(-0.01), kMoments);
      const std::vector<double> more = moments_of_added(by(0.04)),
                                less = moments_of_added(by(-0.04)), added = moments_of_added(row);
      const double lost = 1 - (above[0] + below[0]) / 2;
      const auto slope = [&](size_t m) { return (above[m] - below[m]) / 0.02; };
      for (size_t m = 0; m < kMoments.size(); ++m) {
        for (const bool all : {false, true}) {
          double expected = slope(m);
          if (all) expected += lost * (more[m] - less[m]) / 0.08 - slope(0) * added[m];
          // The slopes of the table of what is lost are right to .002 to .006.
          const double rounding = all ? 4e-3 : 2e-4;
          expect_equal(derivative(both_of(row)[all ? 1 : 0], slot, probe_of(row), kMoments[m]),
                       {expected, rounding + 0.002 * std::abs(expected)}, 72,
                       fmt::format("{}{} slot {}", name_of(row), all ? " all" : "", slot));
        }
      }
    }
  }
}

// The same in the normal, along directions that are level; at angles between places of the table
// of what is lost, where its slope jumps.
TEST(RoughDielectricTest, PathsEstimateDerivativesInTheNormal) {
  constexpr double kStep = 0.02;
  const Basis<double> basis(kOutwards);
  for (const Moment& moment : kMoments) {
    for (const Case& row : {Case{1.5, 0.25, false, 0.72}, Case{1.4, 0.4, true, 0.53},
                            Case{2.5, 0.5, true, 0.53}, Case{1.5, 0.9, false, 0.4}}) {
      for (const Vec3d level : {basis.to_world(1, 0, 0), basis.to_world(0, 1, 0)}) {
        for (const RoughDielectric& boundary : both_of(row)) {
          const auto leaning = [&](double by) {
            BoundaryProbe probe = probe_of(row);
            probe.outwards = static_cast<Vec3f>(itn::normalize(kOutwards + level * by));
            return integral(boundary, probe, [&](const BoundaryProbe& p, size_t k) {
              return double{p.value[k]} * moment(static_cast<Vec3d>(p.to.at(k)));
            });
          };
          const double expected = (leaning(kStep) - leaning(-kStep)) / (2 * kStep);
          BoundaryProbe probe = probe_of(row);
          probe.asked.normal = true;
          std::vector<double> batches;
          for (uint32_t batch = 0; batch < 2000; ++batch) {
            sample_boundary(boundary, batch, probe);
            double sum = 0;
            for (size_t k = 0; k < kSlots; ++k) {
              sum += (double{probe.weight[k]} + double{probe.edge_weight[k]}) *
                     dot(static_cast<Vec3d>(probe.by_normal.at(k)), level) *
                     moment(static_cast<Vec3d>(probe.to.at(k))) / kSlots;
            }
            batches.push_back(row.leaving ? -sum : sum);  // it is that of the side of arrival
          }
          expect_equal(over_batches(batches), {expected, 1e-3 + 0.002 * std::abs(expected)}, 48,
                       fmt::format("{}{}", name_of(row), boundary.lost ? " all" : ""));
        }
      }
    }
  }
}

// What goes from i to o goes from o to i, by the measure of directions that refraction keeps,
// index^2 cos_theta d omega.
TEST(RoughDielectricTest, IsReciprocal) {
  const Case row{1.5, 0.4, false, 0.6};
  for (const RoughDielectric& boundary : both_of(row)) {
    BoundaryProbe probe = probe_of(row);
    sample_boundary(boundary, 0, probe);
    evaluate_boundary(boundary, probe);
    for (size_t k = 0; k < kSlots; ++k) {
      const Vec3f o = probe.to.at(k);
      const float o_n = std::abs(dot(o, probe.outwards));
      if (o_n < 1e-2F) continue;
      BoundaryProbe back = probe;
      back.direction = -o;
      back.leaving = dot(o, probe.outwards) < 0;
      back.to.set(0, -probe.direction);
      evaluate_boundary(boundary, back);
      const float index2_o = back.leaving ? 2.25F : 1;
      const float there = probe.value[k] / (o_n * index2_o);
      const float here = back.value[0] / static_cast<float>(row.cosine);
      EXPECT_NEAR(there, here, 2e-3F * (there + 1e-3F));
    }
  }
}

// Nothing is won. Light that meets more than one microfacet is lost by Walter's model, little where
// there is little roughness; with it, all goes on.
TEST(RoughDielectricTest, AllOfTheLightGoesOn) {
  for (const Case& row : cases()) {
    BoundaryProbe probe = probe_of(row);
    const auto going_on = [&](const RoughDielectric& boundary) {
      std::vector<double> weights;
      for (uint32_t batch = 0; batch < 200; ++batch) {
        sample_boundary(boundary, batch, probe);
        double sum = 0;
        for (size_t k = 0; k < kSlots; ++k) sum += double{probe.weight[k]} / kSlots;
        weights.push_back(sum);
      }
      return over_batches(weights);
    };
    const std::vector<RoughDielectric> both = both_of(row);
    const Estimated once = going_on(both[0]), all = going_on(both[1]);
    EXPECT_LE(once.mean, 1 + 1e-5) << name_of(row);
    EXPECT_GT(once.mean, row.roughness < 0.2 && row.cosine > 0.5 ? 0.95 : 0.1) << name_of(row);
    // The table of what is lost is interpolated.
    EXPECT_NEAR(all.mean, 1, 0.002 + 4 * all.standard_error) << name_of(row);
    EXPECT_LT(all.standard_error, 0.005) << name_of(row);
  }
}

}  // namespace
}  // namespace itn::testing
