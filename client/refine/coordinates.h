// The coordinates of what an image shows: UNBOUNDED ones of the material (ln sigma_t*, logit
// albedo*, logit g; common/learning/parameterization.h), in which an image tells the first two well
// whatever the third; of each number of the scene that is unknown the logit of its place in its
// range; the logarithm of the exposure if that is unknown; and how far the image is disturbed
// (Observation::disturbances).
//
// A refinement of several colours has ln sigma_t* and logit albedo* of each, then logit g of all or
// of each, and then the rest, which is the same in all of them (Layout).
#pragma once

#include <cstddef>
#include <vector>

#include "client/refine/matrix.h"
#include "client/refine/normal_equations.h"
#include "client/refine/scene_unknown.h"
#include "common/material.h"

namespace itn {

// What the tracer can render, but for where nothing can be told any more.
inline constexpr double kMinRefinedSigmaT = 1e-3, kMaxRefinedSigmaT = 1e4;  // in 1/mm

// Names in RefineSettings.known_within, beside those of unknowns.
inline constexpr const char *kExposure = "exposure", *kKnownG = "g";

// Which coordinates of a refinement are which.
struct Layout {
  size_t colours = 1;
  bool g_of_each_colour = false;
  std::vector<SceneUnknown> unknowns = {};
  bool has_exposure = false;
  size_t disturbances = 0;

  Eigen::Index sigma_t(size_t colour) const { return 2 * static_cast<Eigen::Index>(colour); }
  Eigen::Index g(size_t colour) const {
    return 2 * static_cast<Eigen::Index>(colours) +
           (g_of_each_colour ? static_cast<Eigen::Index>(colour) : 0);
  }
  // All logit g: one, or one of each colour.
  std::vector<Eigen::Index> all_g() const;
  Eigen::Index unknown(size_t which) const {
    return g(colours - 1) + 1 + static_cast<Eigen::Index>(which);
  }
  Eigen::Index exposure() const { return unknown(unknowns.size()); }  // if it has one
  Eigen::Index disturbance(size_t which) const {
    return exposure() + (has_exposure ? 1 : 0) + static_cast<Eigen::Index>(which);
  }
  Eigen::Index size() const { return disturbance(disturbances); }

  // The coordinates of what an image of a colour shows, in their order, which is that of
  // one_colour().
  std::vector<Eigen::Index> of_colour(size_t colour) const;
  Layout one_colour() const;
};

// What follows takes coordinates of what an image shows, and their layout, of one colour.

// Coordinates of unknowns where they start, of an exposure of 1, undisturbed. All are moved inside
// of what there are coordinates for.
Vector coordinates_of(const Material& material, const Layout& layout = {});

Material material_at(const Vector& coordinates);
double unknown_at(const Vector& coordinates, const Layout& layout, size_t which);
std::vector<double> unknowns_at(const Vector& coordinates, const Layout& layout);
double exposure_at(const Vector& coordinates, const Layout& layout);  // 1 if it is known
Linearization linearize(const Vector& coordinates, const Layout& layout = {});

// d (ln sigma_t, albedo, g, unknowns, ln exposure, disturbances) / d coordinates.
Matrix physical_jacobian(const Vector& coordinates, const Layout& layout = {});

// Moves coordinates of a refinement, of any number of colours, to the nearest that there can be.
void clamp_to_domain(Vector& coordinates, const Layout& layout = {});

}  // namespace itn
