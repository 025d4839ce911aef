#include "common/learning/capture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <string>

#include "common/error.h"
#include "common/learning/parameterization.h"

namespace itn {
namespace {

constexpr double kMinSize = 1e-3, kMaxSize = 1e6;  // in mm
constexpr double kMaxExposure = 1e12;

void require(bool condition, const char* field, double value, const std::string& range) {
  if (!condition) {
    throw invalid_input(fmt::format("capture.{} is {}; it must be {}", field, value, range));
  }
}

v1::Warning warning(v1::Warning::Kind kind, std::string text) {
  v1::Warning result;
  result.set_kind(kind);
  result.set_text(std::move(text));
  return result;
}

bool knows_scale(const v1::Model& model) {
  return model.exposure() != v1::EXPOSURE_UNKNOWN;
}

// Warnings of the photograph as a whole.
std::vector<v1::Warning> common_warnings(const Photograph& photograph, const v1::Capture& capture,
                                         const v1::Model& model, const std::stop_token& stop) {
  std::vector<v1::Warning> result;
  if (capture.clipped() > kMuchClipped) {
    result.push_back(warning(
        v1::Warning::CLIPPED,
        fmt::format(
            "clipped: {:.0f} % of the object are as bright as the file can hold; expose less",
            100 * capture.clipped())));
  }
  if (capture.cut_by_frame() || reaches_edge(photograph, stop)) {
    result.push_back(warning(v1::Warning::CUT_BY_FRAME,
                             "cut by the frame: the object reaches the edge of the photograph"));
  }
  if (knows_scale(model) && !capture.has_exposure() && capture.white().empty()) {
    result.push_back(warning(
        v1::Warning::EXPOSURE_UNKNOWN,
        "exposure unknown: this model takes radiance on a known scale, and nothing says that the "
        "image is on it"));
  }
  if (!capture.has_object_size()) {
    result.push_back(warning(v1::Warning::SIZE_UNKNOWN,
                             "size unknown: 1/mm is for an object whose longest side is 1 mm"));
  }
  if (capture.encoded()) {
    result.push_back(warning(
        v1::Warning::ENCODED,
        fmt::format("encoded for a screen: its tone curve is assumed to be that of sRGB{}",
                    knows_scale(model) ? "; if it is another, the scale of radiance misleads the "
                                         "albedo"
                                       : "")));
  }
  const int side = frame(photograph, Framing::kSquareWhole, stop).side;
  if (side < static_cast<int>(model.resolution())) {
    result.push_back(warning(v1::Warning::SMALL,
                             fmt::format("small: the object's frame has {} pixels a side, the "
                                         "network sees {}",
                                         side, model.resolution())));
  }
  return result;
}

double mean_of(const google::protobuf::RepeatedField<double>& numbers) {
  return std::accumulate(numbers.begin(), numbers.end(), 0.0) / numbers.size();
}

}  // namespace

void validate(const v1::Capture& capture, int channels) {
  if (capture.has_object_size()) {
    const double size = capture.object_size();
    require(size >= kMinSize && size <= kMaxSize, "object_size", size,
            fmt::format("in [{}, {:.0f}] mm", kMinSize, kMaxSize));
  }
  if (capture.has_exposure()) {
    const double exposure = capture.exposure();
    require(exposure >= 1 / kMaxExposure && exposure <= kMaxExposure, "exposure", exposure,
            fmt::format("in [{}, {}]", 1 / kMaxExposure, kMaxExposure));
    if (!capture.white().empty()) {
      throw invalid_input(
          "capture has both exposure and white; one of them says what the scale is");
    }
  }
  const int whites = capture.white_size();
  if (whites > 1 && whites != channels) {
    throw invalid_input(
        fmt::format("capture.white has {} numbers; it must have 1, or one for each "
                    "of the image's channels ({})",
                    whites, channels));
  }
  for (const double white : capture.white()) {
    require(white >= 1 / kMaxExposure && white <= kMaxExposure, "white", white,
            fmt::format("in [{}, {}]", 1 / kMaxExposure, kMaxExposure));
  }
  require(capture.clipped() >= 0 && capture.clipped() <= 1, "clipped", capture.clipped(),
          "in [0, 1]");
}

double radiance_factor(const v1::Capture& capture, const v1::Model& model, int channel) {
  if (!knows_scale(model)) {
    // In colour a card still tells what is white.
    if (channels_of(model) == 1 || capture.white_size() < 2) return 1;
    return mean_of(capture.white()) / capture.white(channel);
  }
  if (!capture.white().empty()) {
    if (model.irradiance() <= 0) {
      throw invalid_input(
          fmt::format("the model {} takes radiance in the units of its light, which a white card "
                      "does not tell; a model that was trained with the irradiance held, as card "
                      "was, takes capture.white",
                      model.name()));
    }
    const double white = capture.white(capture.white_size() == 1 ? 0 : channel);
    return model.irradiance() / std::numbers::pi / white;
  }
  return capture.has_exposure() ? capture.exposure() : 1;
}

std::vector<std::vector<v1::Warning>> warnings(const Photograph& photograph,
                                               const v1::Capture& capture, const v1::Model& model,
                                               const std::stop_token& stop) {
  const std::vector<v1::Warning> common = common_warnings(photograph, capture, model, stop);
  std::vector<std::vector<v1::Warning>> result;
  for (int channel = 0; channel < photograph.channels; ++channel) {
    result.push_back(common);
    if (is_black(photograph, channel, stop)) {
      result.back().push_back(
          warning(v1::Warning::BLACK, "black: there is no light on the object in this channel"));
    }
  }
  return result;
}

}  // namespace itn
