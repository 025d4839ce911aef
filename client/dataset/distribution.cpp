#include "client/dataset/distribution.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "common/error.h"

namespace itn {
namespace {

v1::Interval interval(double min, double max) {
  v1::Interval result;
  result.set_min(min);
  result.set_max(max);
  return result;
}

// The scale on which numbers of an interval are uniform.
struct Scale {
  double (*place)(double);  // of a number
  double (*number)(double);
  double (*density)(double);  // of numbers: the slope of `place`
};

constexpr auto same = [](double x) { return x; };
constexpr Scale kLinear{same, same, [](double) { return 1.0; }};
constexpr Scale kLogarithmic{[](double x) { return std::log(x); },
                             [](double y) { return std::exp(y); }, [](double x) { return 1 / x; }};
constexpr Scale kComplementLogarithmic{[](double x) { return -std::log1p(-x); },
                                       [](double y) { return -std::expm1(-y); },
                                       [](double x) { return 1 / (1 - x); }};

struct ScaledInterval {
  const Scale& scale;
  const v1::Interval& range;
};

ScaledInterval interval_of(const v1::Distribution& distribution) {
  switch (distribution.kind_case()) {
    case v1::Distribution::kLogUniform: return {kLogarithmic, distribution.log_uniform()};
    case v1::Distribution::kComplementLogUniform:
      return {kComplementLogarithmic, distribution.complement_log_uniform()};
    default: return {kLinear, distribution.uniform()};
  }
}

void validate_range(const std::string& name, const v1::Interval& range, double low, double high) {
  if (range.min() > range.max()) {
    throw invalid_input(
        fmt::format("the range of {} is [{}, {}]; its minimum must not exceed its maximum", name,
                    range.min(), range.max()));
  }
  if (!(range.min() <= range.max() && range.min() >= low && range.max() <= high)) {
    throw invalid_input(fmt::format("the range of {} is [{}, {}]; it must lie in [{}, {}]", name,
                                    range.min(), range.max(), low, high));
  }
}

}  // namespace

v1::Distribution fixed(double value) {
  v1::Distribution result;
  result.set_fixed(value);
  return result;
}

v1::Distribution uniform(double min, double max) {
  v1::Distribution result;
  *result.mutable_uniform() = interval(min, max);
  return result;
}

v1::Distribution log_uniform(double min, double max) {
  v1::Distribution result;
  *result.mutable_log_uniform() = interval(min, max);
  return result;
}

v1::Distribution complement_log_uniform(double min, double max) {
  v1::Distribution result;
  *result.mutable_complement_log_uniform() = interval(min, max);
  return result;
}

void validate(const std::string& name, const v1::Distribution& distribution, double low,
              double high) {
  const auto require_value = [&](double value) {
    if (!(value >= low && value <= high)) {
      throw invalid_input(fmt::format("{} is {}; it must be in [{}, {}]", name, value, low, high));
    }
  };
  switch (distribution.kind_case()) {
    case v1::Distribution::kFixed: return require_value(distribution.fixed());
    case v1::Distribution::kUniform: return validate_range(name, distribution.uniform(), low, high);
    case v1::Distribution::kLogUniform:
      validate_range(name, distribution.log_uniform(), low, high);
      if (!(distribution.log_uniform().min() > 0)) {
        throw invalid_input(
            fmt::format("{} is log-uniform from {}; a logarithm needs a minimum above 0", name,
                        distribution.log_uniform().min()));
      }
      return;
    case v1::Distribution::kComplementLogUniform:
      validate_range(name, distribution.complement_log_uniform(), low, high);
      if (!(distribution.complement_log_uniform().max() < 1)) {
        throw invalid_input(
            fmt::format("{} is complement-log-uniform to {}; the logarithm of 1 minus it needs a "
                        "maximum below 1",
                        name, distribution.complement_log_uniform().max()));
      }
      return;
    case v1::Distribution::kOneOf:
      if (distribution.one_of().value().empty()) {
        throw invalid_input(fmt::format("{} is one of an empty list; give it a value", name));
      }
      std::ranges::for_each(distribution.one_of().value(), require_value);
      return;
    case v1::Distribution::KIND_NOT_SET: break;
  }
  throw invalid_input(
      fmt::format("{} is empty; it is one of fixed, uniform, log_uniform, one_of and "
                  "complement_log_uniform",
                  name));
}

double quantile(const v1::Distribution& distribution, double u) {
  if (distribution.has_fixed()) return distribution.fixed();
  if (distribution.has_one_of()) {
    return distribution.one_of().value(static_cast<int>(u * distribution.one_of().value_size()));
  }
  const auto& [scale, range] = interval_of(distribution);
  const double from = scale.place(range.min()), to = scale.place(range.max());
  return scale.number(from + (to - from) * u);
}

double density(const v1::Distribution& distribution, double x) {
  const auto& [scale, range] = interval_of(distribution);
  return x < range.min() || x > range.max() ? 0 : scale.density(x);
}

v1::Interval range_of(const v1::Distribution& distribution) {
  if (!is_list(distribution)) return interval_of(distribution).range;
  const auto [min, max] = std::ranges::minmax(values_of(distribution));
  return interval(min, max);
}

bool is_list(const v1::Distribution& distribution) {
  return distribution.has_fixed() || distribution.has_one_of();
}

std::vector<double> values_of(const v1::Distribution& distribution) {
  if (!distribution.has_one_of()) return {distribution.fixed()};
  const auto& values = distribution.one_of().value();
  return {values.begin(), values.end()};
}

}  // namespace itn
