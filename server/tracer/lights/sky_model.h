// Radiance of a clear sky and irradiance of the sun, in linear sRGB. Units: W/m^2 (per sr),
// weighted by the eye's sensitivity (luminance / 683 lm/W), as in the RGB figures of Hosek and
// Wilkie.
#pragma once

#include <array>

#include "server/tracer/colour/channel.h"

namespace itn::tracer {

// The sky-dome model of Hosek and Wilkie, "An Analytic Model for Full Spectral Sky-Dome Radiance",
// SIGGRAPH 2012, RGB variant.
class Sky {
 public:
  // turbidity in [1, 10], ground_albedo in [0, 1], sun_elevation in radians in [0, pi/2].
  Sky(double turbidity, double ground_albedo, double sun_elevation);

  // Radiance from a direction theta from the zenith, in [0, pi/2], and gamma from the sun; the sun
  // itself is not included. At least 0 (the fit dips below, close to the horizon under a low sun).
  Rgb radiance(double cos_theta, double gamma) const;

 private:
  // Coefficients A..I of Eq. 8 and the radiance that scales them, one row for each channel.
  std::array<std::array<double, 10>, 3> coefficients_;
};

// Irradiance of the sun on a surface that faces it, after the atmosphere: a black body of 5778 K,
// attenuated by Rayleigh and aerosol scattering as in the appendix of Preetham, Shirley, Smits, "A
// Practical Analytic Model for Daylight", SIGGRAPH 1999 (ozone and water vapour, together about 3 %
// in the visible range, left out), seen through the CIE 1931 colour matching functions as fitted by
// Wyman, Sloan, Shirley, "Simple Analytic Approximations to the CIE XYZ Color Matching Functions",
// JCGT 2013.
Rgb sun_irradiance(double turbidity, double sun_elevation);

}  // namespace itn::tracer
