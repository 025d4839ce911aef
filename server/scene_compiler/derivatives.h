// The derivatives that a request asks for, in terms of those that the tracer accumulates.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "common/material.h"
#include "itn/v1/render.pb.h"
#include "server/tracer/parameters/parameter.h"

namespace itn {

// Derivative i of the reply is sum_j weights[i][j] d/d parameters[j].
using DerivativeWeights = std::vector<std::vector<double>>;
struct Derivatives {
  std::vector<tracer::Parameter> parameters;  // no more than are needed
  DerivativeWeights weights;
};

// How many a request asks for.
inline int derivative_count(const v1::RenderGradRequest& request) {
  return request.derivatives_size() + request.scene_derivatives_size() + request.parameters_size();
}

// And how many images of them are answered.
inline uint64_t derivative_images(const v1::RenderGradRequest& request) {
  return request.has_loss() || request.has_gradient() ? 0 : derivative_count(request);
}

// Weights (w_t, w_a, w_g) with which the derivatives in sigma_t, albedo and g add up to the
// derivative in `parameter`. Throws Error (invalid input) for PARAMETER_UNSPECIFIED or an unknown
// value.
std::array<double, 3> chain_rule(v1::Parameter parameter, const Material& material);

// All names that RenderGradRequest.parameters may have, with K for any number.
std::vector<std::string> parameter_names();
// What a name of these stands for: of the medium, or what the tracer accumulates as it is. Throws
// Error (invalid input), which says what names there are.
std::variant<v1::Parameter, tracer::Parameter> parameter_of(const std::string& name);

// Throws Error (invalid input) where a derivative is unknown, or asked for twice.
Derivatives derivatives_of(const v1::RenderGradRequest& request, const Material& material);

}  // namespace itn
