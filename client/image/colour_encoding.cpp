#include "client/image/colour_encoding.h"

#include <fmt/format.h>
#include <lcms2.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "client/image/srgb.h"
#include "common/error.h"
#include "common/releaser.h"

namespace itn {
namespace {

using Curve = ColourEncoding::Curve;

struct CloseProfile {
  using pointer = cmsHPROFILE;
  void operator()(cmsHPROFILE profile) const { cmsCloseProfile(profile); }
};
using Profile = std::unique_ptr<void, CloseProfile>;
struct DeleteTransform {
  using pointer = cmsHTRANSFORM;
  void operator()(cmsHTRANSFORM transform) const { cmsDeleteTransform(transform); }
};
using Transform = std::unique_ptr<void, DeleteTransform>;
using ToneCurve = std::unique_ptr<cmsToneCurve, Releaser<cmsFreeToneCurve>>;

// Linear, of these primaries, or gray.
Profile linear_profile(const Chromaticities& c, int channels) {
  const ToneCurve straight(cmsBuildGamma(nullptr, 1));
  const cmsCIExyY white{c[6], c[7], 1};
  if (channels == 1) return Profile(cmsCreateGrayProfile(&white, straight.get()));
  const cmsCIExyYTRIPLE primaries{{c[0], c[1], 1}, {c[2], c[3], 1}, {c[4], c[5], 1}};
  cmsToneCurve* const curves[] = {straight.get(), straight.get(), straight.get()};
  return Profile(cmsCreateRGBProfile(&white, &primaries, curves));
}

Profile profile_of(const ColourEncoding& encoding, int channels, const std::string& name) {
  if (encoding.profile.empty()) {
    return linear_profile(encoding.primaries.value_or(kSrgbChromaticities), channels);
  }
  Profile profile(cmsOpenProfileFromMem(encoding.profile.data(),
                                        static_cast<cmsUInt32Number>(encoding.profile.size())));
  const auto wrong = [&](const std::string& what) {
    return invalid_input(
        fmt::format("{}: its colour profile {}; save it as sRGB, or linear", name, what));
  };
  if (!profile) throw wrong("is damaged");
  const cmsColorSpaceSignature space = cmsGetColorSpace(profile.get());
  if (space != (channels == 1 ? cmsSigGrayData : cmsSigRgbData)) {
    throw wrong(channels == 1 ? "is not that of a gray image" : "is not that of an RGB image");
  }
  return profile;
}

Transform transform_of(const ColourEncoding& encoding, int channels, const std::string& name) {
  const Profile from = profile_of(encoding, channels, name);
  const Profile to = linear_profile(kSrgbChromaticities, channels);
  const cmsUInt32Number format = channels == 1 ? TYPE_GRAY_FLT : TYPE_RGB_FLT;
  Transform transform(from && to ? cmsCreateTransform(from.get(), format, to.get(), format,
                                                      INTENT_RELATIVE_COLORIMETRIC,
                                                      cmsFLAGS_NOOPTIMIZE | cmsFLAGS_NOCACHE)
                                 : nullptr);
  if (!transform) {
    throw invalid_input(fmt::format("{}: Little CMS makes no linear sRGB of its colours", name));
  }
  return transform;
}

// SMPTE ST 2084, from the value to light of which 1 is 10000 cd/m^2.
double pq_light(double value) {
  constexpr double kM1 = 2610.0 / 16384, kM2 = 2523.0 / 4096 * 128;
  constexpr double kC1 = 3424.0 / 4096, kC2 = 2413.0 / 4096 * 32, kC3 = 2392.0 / 4096 * 32;
  const double root = std::pow(value, 1 / kM2);
  return std::pow(std::max(0.0, root - kC1) / (kC2 - kC3 * root), 1 / kM1);
}

// ITU-R BT.2100, table 5: from the value to the light of the scene.
double hlg_light(double value) {
  constexpr double kA = 0.17883277, kB = 1 - 4 * kA;
  const double c = 0.5 - kA * std::log(4 * kA);
  return value <= 0.5 ? value * value / 3 : (std::exp((value - c) / kA) + kB) / 12;
}

// By ITU-T H.273, table 2.
std::optional<Chromaticities> primaries_of(int code) {
  switch (code) {
    case 4: return Chromaticities{0.67, 0.33, 0.21, 0.71, 0.14, 0.08, 0.310, 0.316};
    case 5: return Chromaticities{0.64, 0.33, 0.29, 0.60, 0.15, 0.06, 0.3127, 0.3290};
    case 6:
    case 7: return Chromaticities{0.630, 0.340, 0.310, 0.595, 0.155, 0.070, 0.3127, 0.3290};
    case 9: return Chromaticities{0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290};
    case 11: return Chromaticities{0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.314, 0.351};
    case 12: return Chromaticities{0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290};
    default: return std::nullopt;
  }
}

}  // namespace

double linear_of(const ColourEncoding& encoding, double encoded) {
  switch (encoding.curve) {
    case Curve::kSrgb: return linear_of_srgb(encoded);
    case Curve::kLinear: return encoded;
    case Curve::kPower: return std::pow(encoded, encoding.exponent);
    case Curve::kBt709:
      return encoded < 0.081 ? encoded / 4.5 : std::pow((encoded + 0.099) / 1.099, 1 / 0.45);
    case Curve::kPq: return pq_light(encoded) * (10000.0 / 203);
    case Curve::kHlg: return hlg_light(encoded);
  }
  return encoded;
}

ColourEncoding encoding_of_code_points(int primaries, int transfer, const std::string& name) {
  ColourEncoding encoding;
  encoding.is_stated = true;
  switch (transfer) {
    case 2:  // not specified
    case 13: break;
    case 1:
    case 6:
    case 14:
    case 15: encoding.curve = Curve::kBt709; break;
    case 4:
      encoding.curve = Curve::kPower;
      encoding.exponent = 2.2;
      break;
    case 5:
      encoding.curve = Curve::kPower;
      encoding.exponent = 2.8;
      break;
    case 8: encoding.curve = Curve::kLinear; break;
    case 16: encoding.curve = Curve::kPq; break;
    case 18: encoding.curve = Curve::kHlg; break;
    default:
      throw invalid_input(fmt::format(
          "{}: its transfer characteristics are number {} of ITU-T H.273, which are not read; save "
          "it as sRGB",
          name, transfer));
  }
  encoding.primaries = primaries_of(primaries);
  if (!encoding.primaries && primaries != 1 && primaries != 2) {
    throw invalid_input(
        fmt::format("{}: its colour primaries are number {} of ITU-T H.273, which are not read; "
                    "save it as sRGB",
                    name, primaries));
  }
  return encoding;
}

bool are_same(const Chromaticities& a, const Chromaticities& b) {
  constexpr double kRounding = 0.003;
  return std::ranges::equal(a, b, [](double x, double y) { return std::abs(x - y) < kRounding; });
}

ColourEncoding simplified(ColourEncoding encoding, int channels, const std::string& name) {
  if (encoding.profile.empty()) return encoding;
  encoding.is_stated = true;
  // Colours all over the cube, and the gray ones.
  std::vector<float> encoded;
  constexpr int kSteps = 5;
  for (int i = 0; i < kSteps * kSteps * kSteps; ++i) {
    for (const int step : {i % kSteps, i / kSteps % kSteps, i / kSteps / kSteps}) {
      encoded.push_back(static_cast<float>(step) / (kSteps - 1));
    }
  }
  const ColourConversion convert = conversion_to_linear_srgb(encoding, channels, name);
  std::vector<float> light = encoded;
  convert(light);
  const auto all = [&](const auto& expected, double tolerance) {
    return std::ranges::equal(encoded, light, [&](float value, float of_value) {
      return std::abs(expected(double{value}) - double{of_value}) < tolerance;
    });
  };
  // Profiles of sRGB differ by how their white was rounded.
  constexpr double kSame = 2e-3;
  if (all([](double value) { return linear_of_srgb(value); }, kSame)) {
    return {.curve = Curve::kSrgb, .is_stated = true};
  }
  // Gray is linear: so are the others, with primaries of their own.
  bool is_linear = true;
  for (const float part : {0.25F, 0.5F, 0.75F}) {
    std::vector<float> gray(static_cast<size_t>(channels), part);
    convert(gray);
    is_linear = is_linear && std::abs(gray[0] - part) < static_cast<float>(kSame);
  }
  encoding.curve = is_linear ? Curve::kLinear : Curve::kSrgb;
  return encoding;
}

ColourConversion conversion_to_linear_srgb(const ColourEncoding& encoding, int channels,
                                           const std::string& name) {
  // Functions are copied.
  const std::shared_ptr<void> transform = transform_of(encoding, channels, name);
  return [transform, channels](std::span<float> values) {
    cmsDoTransform(transform.get(), values.data(), values.data(),
                   static_cast<cmsUInt32Number>(values.size() / static_cast<size_t>(channels)));
  };
}

}  // namespace itn
