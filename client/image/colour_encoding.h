// How the values of a file stand for light, and what makes linear sRGB of them: by Little CMS, but
// for curves that profiles cannot hold.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <span>
#include <string>

namespace itn {

// CIE 1931 x, y of red, green, blue and white.
using Chromaticities = std::array<double, 8>;

struct ColourEncoding {
  enum class Curve {
    kSrgb,    // IEC 61966-2-1
    kLinear,  //
    kPower,   // light = value ^ exponent
    kBt709,   // of cameras: ITU-R BT.709, of BT.601 and BT.2020 too
    kPq,      // SMPTE ST 2084; 1 is 203 cd/m^2, the white of ITU-R BT.2408
    kHlg      // of cameras: ITU-R BT.2100, hybrid log-gamma; 1 is its peak
  } curve = Curve::kSrgb;
  double exponent = 1;
  std::optional<Chromaticities> primaries{};  // absent: those of sRGB
  // An ICC profile, which then says all of this.
  std::string profile{};
  // The file says how it is encoded, or could not be encoded otherwise. 16-bit integers that do not
  // say may be linear as well.
  bool is_stated = false;
};

// Linear light of a value of a curve, both from 0 to 1 (PQ: to 10000 / 203).
double linear_of(const ColourEncoding& encoding, double encoded);

// What code points for video mean (ITU-T H.273, tables 2 and 3), as PNG, HEIF and AVIF have them.
// Throws Error (invalid input) that names those that are not read; `name` is the file's.
ColourEncoding encoding_of_code_points(int primaries, int transfer, const std::string& name);

// The chromaticities of sRGB (ITU-R BT.709).
inline constexpr Chromaticities kSrgbChromaticities{0.64, 0.33, 0.30,   0.60,
                                                    0.15, 0.06, 0.3127, 0.3290};
// Whether these are the same but for rounding.
bool are_same(const Chromaticities& a, const Chromaticities& b);

// Without a profile if that is sRGB's, or linear with its primaries. Throws Error (invalid input)
// if it is damaged, or of something else than gray (`channels` 1) or RGB (3).
ColourEncoding simplified(ColourEncoding encoding, int channels, const std::string& name);

// Makes linear sRGB, below 0 where its colours do not reach, of interleaved values of 1 or 3
// channels: encoded by the profile, or else linear, of the primaries that there are. Throws Error
// (invalid input).
using ColourConversion = std::function<void(std::span<float>)>;
ColourConversion conversion_to_linear_srgb(const ColourEncoding& encoding, int channels,
                                           const std::string& name);

}  // namespace itn
