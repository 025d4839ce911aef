#include "server/scene_compiler/derivatives.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <optional>

#include "common/error.h"

namespace itn {
namespace {

// "SIGMA_T" as "sigma_t".
std::string name_of(v1::Parameter parameter) {
  std::string name = v1::Parameter_Name(parameter);
  std::ranges::transform(name, name.begin(), [](unsigned char c) { return std::tolower(c); });
  return name;
}

// Nothing if it is not of the medium.
std::optional<v1::Parameter> medium_parameter(const std::string& name) {
  std::string upper = name;
  std::ranges::transform(upper, upper.begin(), [](unsigned char c) { return std::toupper(c); });
  v1::Parameter parameter = v1::PARAMETER_UNSPECIFIED;
  const bool known = v1::Parameter_Parse(upper, &parameter) && name_of(parameter) == name;
  return known && parameter != v1::PARAMETER_UNSPECIFIED ? std::optional(parameter) : std::nullopt;
}

v1::Parameter checked(const v1::RenderGradRequest& request, int i) {
  const v1::Parameter parameter = request.derivatives(i);
  if (parameter == v1::PARAMETER_UNSPECIFIED || !v1::Parameter_IsValid(parameter)) {
    throw invalid_input(fmt::format("derivatives[{}] is {}; it must be in [{}, {}]", i,
                                    static_cast<int>(parameter), v1::Parameter_MIN + 1,
                                    static_cast<int>(v1::Parameter_MAX)));
  }
  return parameter;
}

// Names of all derivatives, in the order of the reply.
std::vector<std::string> names_in(const v1::RenderGradRequest& request) {
  std::vector<std::string> names;
  const auto add = [&](const char* list, int i, const std::string& name, const std::string& said) {
    if (std::ranges::find(names, name) != names.end()) {
      throw invalid_input(fmt::format("{}[{}] is {} again", list, i, said));
    }
    names.push_back(name);
  };
  for (int i = 0; i < request.derivatives_size(); ++i) {
    const v1::Parameter parameter = checked(request, i);
    add("derivatives", i, name_of(parameter), v1::Parameter_Name(parameter));
  }
  for (int i = 0; i < request.scene_derivatives_size(); ++i) {
    const std::string& name = request.scene_derivatives(i);
    if (medium_parameter(name)) {
      throw invalid_input(fmt::format(
          "scene_derivatives[{}] is {}; those of the medium are asked for in derivatives", i,
          name));
    }
    add("scene_derivatives", i, name, name);
  }
  for (int i = 0; i < request.parameters_size(); ++i) {
    add("parameters", i, request.parameters(i), request.parameters(i));
  }
  return names;
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

std::vector<std::string> parameter_names() {
  std::vector<std::string> names;
  for (int value = v1::Parameter_MIN + 1; value <= v1::Parameter_MAX; ++value) {
    names.push_back(name_of(static_cast<v1::Parameter>(value)));
  }
  for (const std::string& name : tracer::parameter_names()) {
    if (!medium_parameter(name)) names.push_back(name);
  }
  return names;
}

// A parameter of the medium, or one that the tracer accumulates by itself.
std::variant<v1::Parameter, tracer::Parameter> parameter_of(const std::string& name) {
  if (const auto parameter = medium_parameter(name)) return *parameter;
  try {
    return tracer::parameter_named(name);
  } catch (const Error&) {
    throw invalid_input(fmt::format("{} is not a parameter; there are {}, K counting from 0", name,
                                    fmt::join(parameter_names(), ", ")));
  }
}

Derivatives derivatives_of(const v1::RenderGradRequest& request,
                           std::span<const Material> materials) {
  const std::vector<tracer::Parameter>& medium = tracer::medium_parameters();
  const size_t colours = materials.size();
  // By image: in all parameters of the medium, or in one that is none of these.
  std::vector<std::array<double, 3>> rows;
  std::vector<std::optional<tracer::Parameter>> others;
  for (const std::string& name : names_in(request)) {
    const auto parameter = parameter_of(name);
    const auto* of_medium = std::get_if<v1::Parameter>(&parameter);
    for (const Material& material : materials) {
      rows.push_back(of_medium != nullptr ? chain_rule(*of_medium, material)
                                          : std::array<double, 3>{});
      others.push_back(of_medium != nullptr
                           ? std::nullopt
                           : std::optional(std::get<tracer::Parameter>(parameter)));
    }
  }
  Derivatives result;
  result.weights.resize(rows.size());
  // The images of a parameter: each colour's own.
  const auto add = [&](const tracer::Parameter& parameter, const auto& weight_of) {
    result.parameters.push_back(parameter);
    for (size_t i = 0; i < rows.size(); ++i) {
      auto& weights = result.weights[i];
      weights.resize(result.parameters.size() * colours);
      weights[weights.size() - colours + i % colours] = weight_of(i);
    }
  };
  for (size_t p = 0; p < medium.size(); ++p) {
    const auto needs = [p](const auto& row) { return row[p] != 0; };
    if (std::ranges::any_of(rows, needs)) add(medium[p], [&](size_t i) { return rows[i][p]; });
  }
  for (size_t first = 0; first < others.size(); first += colours) {
    if (!others[first]) continue;
    add(*others[first], [&](size_t i) { return i / colours == first / colours ? 1.0 : 0.0; });
  }
  return result;
}

}  // namespace itn
