#include "server/render/derivatives.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "common/error.h"

namespace itn {
namespace {

v1::Parameter checked(const v1::RenderGradRequest& request, int i) {
  const v1::Parameter parameter = request.derivatives(i);
  if (parameter == v1::PARAMETER_UNSPECIFIED || !v1::Parameter_IsValid(parameter)) {
    throw invalid_input(fmt::format("derivatives[{}] is {}; it must be in [{}, {}]", i,
                                    static_cast<int>(parameter), v1::Parameter_MIN + 1,
                                    static_cast<int>(v1::Parameter_MAX)));
  }
  return parameter;
}

tracer::Parameter scene_parameter(const v1::RenderGradRequest& request, int i) {
  const std::string& name = request.scene_derivatives(i);
  for (int before = 0; before < i; ++before) {
    if (request.scene_derivatives(before) == name) {
      throw invalid_input(fmt::format("scene_derivatives[{}] is {} again", i, name));
    }
  }
  const tracer::Parameter parameter = tracer::parameter_named(name);
  const std::vector<tracer::Parameter>& medium = tracer::medium_parameters();
  if (std::ranges::find(medium, parameter) != medium.end()) {
    throw invalid_input(fmt::format(
        "scene_derivatives[{}] is {}; those of the medium are asked for in derivatives", i, name));
  }
  return parameter;
}

}  // namespace

// With sigma_a = sigma_t (1 - albedo) and sigma_s = sigma_t albedo, conversely
//   sigma_t = sigma_a + sigma_s,   albedo = sigma_s / (sigma_a + sigma_s),
// so that at fixed g
//   d sigma_t / d sigma_a = 1,     d albedo / d sigma_a = -sigma_s / sigma_t^2 = -albedo / sigma_t,
//   d sigma_t / d sigma_s = 1,     d albedo / d sigma_s =  sigma_a / sigma_t^2 = (1 - albedo) /
//   sigma_t.
// In the coordinates (sigma_a, sigma_s_reduced, g), sigma_s = sigma_s_reduced / (1 - g): at fixed
// sigma_a and g, d/d sigma_s_reduced = (d/d sigma_s) / (1 - g).
std::array<double, 3> chain_rule(v1::Parameter parameter, const Material& material) {
  const double albedo_by_sigma_a = -material.albedo / material.sigma_t;
  const double albedo_by_sigma_s = (1 - material.albedo) / material.sigma_t;
  const double sigma_s_by_reduced = 1 / (1 - material.g);
  switch (parameter) {
    case v1::SIGMA_T: return {1, 0, 0};
    case v1::ALBEDO: return {0, 1, 0};
    case v1::G: return {0, 0, 1};
    case v1::SIGMA_A: return {1, albedo_by_sigma_a, 0};
    case v1::SIGMA_S: return {1, albedo_by_sigma_s, 0};
    case v1::SIGMA_S_REDUCED:
      return {sigma_s_by_reduced, albedo_by_sigma_s * sigma_s_by_reduced, 0};
    default: break;
  }
  throw invalid_input(
      fmt::format("{} is not a parameter that has a derivative", static_cast<int>(parameter)));
}

Derivatives derivatives_of(const v1::RenderGradRequest& request, const Material& material) {
  const std::vector<tracer::Parameter>& medium = tracer::medium_parameters();
  std::vector<std::array<double, 3>> rows;  // by derivative, in all parameters of the medium
  std::set<int> seen;
  for (int i = 0; i < request.derivatives_size(); ++i) {
    const v1::Parameter parameter = checked(request, i);
    if (!seen.insert(parameter).second) {
      throw invalid_input(
          fmt::format("derivatives[{}] is {} again", i, v1::Parameter_Name(parameter)));
    }
    rows.push_back(chain_rule(parameter, material));
  }
  Derivatives result;
  result.weights.resize(rows.size());
  for (size_t c = 0; c < medium.size(); ++c) {
    bool needed = false;
    for (const auto& row : rows) needed = needed || row[c] != 0;
    if (!needed) continue;
    result.parameters.push_back(medium[c]);
    for (size_t i = 0; i < rows.size(); ++i) result.weights[i].push_back(rows[i][c]);
  }
  for (int i = 0; i < request.scene_derivatives_size(); ++i) {
    result.parameters.push_back(scene_parameter(request, i));
    // By this parameter alone.
    std::vector<double>& weights = result.weights.emplace_back(result.parameters.size());
    weights.back() = 1;
  }
  for (auto& weights : result.weights) weights.resize(result.parameters.size());
  return result;
}

}  // namespace itn
