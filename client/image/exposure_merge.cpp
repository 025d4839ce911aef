#include "client/image/exposure_merge.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/photo.hpp>

#include "client/image/channels.h"
#include "client/image/srgb.h"
#include "common/error.h"

namespace itn {
namespace {

// Pixels of a sample a side, and of these the ones that the response is fitted to: the time that it
// takes grows with their third power.
constexpr int kSampleSide = 256;
constexpr int kFittedPixels = 70;
constexpr float kSmoothness = 10;  // the lambda of Debevec and Malik
// Each of so many parts of the range of codes must be seen for the response to be told.
constexpr size_t kParts = 8;
// Encoded values that say nothing but that the light was more or less: the last ones of a JPEG.
constexpr double kBlack = 1.5 / 255;
constexpr double kWhite = 253.5 / 255;
// Pixels of one value that make a plateau; and how far above its largest value a file without one
// ends.
constexpr size_t kPlateau = 16;
constexpr double kHeadroom = 2;

double weight_of(double encoded) {
  return encoded < kBlack || encoded > kWhite ? 0 : 1 - std::abs(2 * encoded - 1);
}

double light_of(const std::array<float, 256>& response, double encoded) {
  const double at = 255 * std::clamp(encoded, 0.0, 1.0);
  const auto below = std::min(static_cast<size_t>(at), size_t{254});
  return std::lerp(response[below], response[below + 1], at - static_cast<double>(below));
}

std::vector<std::string> channels_of(const PhotographFile& photograph, const std::string& name) {
  return radiance_channels(photograph.image, name);
}

Error undetermined_response() {
  return invalid_input(
      "the photographs do not tell the camera's response: they need parts of every brightness, and "
      "exposure times that are right; --response srgb needs neither");
}

// Whether every channel has codes everywhere in its range.
bool has_all_tones(const std::vector<ExposureSample>& samples) {
  const auto channels = static_cast<size_t>(samples.front().channels);
  std::vector<std::array<bool, kParts>> seen(channels);
  for (const ExposureSample& sample : samples) {
    for (size_t i = 0; i < sample.codes.size(); ++i) {
      seen[i % channels][sample.codes[i] * kParts / 256] = true;
    }
  }
  return std::ranges::all_of(seen, [](const auto& parts) {
    return std::ranges::all_of(parts, [](bool part) { return part; });
  });
}

}  // namespace

Response srgb_response(int channels) {
  std::array<float, 256> curve{};
  for (size_t code = 0; code < curve.size(); ++code) {
    curve[code] = static_cast<float>(linear_of_srgb(static_cast<double>(code) / 255));
  }
  return Response(static_cast<size_t>(channels), curve);
}

ExposureSample sample_exposure(const PhotographFile& photograph, double exposure,
                               const std::string& name) {
  const Image& image = photograph.image;
  const std::vector<std::string> names = channels_of(photograph, name);
  const int step = std::max(1, std::max(image.width, image.height) / kSampleSide);
  ExposureSample sample{.exposure = exposure,
                        .width = image.width / step,
                        .height = image.height / step,
                        .channels = static_cast<int>(names.size()),
                        .codes = {}};
  for (int y = 0; y < sample.height; ++y) {
    for (int x = 0; x < sample.width; ++x) {
      const auto pixel = static_cast<size_t>(y * step) * static_cast<size_t>(image.width) +
                         static_cast<size_t>(x * step);
      for (const std::string& channel : names) {
        const double code = 255 * srgb_of_linear(image.channel(channel)[pixel]);
        sample.codes.push_back(static_cast<unsigned char>(std::lround(code)));
      }
    }
  }
  return sample;
}

Response estimate_response(const std::vector<ExposureSample>& samples) {
  if (!has_all_tones(samples)) throw undetermined_response();
  const int channels = samples.front().channels;
  std::vector<cv::Mat> images;
  std::vector<float> exposures;
  for (const ExposureSample& sample : samples) {
    if (sample.codes.size() != samples.front().codes.size()) {
      throw invalid_input("the photographs are not of one size, or not all have colours");
    }
    images.emplace_back(sample.height, sample.width, CV_8UC(channels),
                        const_cast<unsigned char*>(sample.codes.data()));
    exposures.push_back(static_cast<float>(sample.exposure));
  }
  cv::Mat curves;  // 256 x 1
  cv::createCalibrateDebevec(kFittedPixels, kSmoothness)->process(images, curves, exposures);
  Response response(static_cast<size_t>(channels));
  for (int channel = 0; channel < channels; ++channel) {
    const auto light = [&](int code) { return curves.ptr<float>(code)[channel]; };
    const bool rises = light(32) > 0 && light(128) > light(32) && light(224) > light(128) &&
                       std::isfinite(light(224));
    if (!rises) throw undetermined_response();
    const double scale = linear_of_srgb(128 / 255.0) / light(128);
    for (int code = 0; code < 256; ++code) {
      response[static_cast<size_t>(channel)][static_cast<size_t>(code)] =
          static_cast<float>(scale * light(code));
    }
  }
  return response;
}

void ExposureMerge::add(const PhotographFile& photograph, double exposure,
                        const std::string& name) {
  const Image& image = photograph.image;
  const std::vector<std::string> names = channels_of(photograph, name);
  if (sums_.empty()) {
    width_ = image.width;
    height_ = image.height;
    names_ = names;
    const size_t count = image.channel(names.front()).size();
    sums_.assign(names.size(), {std::vector<float>(count), std::vector<float>(count),
                                std::vector<float>(count, -std::numeric_limits<float>::max())});
  }
  if (image.width != width_ || image.height != height_) {
    throw invalid_input(
        fmt::format("{} has {} x {} pixels, the photographs before {} x {}; all "
                    "must be of one size, from one camera that stood still",
                    name, image.width, image.height, width_, height_));
  }
  if (names.size() != names_.size()) {
    throw invalid_input(
        fmt::format("{} has {} channels, the photographs before {}; all must have "
                    "colours, or none",
                    name, names.size(), names_.size()));
  }
  // The value at which a linear file ends: integers at 1; others at the plateau that clipped pixels
  // make, or, without one, nowhere near.
  double top = 1;
  if (!photograph.encoded && photograph.clipped.empty()) {
    float most = 0;
    size_t at_most = 0;
    for (const std::string& channel : names) {
      most = std::max(most, std::ranges::max(image.channel(channel)));
    }
    for (const std::string& channel : names) {
      at_most += static_cast<size_t>(std::ranges::count(image.channel(channel), most));
    }
    top = at_most >= kPlateau ? most : kHeadroom * most;
  }
  std::vector<double> differences;
  for (size_t channel = 0; channel < names.size(); ++channel) {
    add_channel(channel, image.channel(names[channel]), photograph.encoded, top, exposure,
                differences);
  }
  compare(std::move(differences), name);
}

// By the median over pixels that are well exposed here and before, of the logarithm.
void ExposureMerge::compare(std::vector<double> differences, const std::string& name) {
  constexpr size_t kFew = 100;
  if (differences.size() < kFew) return;
  const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
  std::ranges::nth_element(differences, middle);
  const double ratio = std::exp(*middle);
  const std::string text = fmt::format(
      "{}: its light for a second of exposure is {:.3g} times that of the photographs before: are "
      "the "
      "exposure times in the order of the photographs, and is the response that of the camera?",
      name, ratio);
  if (std::max(ratio, 1 / ratio) > kWrong) throw invalid_input(text);
  if (std::max(ratio, 1 / ratio) > kDoubtful) doubts_.push_back(text);
}

void ExposureMerge::add_channel(size_t channel, const std::vector<float>& plane, bool encoded,
                                double top, double exposure, std::vector<double>& differences) {
  Sums& sums = sums_[channel];
  const double scale = encoded || !(top > 0) ? 1 : 1 / top;
  for (size_t pixel = 0; pixel < plane.size(); ++pixel) {
    const double value = std::max(0.0F, plane[pixel]);
    const double code = srgb_of_linear(scale * value);
    const double light = encoded && response_ ? light_of((*response_)[channel], code) : value;
    const double weight = weight_of(code);
    if (weight == 0) {
      // Clipped values are lower bounds, of which the highest counts, and black ones, negative
      // here, upper bounds, of which the lowest does; where there are both, the former.
      const double bound = code > 0.5 ? light / exposure : -light / exposure;
      sums.bound[pixel] = std::max(sums.bound[pixel], static_cast<float>(bound));
    } else {
      // Both values are so far from the ends of what a file can hold.
      constexpr double kWell = 0.3;
      if (weight > kWell && sums.weight[pixel] > static_cast<float>(kWell)) {
        differences.push_back(std::log(light / exposure) -
                              double{sums.value[pixel] / sums.weight[pixel]});
      }
      sums.weight[pixel] += static_cast<float>(weight);
      sums.value[pixel] += static_cast<float>(weight * std::log(light / exposure));
    }
  }
}

Image ExposureMerge::merged() const {
  Image image{.width = width_, .height = height_, .channels = {}, .attributes = {}};
  bool any_exposed = false;
  for (size_t channel = 0; channel < sums_.size(); ++channel) {
    const Sums& sums = sums_[channel];
    std::vector<float>& plane =
        image.channels[sums_.size() == 1 ? "Y" : std::string(1, "RGB"[channel])];
    plane.resize(sums.weight.size());
    for (size_t pixel = 0; pixel < plane.size(); ++pixel) {
      if (sums.weight[pixel] == 0) {
        plane[pixel] = std::abs(sums.bound[pixel]);
        continue;
      }
      any_exposed = true;
      plane[pixel] = std::exp(sums.value[pixel] / sums.weight[pixel]);
    }
  }
  if (clipped_count() > 0) image.channels["clipped.Y"] = clipped_everywhere();
  if (!any_exposed) {
    throw invalid_input(
        "every pixel is black or white in every photograph: take some with other exposures");
  }
  return image;
}

std::vector<float> ExposureMerge::clipped_everywhere() const {
  std::vector<float> clipped(sums_.front().weight.size());
  for (size_t pixel = 0; pixel < clipped.size(); ++pixel) {
    const bool is_clipped = std::ranges::any_of(
        sums_, [&](const Sums& s) { return s.weight[pixel] == 0 && s.bound[pixel] > 0; });
    clipped[pixel] = is_clipped ? 1.0F : 0.0F;
  }
  return clipped;
}

size_t ExposureMerge::clipped_count() const {
  const std::vector<float> clipped = clipped_everywhere();
  return static_cast<size_t>(std::ranges::count(clipped, 1.0F));
}

}  // namespace itn
