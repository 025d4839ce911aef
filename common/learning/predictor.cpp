#include "common/learning/predictor.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "common/error.h"
#include "common/learning/checkpoint.h"

namespace itn {
namespace {

// The part of the frame that the object's longest side takes in the set-up of Che et al. 2020:
// 1 mm, of the 2 * 33.9 mm * tan(2.5 deg / 2) = 1.48 mm that the camera sees.
constexpr double kObjectFraction = 1 / 1.48;

int pixel_count(const Photograph& p) {
  return p.width * p.height;
}

// One channel of the photograph as an image of its own.
cv::Mat channel_of(const Photograph& p, int channel) {
  cv::Mat image(p.height, p.width, CV_32F);
  for (int i = 0; i < pixel_count(p); ++i) {
    image.at<float>(i / p.width, i % p.width) =
        p.pixels[static_cast<size_t>(i) * p.channels + channel];
  }
  return image;
}

cv::Mat mask_of(const Photograph& p) {
  cv::Mat image(p.height, p.width, CV_32F);
  std::ranges::copy(p.mask, image.begin<float>());
  return image;
}

// The square that the network sees; it may reach beyond the image.
cv::Rect frame(const cv::Mat& mask) {
  if (mask.cols == mask.rows) {
    return {0, 0, mask.cols, mask.rows};
  }
  const cv::Rect object = cv::boundingRect(mask > 0.5F);
  const int side =
      static_cast<int>(std::lround(std::max(object.width, object.height) / kObjectFraction));
  return {object.x + (object.width - side) / 2, object.y + (object.height - side) / 2, side, side};
}

// What of the frame lies outside of the image is 0.
cv::Mat cut_out(const cv::Mat& image, const cv::Rect& frame) {
  cv::Mat result = cv::Mat::zeros(frame.size(), CV_32F);
  const cv::Rect inside = frame & cv::Rect(0, 0, image.cols, image.rows);
  image(inside).copyTo(result(inside - frame.tl()));
  return result;
}

// Averages over areas where the image shrinks, interpolates where it grows.
std::vector<float> resampled(const cv::Mat& image, int resolution) {
  cv::Mat result;
  const int method = image.cols >= resolution ? cv::INTER_AREA : cv::INTER_LINEAR;
  cv::resize(image, result, cv::Size(resolution, resolution), 0, 0, method);
  return {result.begin<float>(), result.end<float>()};
}

void require_values(const char* what, std::span<const float> values, int per_row, int channels,
                    float max) {
  const auto bad = std::ranges::find_if(
      values, [max](float v) { return !(v >= 0 && v <= max) || !std::isfinite(v); });
  if (bad == values.end()) {
    return;
  }
  const auto pixel = (bad - values.begin()) / channels;
  throw invalid_input(fmt::format("{} is {} at pixel ({}, {}); it must be {}", what, *bad,
                                  pixel % per_row, pixel / per_row,
                                  max == 1 ? "in [0, 1]" : "finite and >= 0"));
}

}  // namespace

void validate(const Photograph& p) {
  constexpr int kMaxSide = 16384;
  if (p.width < 1 || p.width > kMaxSide || p.height < 1 || p.height > kMaxSide) {
    throw invalid_input(fmt::format("the image is {} x {} pixels; each side must be in [1, {}]",
                                    p.width, p.height, kMaxSide));
  }
  if (p.channels != 1 && p.channels != 3) {
    throw invalid_input(fmt::format("the image has {} channels; it must have 1 or 3", p.channels));
  }
  const size_t pixels = static_cast<size_t>(p.width) * p.height;
  if (p.pixels.size() != pixels * p.channels) {
    throw invalid_input(fmt::format("the image has {} values; {} x {} x {} channels need {}",
                                    p.pixels.size(), p.width, p.height, p.channels,
                                    pixels * p.channels));
  }
  if (p.mask.size() != pixels) {
    throw invalid_input(fmt::format("the mask has {} values; {} x {} pixels need {}", p.mask.size(),
                                    p.width, p.height, pixels));
  }
  require_values("image", p.pixels, p.width, p.channels, HUGE_VALF);
  require_values("mask", p.mask, p.width, 1, 1);
  if (std::ranges::none_of(p.mask, [](float m) { return m > 0.5F; })) {
    throw invalid_input("the mask is empty; it must be above 0.5 on the object");
  }
}

Predictor Predictor::load(const std::filesystem::path& checkpoint) {
  const v1::Checkpoint content = read_checkpoint(checkpoint);
  try {
    return Predictor(content.model());
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{}: {}", checkpoint.string(), error.what()));
  }
}

Predictor::Predictor(const v1::Model& model)
    : model_(model), space_(model), encoder_(load_encoder(model)) {
  model_.clear_weights();
  encoder_->eval();
}

std::vector<Material> Predictor::predict(const Photograph& photograph) {
  validate(photograph);
  const int resolution = static_cast<int>(model_.resolution());
  // Frame and resample the mask and every channel.
  const cv::Mat full_mask = mask_of(photograph);
  const cv::Rect square = frame(full_mask);
  const std::vector<float> mask = resampled(cut_out(full_mask, square), resolution);
  std::vector<torch::Tensor> inputs;
  for (int channel = 0; channel < photograph.channels; ++channel) {
    const std::vector<float> image =
        resampled(cut_out(channel_of(photograph, channel), square), resolution);
    inputs.push_back(encoder_input(resolution, image, mask, model_.image_scale()));
  }
  // Predict.
  const torch::NoGradGuard no_gradient;
  const torch::Tensor outputs = encoder_->forward(torch::stack(inputs)).to(torch::kFloat64);
  std::vector<Material> materials;
  for (int channel = 0; channel < photograph.channels; ++channel) {
    const double* output = outputs[channel].data_ptr<double>();
    materials.push_back(space_.material({output[0], output[1], output[2]}));
  }
  return materials;
}

std::string Predictor::name() const {
  return fmt::format("{}, step {}", model_.name(), model_.step());
}

}  // namespace itn
