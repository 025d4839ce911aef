// A material of three colour channels, as renderers have it: one phase function for all of them.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "common/material.h"

namespace itn {

// R, G, B; Henyey-Greenstein phase function.
struct RgbMaterial {
  std::array<double, 3> sigma_a{};  // absorption coefficients in 1/mm
  std::array<double, 3> sigma_s{};  // scattering coefficients in 1/mm
  double g = 0;                     // mean cosine, of all channels
  bool gray = true;                 // from a single channel: the three are the same

  double sigma_t(size_t channel) const { return sigma_a[channel] + sigma_s[channel]; }
  double albedo(size_t channel) const { return sigma_s[channel] / sigma_t(channel); }
  double sigma_s_reduced(size_t channel) const { return sigma_s[channel] * (1 - g); }
  double mean_free_path(size_t channel) const { return 1 / sigma_t(channel); }  // in mm

  double diffuse_albedo(size_t channel) const {
    return itn::diffuse_albedo({sigma_t(channel), albedo(channel), g});
  }
};

// From one material (gray), or those of R, G and B. The common g is the mean of theirs weighted by
// sigma_s, as it is for a mixture of media: the mean cosine over all scatterings. What scatters
// little has little say, and its g is little known. Each sigma_s is then changed such that
// sigma_s (1 - g) stays what it was; sigma_a stays, too. So diffusion does not change: the
// similarity relation of first order, D. R. Wyman, M. S. Patterson, B. C. Wilson, "Similarity
// relations for anisotropic scattering in Monte Carlo simulations of deeply penetrating neutral
// particles", J. Comput. Phys. 81, 1989. With this weighting the sum of the sigma_s stays as well.
//
// Throws Error (invalid input) if they are neither 1 nor 3, or one is out of range.
RgbMaterial rgb_material(std::span<const Material> channels);

// With lengths multiplied by `factor`, for other units or an object of another size.
RgbMaterial with_lengths_scaled(RgbMaterial material, double factor);

}  // namespace itn
