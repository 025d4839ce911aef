#include "client/refine/refine_result.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "client/refine/coordinates.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

constexpr double kNormal95 = 1.959963984540054;

// A rising scale on which images are about linear in a quantity, so that an interval that reaches
// beyond an end of what there is holds up to that. On a logarithm or a logit, which have no ends,
// it would reach far to the other side.
struct Scale {
  std::function<double(double)> to, from;
  double low = -HUGE_VAL, high = HUGE_VAL;  // the ends, on the scale
};
// Where images may be linear on one scale or another, an interval holds on each of them.
using Scales = std::vector<Scale>;

Scale linear_between(double low, double high) {
  return {std::identity(), std::identity(), low, high};
}

const Scales kPositive{
    {[](double v) { return std::log(v); }, [](double s) { return std::exp(s); }}};
const Scales kCosine{
    {[](double v) { return std::atanh(v); }, [](double s) { return std::tanh(s); }}};
// Light that has been in a medium for long falls with the root of what is absorbed; light that has
// not, with what is absorbed.
const Scales kAlbedo{
    {[](double v) { return -std::sqrt(1 - v); }, [](double s) { return 1 - s * s; }, -1, 0},
    linear_between(0, 1)};
const Scales kAbsorption{{[](double v) { return std::sqrt(v); }, [](double s) { return s * s; }, 0},
                         linear_between(0, HUGE_VAL)};
const Scales kDiffusionLength{
    {[](double v) { return -1 / v; }, [](double s) { return -1 / s; }, -HUGE_VAL, 0}};

v1::RefinedParameter parameter(const Quantity& quantity, const Scales& scales,
                               const Region& region) {
  const auto ends = [&](double quantile) {
    std::pair result{HUGE_VAL, -HUGE_VAL};
    for (const Scale& scale : scales) {
      const auto [low, high] = range(
          region, [&](const Vector& x) { return scale.to(quantity(x)); }, quantile);
      result.first = std::min(result.first, scale.from(std::max(low, scale.low)));
      result.second = std::max(result.second, scale.from(std::min(high, scale.high)));
    }
    return result;
  };
  const auto [low_90, high_90] = ends(kQuantile90);
  const auto [low_95, high_95] = ends(kQuantile95);
  v1::RefinedParameter result;
  result.set_value(quantity(region.answer));
  result.set_standard_deviation((high_95 - low_95) / (2 * kNormal95));
  result.set_low_90(low_90);
  result.set_high_90(high_90);
  result.set_low_95(low_95);
  result.set_high_95(high_95);
  return result;
}

// The region of what an image of a colour shows.
struct ColourRegion {
  const Region& region;
  std::vector<Eigen::Index> coordinates;

  ColourRegion(const Region& of_all, size_t colour)
      : region(of_all), coordinates(of_all.layout.of_colour(colour)) {}
  Vector answer() const { return region.answer(coordinates); }
  v1::RefinedParameter parameter(const Quantity& quantity, const Scales& scales) const {
    return itn::parameter([&](const Vector& x) { return quantity(x(coordinates)); }, scales,
                          region);
  }
  v1::RefinedParameter parameter(double (*value)(const Material&), const Scales& scales) const {
    return parameter([value](const Vector& x) { return value(material_at(x)); }, scales);
  }
};

double sigma_t(const Material& m) {
  return m.sigma_t;
}
double albedo(const Material& m) {
  return m.albedo;
}
double g(const Material& m) {
  return m.g;
}

std::string with_interval(const v1::RefinedParameter& p) {
  return fmt::format("{:.4g} ({:.4g} to {:.4g})", p.value(), p.low_95(), p.high_95());
}

// By how much the upper end of the interval is above the lower, as a factor.
double width(const v1::RefinedParameter& p) {
  return p.high_95() / p.low_95();
}

}  // namespace

