// Colours of spectra.
#pragma once

#include <array>
#include <map>

namespace itn {

// Linear R, G, B (sRGB's primaries) of a spectrum, given by its values at wavelengths in nm, at
// least one of them: linear between them, 0 beyond. A constant spectrum is gray, and has its value
// in each. Not below 0.
//
// By CIE's curves of 1931, as Wyman, Sloan, Shirley approximate them by Gaussian lobes: "Simple
// analytic approximations to the CIE XYZ color matching functions", JCGT 2013.
std::array<double, 3> colour_of_spectrum(const std::map<double, double>& spectrum);

// The colour as bright as gray of 1: over its luminance.
std::array<double, 3> with_unit_luminance(std::array<double, 3> colour);

inline constexpr double kMinTemperature = 2000, kMaxTemperature = 40000;  // K

// The colour of a black body's light, as above but of luminance 1. 0 K stands for gray, which light
// of some 5500 K nearly is. A candle has 1900 K, a bulb 2700, a clear sky 10000 and more.
std::array<double, 3> colour_of_black_body(double kelvin);

}  // namespace itn
