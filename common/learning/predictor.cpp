#include "common/learning/predictor.h"

#include <algorithm>

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "common/error.h"
#include "common/learning/checkpoint.h"

namespace itn {
namespace {

// One of the interleaved channels.
cv::Mat channel_of(const FramedPhotograph& photograph, int channel) {
  cv::Mat image(photograph.side, photograph.side, CV_32F);
  auto value = image.begin<float>();
  for (size_t i = channel; i < photograph.pixels.size(); i += photograph.channels) {
    *value++ = photograph.pixels[i];
  }
  return image;
}

cv::Mat mask_of(const FramedPhotograph& photograph) {
  cv::Mat image(photograph.side, photograph.side, CV_32F);
  std::ranges::copy(photograph.mask, image.begin<float>());
  return image;
}

// Averages over areas where the image shrinks, interpolates where it grows.
std::vector<float> resampled(const cv::Mat& image, int resolution) {
  cv::Mat result;
  const int method = image.cols >= resolution ? cv::INTER_AREA : cv::INTER_LINEAR;
  cv::resize(image, result, cv::Size(resolution, resolution), 0, 0, method);
  return {result.begin<float>(), result.end<float>()};
}

}  // namespace

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

std::vector<Material> Predictor::predict(const Photograph& photograph,
                                         const std::stop_token& stop) {
  validate(photograph, stop);
  const int resolution = static_cast<int>(model_.resolution());
  // Frame and resample the mask and every channel.
  const FramedPhotograph square = framed(photograph, stop);
  const std::vector<float> mask = resampled(mask_of(square), resolution);
  std::vector<torch::Tensor> inputs;
  for (int channel = 0; channel < square.channels; ++channel) {
    const std::vector<float> image = resampled(channel_of(square, channel), resolution);
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