Eigen::Vector3d physical_deviations(const Region& region, size_t colour) {
  const ColourRegion seen(region, colour);
  const v1::RefinedParameter of_sigma_t = seen.parameter(sigma_t, kPositive);
  return {of_sigma_t.standard_deviation() / of_sigma_t.value(),
          seen.parameter(albedo, kAlbedo).standard_deviation(),
          seen.parameter(g, kCosine).standard_deviation()};
}

v1::RefineResult refine_result(const Region& region, size_t colour) {
  const ColourRegion seen(region, colour);
  const Vector x = seen.answer();
  v1::RefineResult result;
  *result.mutable_material() = to_proto(material_at(x));
  *result.mutable_sigma_t() = seen.parameter(sigma_t, kPositive);
  *result.mutable_albedo() = seen.parameter(albedo, kAlbedo);
  *result.mutable_g() = seen.parameter(g, kCosine);
  *result.mutable_sigma_a() =
      seen.parameter([](const Material& m) { return m.sigma_a(); }, kAbsorption);
  *result.mutable_sigma_s_reduced() =
      seen.parameter([](const Material& m) { return m.sigma_s_reduced(); }, kPositive);
  *result.mutable_diffuse_albedo() = seen.parameter(diffuse_albedo, {linear_between(0, 1)});
  *result.mutable_diffusion_length() = seen.parameter(diffusion_length, kDiffusionLength);
  const Layout layout = region.layout.one_colour();
  for (size_t i = 0; i < layout.unknowns.size(); ++i) {
    v1::RefinedParameter& unknown = *result.add_unknowns();
    unknown = seen.parameter(
        [&](const Vector& at) { return unknown_at(at, layout, i); },
        {linear_between(layout.unknowns[i].range.low, layout.unknowns[i].range.high)});
    unknown.set_name(layout.unknowns[i].name);
  }
  if (layout.has_exposure) {
    *result.mutable_exposure() =
        seen.parameter([&](const Vector& at) { return exposure_at(at, layout); }, kPositive);
  }
  const Matrix jacobian = physical_jacobian(x, layout);
  const Matrix readable =
      jacobian * region.covariance(seen.coordinates, seen.coordinates) * jacobian.transpose();
  for (const auto& [i, j] : {std::pair{0, 1}, {0, 2}, {1, 2}}) {
    result.add_correlations(readable(i, j) / std::sqrt(readable(i, i) * readable(j, j)));
  }
  return result;
}

void add_remarks(v1::RefineResult& result) {
  if (!has_intervals(result)) return;
  constexpr double kWideFactor = 1.5;  // of a 95 % interval
  constexpr double kWideG = 0.3, kWideAlbedo = 0.2;
  const v1::RefinedParameter& g = result.g();
  const bool sigma_t_is_wide = !(width(result.sigma_t()) < kWideFactor);
  const bool g_is_wide = !(g.high_95() - g.low_95() < kWideG);
  const bool reduced_is_known =
      std::log(width(result.sigma_s_reduced())) < std::log(width(result.sigma_t())) / 2;
  if ((sigma_t_is_wide || g_is_wide) && reduced_is_known) {
    result.add_remarks(fmt::format(
        "sigma_t and g cannot be told apart: materials along the similarity ridge, with the same "
        "sigma_s (1 - g) and sigma_a, look alike here. Known are sigma_s (1 - g) = {} and sigma_a "
        "= {} per mm; more samples in the image, a thinner part of the object or another light "
        "would tell the rest",
        with_interval(result.sigma_s_reduced()), with_interval(result.sigma_a())));
  } else {
    if (sigma_t_is_wide) result.add_remarks("sigma_t can hardly be told from this");
    if (g_is_wide) result.add_remarks("g can hardly be told from this");
  }
  if (!(result.albedo().high_95() - result.albedo().low_95() < kWideAlbedo)) {
    result.add_remarks(result.has_exposure()
                           ? "the albedo can hardly be told, as a darker exposure of a brighter "
                             "material looks alike: find out the exposure"
                           : "the albedo can hardly be told from this");
  }
}

}  // namespace itn
