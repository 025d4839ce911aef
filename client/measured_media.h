// Media whose coefficients have been measured, by name, in the channels R, G and B of a camera:
//   Jensen, Marschner, Levoy, Hanrahan, "A Practical Model for Subsurface Light Transport",
//   SIGGRAPH 2001: fitted by a dipole, so sigma_s is the reduced one and g is 0; indices are those
//   that the fit assumed;
//   Narasimhan, Gupta, Donner, Ramamoorthi, Nayar, Jensen, "Acquiring Scattering Properties of
//   Participating Media by Dilution", SIGGRAPH 2006: of liquids diluted in water, whose index is
//   assumed; powders are dissolved in it.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "common/material.h"

namespace itn {

struct MeasuredMedium {
  std::string name;
  std::string source;
  std::array<double, 3> sigma_s, sigma_a;  // in 1/mm
  std::array<double, 3> g;                 // where it was measured
  double index;                            // of refraction

  // The material of a channel, 0 to 2. Beyond what is rendered, g is brought back.
  Material material(size_t channel) const;
};

const std::vector<MeasuredMedium>& measured_media();

// Throws Error (invalid input).
const MeasuredMedium& measured_medium(const std::string& name);

}  // namespace itn
