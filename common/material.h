// Optical parameters of a homogeneous scattering medium.
#pragma once

#include <string>

namespace itn {

// The coordinates (sigma_t, albedo, g) that everything in itn computes in.
struct Material {
  double sigma_t = 1;  // extinction coefficient in 1/mm
  double albedo = 0;   // single-scattering albedo
  double g = 0;        // mean cosine of the Henyey-Greenstein phase function

  double sigma_a() const { return sigma_t * (1 - albedo); }
  double sigma_s() const { return sigma_t * albedo; }
  double sigma_s_reduced() const { return sigma_s() * (1 - g); }

  bool operator==(const Material&) const = default;
};

// Part of diffuse light that a half-space of the material returns, after any number of scatterings;
// the boundary is index-matched. By the fit of H. C. van de Hulst, "Multiple Light Scattering",
// 1980, in the form of C. Kulla and A. Conty, "Revisiting Physically Based Shading at Imageworks",
// 2017.
double diffuse_albedo(const Material& material);

// In mm: over so long a way light deep in the material falls to 1/e, in the diffusion
// approximation, 1 / (3 sigma_a (sigma_a + sigma_s'))^(1/2). Infinite if nothing is absorbed.
double diffusion_length(const Material& material);

// What the tracer accepts. Below kMinSigmaT the derivative in sigma_t, estimated from scatterings
// that hardly ever happen, would have an unbounded variance; beyond kMaxAbsG a float direction
// cannot resolve the peak of the phase function (its width is about 1 - |g| radians).
inline constexpr double kMinSigmaT = 1e-6;
inline constexpr double kMaxSigmaT = 1e6;
inline constexpr double kMaxAbsG = 0.99;

// Throws Error (invalid input) that names the parameter, of `what`, and its range.
void validate(const Material& material, const std::string& what = "material");

}  // namespace itn
