#include "client/image/spectrum.h"

#include <algorithm>
#include <cmath>

#include "common/luminance.h"

namespace itn {
namespace {

// A Gaussian lobe, wider on one side than on the other.
double lobe(double nm, double middle, double below, double above) {
  const double off = (nm - middle) / (nm < middle ? below : above);
  return std::exp(-0.5 * off * off);
}

// What of light of a wavelength is seen as linear R, G, B: table 1 of the paper, and the matrix of
// IEC 61966-2-1.
std::array<double, 3> response(double nm) {
  const double x = 1.056 * lobe(nm, 599.8, 37.9, 31.0) + 0.362 * lobe(nm, 442.0, 16.0, 26.7) -
                   0.065 * lobe(nm, 501.1, 20.4, 26.2);
  const double y = 0.821 * lobe(nm, 568.8, 46.9, 40.5) + 0.286 * lobe(nm, 530.9, 16.3, 31.1);
  const double z = 1.217 * lobe(nm, 437.0, 11.8, 36.0) + 0.681 * lobe(nm, 459.0, 26.0, 13.8);
  return {3.2406 * x - 1.5372 * y - 0.4986 * z, -0.9689 * x + 1.8758 * y + 0.0415 * z,
          0.0557 * x - 0.2040 * y + 1.0570 * z};
}

double value_at(const std::map<double, double>& spectrum, double nm) {
  const auto above = spectrum.lower_bound(nm);
  if (above == spectrum.end()) return 0;
  if (above->first == nm) return above->second;
  if (above == spectrum.begin()) return 0;
  const auto below = std::prev(above);
  const double part = (nm - below->first) / (above->first - below->first);
  return below->second + part * (above->second - below->second);
}

}  // namespace

std::array<double, 3> colour_of_spectrum(const std::map<double, double>& spectrum) {
  constexpr int kFirst = 380, kLast = 720;  // nm; beyond, the eye hardly sees
  std::array<double, 3> seen{}, white{};
  for (int nm = kFirst; nm <= kLast; ++nm) {
    const std::array<double, 3> of_nm = response(nm);
    for (size_t c = 0; c < 3; ++c) {
      seen[c] += of_nm[c] * value_at(spectrum, nm);
      white[c] += of_nm[c];
    }
  }
  for (size_t c = 0; c < 3; ++c) seen[c] = std::max(0.0, seen[c] / white[c]);
  return seen;
}

std::array<double, 3> with_unit_luminance(std::array<double, 3> colour) {
  const double sum = luminance(colour);
  for (double& value : colour) value /= sum;
  return colour;
}

std::array<double, 3> colour_of_black_body(double kelvin) {
  if (kelvin == 0) return {1, 1, 1};
  constexpr double kSecondRadiation = 1.438776877e7;  // h c / k in nm K (CODATA 2018)
  constexpr double kMiddle = 560;                     // nm
  const auto planck = [&](double nm) {
    return std::pow(kMiddle / nm, 5) / std::expm1(kSecondRadiation / (nm * kelvin));
  };
  std::map<double, double> spectrum;
  for (double nm = 380; nm <= 720; nm += 5) spectrum[nm] = planck(nm) / planck(kMiddle);
  return with_unit_luminance(colour_of_spectrum(spectrum));
}

}  // namespace itn
