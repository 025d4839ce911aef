#include "server/tracer/lights/sky_model.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/tracer/lights/hosek_wilkie.h"

namespace itn::tracer {
namespace {

// Row `coefficient` of one table, at Bezier parameter x (a quintic through six control points).
double bezier(const float (&control)[6][10], int coefficient, double x) {
  constexpr double kBinomial[6] = {1, 5, 10, 10, 5, 1};
  double sum = 0;
  for (int i = 0; i < 6; ++i) {
    sum += kBinomial[i] * std::pow(1 - x, 5 - i) * std::pow(x, i) *
           static_cast<double>(control[i][coefficient]);
  }
  return sum;
}

// chi of Eq. 9: a glow around the sun, anisotropic with parameter h.
double glow(double h, double cos_gamma) {
  const double q = 1 + h * h - 2 * h * cos_gamma;
  return (1 + cos_gamma * cos_gamma) / (q * std::sqrt(q));
}

// Radiance of a black body in W / (m^2 sr m).
double planck(double wavelength, double temperature) {
  constexpr double kH = 6.62607015e-34, kC = 2.99792458e8, kBoltzmann = 1.380649e-23;
  return 2 * kH * kC * kC / std::pow(wavelength, 5) /
         std::expm1(kH * kC / (wavelength * kBoltzmann * temperature));
}

// Fraction of sunlight of a wavelength (in um) that crosses the atmosphere along the sun's path.
double transmittance(double wavelength, double turbidity, double sun_elevation) {
  const double zenith_degrees = 90 - sun_elevation * 180 / std::numbers::pi;
  const double mass =
      1 / (std::sin(sun_elevation) + 0.15 * std::pow(93.885 - zenith_degrees, -1.253));
  const double rayleigh = 0.008735 * std::pow(wavelength, -4.08);
  const double aerosol = (0.04608 * turbidity - 0.04586) * std::pow(wavelength, -1.3);
  return std::exp(-mass * (rayleigh + std::max(0.0, aerosol)));
}

// A Gaussian whose width differs on the two sides of its peak; wavelength in nm.
double lobe(double wavelength, double peak, double left, double right) {
  const double t = (wavelength - peak) * (wavelength < peak ? left : right);
  return std::exp(-0.5 * t * t);
}

// Wyman et al., Eq. 4 (multi-lobe fit); wavelength in nm.
std::array<double, 3> colour_matching(double w) {
  return {0.362 * lobe(w, 442.0, 0.0624, 0.0374) + 1.056 * lobe(w, 599.8, 0.0264, 0.0323) -
              0.065 * lobe(w, 501.1, 0.0490, 0.0382),
          0.821 * lobe(w, 568.8, 0.0213, 0.0247) + 0.286 * lobe(w, 530.9, 0.0613, 0.0322),
          1.217 * lobe(w, 437.0, 0.0845, 0.0278) + 0.681 * lobe(w, 459.0, 0.0385, 0.0725)};
}

}  // namespace

Sky::Sky(double turbidity, double ground_albedo, double sun_elevation) {
  // Coefficients, not radiances, are interpolated: along the sun's elevation by a Bezier curve in
  // its cube root, linearly in turbidity and ground albedo.
  const double x = std::cbrt(sun_elevation / (std::numbers::pi / 2));
  const int low = std::clamp(static_cast<int>(turbidity), 1, 9);
  const double t = turbidity - low;
  for (size_t channel = 0; channel < 3; ++channel) {
    for (int i = 0; i < 10; ++i) {
      const auto at = [&](int albedo, int turbidity_index) {
        return bezier(kHosekWilkieRgb[channel][albedo][turbidity_index - 1], i, x);
      };
      const double dark = std::lerp(at(0, low), at(0, low + 1), t);
      const double bright = std::lerp(at(1, low), at(1, low + 1), t);
      coefficients_[channel][static_cast<size_t>(i)] = std::lerp(dark, bright, ground_albedo);
    }
  }
}

Rgb Sky::radiance(double cos_theta, double gamma) const {
  const double cos_gamma = std::cos(gamma);
  Rgb result{};
  for (size_t channel = 0; channel < 3; ++channel) {
    const auto& [a, b, c, d, e, f, g, h, i, scale] = coefficients_[channel];
    const double value =  // Eq. 8
        (1 + a * std::exp(b / (cos_theta + 0.01))) *
        (c + d * std::exp(e * gamma) + f * cos_gamma * cos_gamma + g * glow(h, cos_gamma) +
         i * std::sqrt(cos_theta));
    result[channel] = std::max(0.0, value * scale);
  }
  return result;
}

Rgb sun_irradiance(double turbidity, double sun_elevation) {
  constexpr double kTemperature = 5778;     // K
  constexpr double kSolidAngle = 6.794e-5;  // sr, of the sun seen from the earth
  constexpr int kFirst = 360, kLast = 830;  // nm, in steps of 1 nm
  std::array<double, 3> xyz{};
  for (int nm = kFirst; nm <= kLast; ++nm) {
    const double w = nm;
    const double irradiance = planck(w * 1e-9, kTemperature) * kSolidAngle *
                              transmittance(w * 1e-3, turbidity, sun_elevation);
    const auto matching = colour_matching(w);
    for (size_t i = 0; i < 3; ++i) xyz[i] += irradiance * matching[i] * 1e-9;
  }
  // XYZ to linear sRGB, IEC 61966-2-1.
  const auto [x, y, z] = xyz;
  return {std::max(0.0, 3.2406 * x - 1.5372 * y - 0.4986 * z),
          std::max(0.0, -0.9689 * x + 1.8758 * y + 0.0415 * z),
          std::max(0.0, 0.0557 * x - 0.2040 * y + 1.0570 * z)};
}

}  // namespace itn::tracer
