#include "common/fields.h"

#include <fmt/format.h>

#include <cmath>

#include "common/angle.h"
#include "common/error.h"

namespace itn {

namespace {
// A number as it was written: a float that became a double is 1.05, not 1.0499999523162842.
std::string spelling(double value) {
  const auto single = static_cast<float>(value);
  return double{single} == value ? fmt::format("{}", single) : fmt::format("{}", value);
}
}  // namespace

// Negated comparisons, so that NaN fails too.
double in_closed(const std::string& field, double value, double low, double high) {
  // An end of the range is in it as a float, too, which may lie a little beyond.
  const auto is_end = [&](double end) {
    return static_cast<float>(value) == static_cast<float>(end);
  };
  if (!(value >= low && value <= high) && !is_end(low) && !is_end(high)) {
    throw invalid_input(
        fmt::format("{} is {}; it must be in [{:.6g}, {:.6g}]", field, spelling(value), low, high));
  }
  return value;
}

// Back from radians, 90 degrees may be the next larger number.
void FieldCheck::angle(const char* name, double radians, double low, double high) const {
  number(name, std::round(radians / kRadiansPerDegree * 1e9) / 1e9, low, high);
}

void FieldCheck::direction(const char* name, Vec3d value) const {
  if (!is_finite(value) || !(length(value) > 0)) {
    throw invalid_input(fmt::format("{}{} must be finite and not zero", of_, name));
  }
}

void FieldCheck::position(const char* name, Vec3d value) const {
  if (!is_finite(value)) throw invalid_input(fmt::format("{}{} must be finite", of_, name));
}

}  // namespace itn
