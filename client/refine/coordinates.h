// The coordinates of a refinement: UNBOUNDED ones of the material (ln sigma_t*, logit albedo*,
// logit g; common/learning/parameterization.h), in which an image tells the first two well whatever
// the third, and the logarithm of the exposure if it is unknown.
#pragma once

#include "client/refine/matrix.h"
#include "client/refine/normal_equations.h"
#include "common/material.h"

namespace itn {

// What the tracer can render, but for where nothing can be told any more.
inline constexpr double kMinRefinedSigmaT = 1e-3, kMaxRefinedSigmaT = 1e4;  // in 1/mm

// Three coordinates. The material is moved inside of what there are coordinates for.
Vector coordinates_of(const Material& material);

Material material_at(const Vector& coordinates);
double exposure_at(const Vector& coordinates);
Linearization linearize(const Vector& coordinates);

// Moves coordinates to the nearest that a material can have.
void clamp_to_domain(Vector& coordinates);

// d (ln sigma_t, albedo, g, ln exposure) / d coordinates.
Matrix physical_jacobian(const Vector& coordinates);

}  // namespace itn
