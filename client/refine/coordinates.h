// The coordinates of a refinement: UNBOUNDED ones of the material (ln sigma_t*, logit albedo*,
// logit g; common/learning/parameterization.h), in which an image tells the first two well whatever
// the third; of each number of the scene that is unknown the logit of its place in its range; and
// the logarithm of the exposure if that is unknown.
#pragma once

#include <span>
#include <vector>

#include "client/refine/matrix.h"
#include "client/refine/normal_equations.h"
#include "client/refine/scene_unknown.h"
#include "common/material.h"

namespace itn {

// What the tracer can render, but for where nothing can be told any more.
inline constexpr double kMinRefinedSigmaT = 1e-3, kMaxRefinedSigmaT = 1e4;  // in 1/mm

using Unknowns = std::span<const SceneUnknown>;

// Without the exposure; of the unknowns, where they start. All are moved inside of what there are
// coordinates for.
Vector coordinates_of(const Material& material, Unknowns unknowns = {});

Material material_at(const Vector& coordinates);
double unknown_at(const Vector& coordinates, Unknowns unknowns, size_t which);
std::vector<double> unknowns_at(const Vector& coordinates, Unknowns unknowns);
bool has_exposure(const Vector& coordinates, Unknowns unknowns);
double exposure_at(const Vector& coordinates, Unknowns unknowns = {});
Linearization linearize(const Vector& coordinates, Unknowns unknowns = {});

// Moves coordinates to the nearest that a material and the unknowns can have.
void clamp_to_domain(Vector& coordinates, Unknowns unknowns = {});

// d (ln sigma_t, albedo, g, unknowns, ln exposure) / d coordinates.
Matrix physical_jacobian(const Vector& coordinates, Unknowns unknowns = {});

}  // namespace itn
