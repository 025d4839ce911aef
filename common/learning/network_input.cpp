#include "common/learning/network_input.h"

#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

#include "common/error.h"
#include "common/image/square_view.h"
#include "common/learning/parameterization.h"
#include "common/learning/weight_map.h"
#include "common/luminance.h"

namespace itn {
namespace {

// A smaller mean of a mask is none; so is a smaller luminance.
constexpr double kNothing = 1e-6, kNoLight = 1e-20;
constexpr double kMuchNoise = 100;  // over the luminance
// Keeps the logarithm of black finite: a hundredth of the mean radiance of objects.
constexpr double kBlack = 0.01;
// What is brighter is a firefly, a lamp, or no translucent object.
constexpr double kMaxRatio = 10;
// Brings the contrast with the surroundings, some tenths, to the size of the other planes.
constexpr double kLocalGain = 4;
constexpr int kLocalPart = 32;  // of the side, as the Gaussian's standard deviation

// resolution x resolution: row y holds the Gaussian about y. G x G^T blurs x, with zeros around it.
torch::Tensor gaussian_blur(int64_t resolution) {
  const double sigma = static_cast<double>(resolution) / kLocalPart;
  const torch::Tensor at = torch::arange(resolution, torch::kFloat32);
  return torch::exp(-(at.unsqueeze(1) - at).square() / (2 * sigma * sigma));
}

torch::Tensor local_mean(const torch::Tensor& masked, const torch::Tensor& mask) {
  const torch::Tensor blur = gaussian_blur(masked.size(-1));
  const auto blurred = [&](const torch::Tensor& x) { return blur.matmul(x).matmul(blur.t()); };
  return blurred(masked) / blurred(mask).clamp_min(kNothing);
}

torch::Tensor object_mean(const torch::Tensor& masked, const torch::Tensor& mask) {
  return masked.sum({1, 2}, true) / mask.sum({1, 2}, true).clamp_min(kNothing);
}

torch::Tensor ratio(const torch::Tensor& y, const torch::Tensor& mean) {
  return (y / mean.clamp_min(kNoLight)).clamp_max(kMaxRatio);
}

torch::Tensor ratio_planes(const v1::Model& model, const ImageBatch& images) {
  const torch::Tensor& mask = images.mask;
  ImageBatch scaled = images;
  scaled.luminance = images.luminance * static_cast<float>(model.image_scale());
  if (model.exposure() == v1::EXPOSURE_UNKNOWN) {
    scaled.luminance = ratio(scaled.luminance, mean_on_object(scaled));
  }
  const torch::Tensor& y = scaled.luminance;
  const torch::Tensor masked = y * mask;
  const torch::Tensor ratios = torch::stack(
      {torch::log(y + kBlack) * mask, kLocalGain * (ratio(y, local_mean(masked, mask)) - 1) * mask,
       (ratio(y, object_mean(masked, mask)) - 1) * mask},
      1);
  const int64_t side = y.size(-1);
  const torch::Tensor masks = mask.view({images.size(), images.channels, side, side});
  return torch::cat(
      {ratios.view({images.size(), 3 * images.channels, side, side}), masks.slice(1, 0, 1)}, 1);
}

cv::Mat resized(const cv::Mat& image, int resolution) {
  cv::Mat result;
  const int method = image.cols >= resolution ? cv::INTER_AREA : cv::INTER_LINEAR;
  cv::resize(image, result, cv::Size(resolution, resolution), 0, 0, method);
  return result;
}

}  // namespace

std::vector<torch::Tensor> planes_of(const ImageBatch& images) {
  std::vector<torch::Tensor> planes{images.luminance, images.mask};
  for (const torch::Tensor& plane : {images.weight, images.noise}) {
    if (plane.defined()) planes.push_back(plane);
  }
  return planes;
}

bool needs_weight_map(v1::NetworkInput input) {
  return input == v1::LUMINANCE_AND_WEIGHT || input == v1::NETWORK_INPUT_UNSPECIFIED;
}

int64_t input_channels(const v1::Model& model) {
  const auto channels = static_cast<int64_t>(channels_of(model));
  if (needs_weight_map(model.input())) {
    if (channels > 1) throw invalid_input("the model's input has no colours; RATIOS has");
    return 2;
  }
  if (model.input() == v1::RATIOS) return 3 * channels + 1;
  throw invalid_input("the model's input is not one that this version of itn knows");
}

torch::Tensor network_input(const v1::Model& model, const ImageBatch& images) {
  if (needs_weight_map(model.input())) {
    return torch::stack(
        {images.luminance * static_cast<float>(model.image_scale()) * images.mask, images.weight},
        1);
  }
  return ratio_planes(model, images);
}

ImageBatch resampled(int side, std::span<const float> luminance, std::span<const float> mask,
                     int resolution, v1::NetworkInput input) {
  ImageBatch batch;
  batch.luminance = torch::empty({1, resolution, resolution});
  batch.mask = torch::empty({1, resolution, resolution});
  const auto count = static_cast<size_t>(resolution) * static_cast<size_t>(resolution);
  const std::span<float> y(batch.luminance.data_ptr<float>(), count);
  const std::span<float> m(batch.mask.data_ptr<float>(), count);
  if (side == resolution) {
    std::ranges::copy(luminance, y.begin());
    std::ranges::copy(mask, m.begin());
  } else {
    const cv::Mat on_object = square_view(side, luminance).mul(square_view(side, mask));
    const cv::Mat sums = resized(on_object, resolution);
    const cv::Mat area = resized(square_view(side, mask), resolution);
    std::copy(area.begin<float>(), area.end<float>(), m.begin());
    std::transform(sums.begin<float>(), sums.end<float>(), m.begin(), y.begin(),
                   [](float sum, float a) { return a > kNothing ? sum / a : 0.0F; });
  }
  if (needs_weight_map(input)) {
    batch.weight = torch::empty({1, resolution, resolution});
    std::ranges::copy(weight_map(resolution, resolution, y, m), batch.weight.data_ptr<float>());
  }
  return batch;
}

ImageBatch brought_up_to_noise(const ImageBatch& images, const torch::Tensor& level,
                               const torch::Tensor& normal) {
  const torch::Tensor wanted = level.view({-1, 1, 1});
  const torch::Tensor noise =
      images.noise.defined() ? images.noise : torch::zeros_like(images.luminance);
  const torch::Tensor missing = (wanted.square() - noise.square()).clamp_min(0).sqrt();
  ImageBatch result = images;
  result.luminance = (images.luminance * (1 + missing * normal)).clamp_min(0);
  result.noise = torch::maximum(wanted, noise);
  return result;
}

torch::Tensor for_planes(const torch::Tensor& of_images, int64_t channels) {
  return channels == 1 ? of_images : of_images.repeat_interleave(channels);
}

torch::Tensor mean_on_object(const ImageBatch& images) {
  const torch::Tensor means = object_mean(images.luminance * images.mask, images.mask);
  if (images.channels == 1) return means;
  return for_planes(means.view({images.size(), images.channels}).mean(1), images.channels)
      .view({-1, 1, 1});
}

ImageBatch luminance_of(const ImageBatch& images) {
  if (images.channels == 1) return images;
  const int64_t side = images.luminance.size(-1);
  const auto by_image = [&](const torch::Tensor& planes) {
    return planes.view({images.size(), images.channels, side, side});
  };
  const torch::Tensor weights =
      torch::tensor(c10::ArrayRef<double>(kLuminanceOfColours), torch::kFloat32).view({1, 3, 1, 1});
  ImageBatch result;
  result.luminance = (by_image(images.luminance) * weights).sum(1);
  result.mask = by_image(images.mask).select(1, 0);
  if (images.noise.defined()) {  // of colours, which may have come from the same paths
    // A black pixel of one colour may be nothing but noise, infinitely much of it.
    const torch::Tensor noise = images.noise.clamp_max(kMuchNoise);
    result.noise = (by_image(noise * images.luminance) * weights).sum(1) /
                   result.luminance.clamp_min(kNoLight);
  }
  return result;
}

ImageBatch image_of(const ImageBatch& images, int64_t index) {
  const auto one = [&](const torch::Tensor& plane) {
    const int64_t first = index * images.channels;
    return plane.defined() ? plane.slice(0, first, first + images.channels) : plane;
  };
  return {one(images.luminance), one(images.mask), one(images.weight), one(images.noise),
          images.channels};
}

ImageBatch mirrored(const ImageBatch& images) {
  const auto flipped = [](const torch::Tensor& plane) {
    return plane.defined() ? plane.flip(-1) : plane;
  };
  return {flipped(images.luminance), flipped(images.mask), flipped(images.weight),
          flipped(images.noise), images.channels};
}

ImageBatch concatenated(std::span<const ImageBatch> batches) {
  const auto all = [&](torch::Tensor ImageBatch::*member) {
    std::vector<torch::Tensor> tensors;
    for (const ImageBatch& batch : batches) {
      if (!(batch.*member).defined()) return torch::Tensor();
      tensors.push_back(batch.*member);
    }
    return torch::cat(tensors);
  };
  return {all(&ImageBatch::luminance), all(&ImageBatch::mask), all(&ImageBatch::weight),
          all(&ImageBatch::noise), batches.front().channels};
}

}  // namespace itn
