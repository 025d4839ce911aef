// The coordinates of what an image shows: UNBOUNDED ones of the material (ln sigma_t*, logit
// albedo*, logit g; common/learning/parameterization.h), in which an image tells the first two well
// whatever the third; of each number of the scene that is unknown the logit of its place in its
// range; and the logarithm of the exposure if that is unknown.
//
// A refinement of several colours has ln sigma_t* and logit albedo* of each, and then the rest,
// which is the same in all of them (Layout).
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

// The name of the exposure in RefineSettings.known_within.
inline constexpr const char* kExposure = "exposure";

using Unknowns = std::span<const SceneUnknown>;

// Which coordinates of a refinement are which.
struct Layout {
  size_t colours = 1;
  std::vector<SceneUnknown> unknowns;

  Eigen::Index g() const { return 2 * static_cast<Eigen::Index>(colours); }
  Eigen::Index unknown(size_t which) const { return g() + 1 + static_cast<Eigen::Index>(which); }
  Eigen::Index exposure() const { return unknown(unknowns.size()); }
  // Of `size` coordinates, those of what an image of a colour shows, in their order.
  std::vector<Eigen::Index> of_colour(size_t colour, Eigen::Index size) const;
};

// Without the exposure; of the unknowns, where they start. All are moved inside of what there are
// coordinates for.
Vector coordinates_of(const Material& material, Unknowns unknowns = {});

Material material_at(const Vector& coordinates);
double unknown_at(const Vector& coordinates, Unknowns unknowns, size_t which);
std::vector<double> unknowns_at(const Vector& coordinates, Unknowns unknowns);
bool has_exposure(const Vector& coordinates, Unknowns unknowns);
double exposure_at(const Vector& coordinates, Unknowns unknowns = {});
Linearization linearize(const Vector& coordinates, Unknowns unknowns = {});

// Moves coordinates of a refinement to the nearest that materials and unknowns can have.
void clamp_to_domain(Vector& coordinates, const Layout& layout = {});

// d (ln sigma_t, albedo, g, unknowns, ln exposure) / d coordinates.
Matrix physical_jacobian(const Vector& coordinates, Unknowns unknowns = {});

}  // namespace itn
