// Derivatives in the other coordinate systems of a medium, from those in (sigma_t, albedo, g).
//
// With sigma_a = sigma_t (1 - albedo) and sigma_s = sigma_t albedo, conversely
//   sigma_t = sigma_a + sigma_s,   albedo = sigma_s / (sigma_a + sigma_s),
// so that at fixed g
//   d sigma_t / d sigma_a = 1,     d albedo / d sigma_a = -sigma_s / sigma_t^2 = -albedo / sigma_t,
//   d sigma_t / d sigma_s = 1,     d albedo / d sigma_s =  sigma_a / sigma_t^2 = (1 - albedo) /
//   sigma_t.
// In the coordinates (sigma_a, sigma_s_reduced, g), sigma_s = sigma_s_reduced / (1 - g): at fixed
// sigma_a and g, d/d sigma_s_reduced = (d/d sigma_s) / (1 - g).
#pragma once

#include <array>

#include "common/material.h"
#include "itn/v1/render.pb.h"

namespace itn {

// Weights (w_t, w_a, w_g) with which the derivatives in sigma_t, albedo and g add up to the
// derivative in `parameter`. Throws Error (invalid input) for PARAMETER_UNSPECIFIED or an unknown
// value.
std::array<double, 3> chain_rule(v1::Parameter parameter, const Material& material);

}  // namespace itn
