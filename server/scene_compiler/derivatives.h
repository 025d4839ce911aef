// The derivatives that a request asks for, in terms of those that the tracer accumulates.
#pragma once

#include <array>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "common/material.h"
#include "itn/v1/render.pb.h"
#include "server/tracer/parameters/parameter.h"

namespace itn {

// Image i of a derivative of the reply is sum_j weights[i][j] times image j that the tracer
// accumulates. Both have one for each derivative and parameter, or three, of the colours.
using DerivativeWeights = std::vector<std::vector<double>>;
struct Derivatives {
  std::vector<tracer::Parameter> parameters;  // no more than are needed
  DerivativeWeights weights;
};

// Weights (w_t, w_a, w_g) with which the derivatives in sigma_t, albedo and g add up to the
// derivative in `parameter`. Throws Error (invalid input) for PARAMETER_UNSPECIFIED or an unknown
// value.
std::array<double, 3> chain_rule(v1::Parameter parameter, const Material& material);

// All names that RenderGradRequest.parameters may have, with K for any number.
std::vector<std::string> parameter_names();
// What a name of these stands for: of the medium, or what the tracer accumulates as it is. Throws
// Error (invalid input), which says what names there are.
std::variant<v1::Parameter, tracer::Parameter> parameter_of(const std::string& name);

// Derivatives of a material, or of those of the colours. Throws Error (invalid input) where a
// derivative is unknown, or asked for twice.
Derivatives derivatives_of(const v1::RenderGradRequest& request,
                           std::span<const Material> materials);

}  // namespace itn
