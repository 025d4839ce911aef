#include "server/render/derivatives.h"

#include <fmt/format.h>

#include <set>

#include "common/error.h"
#include "server/render/chain_rule.h"

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
  if (parameter.of_medium()) {
    throw invalid_input(fmt::format(
        "scene_derivatives[{}] is {}; those of the medium are asked for in derivatives", i, name));
  }
  return parameter;
}

}  // namespace

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
