#include "client/training/augmentation.h"

#include <ATen/CPUGeneratorImpl.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "client/training/camera_augmentation.h"
#include "common/error.h"
#include "common/random.h"

namespace itn {
namespace {

// Draws do not depend on each other: a choice that is switched off changes none of the rest.
enum AugmentationChoice : uint64_t {
  kMirror,
  kShift,
  kExposure,
  kNoiseLevel,
  kNoise,
  kCamera,
  kWhiteBalance,
  kLikeness,
  kCommonNoise
};

// With planes of their own.
ImageBatch copied(ImageBatch images) {
  images.luminance = images.luminance.clone();
  images.mask = images.mask.clone();
  if (images.weight.defined()) images.weight = images.weight.clone();
  if (images.noise.defined()) images.noise = images.noise.clone();
  return images;
}

// What moves out of the frame is lost, what comes in is 0.
torch::Tensor shifted(const torch::Tensor& image, int64_t dx, int64_t dy) {
  const int64_t height = image.size(-2), width = image.size(-1);
  torch::Tensor result = torch::zeros_like(image);
  if (std::abs(dx) >= width || std::abs(dy) >= height) return result;
  const auto window = [&](const torch::Tensor& of, int64_t x, int64_t y) {
    return of.narrow(-2, std::max<int64_t>(y, 0), height - std::abs(y))
        .narrow(-1, std::max<int64_t>(x, 0), width - std::abs(x));
  };
  window(result, dx, dy).copy_(window(image, -dx, -dy));
  return result;
}

// Calls `change` with a plane of the image and all that belongs to it: tensors of size x size,
// which it writes into.
template <typename Change>
void change_image(const ImageBatch& images, int64_t image, const Change& change) {
  for (int64_t p = image * images.channels; p < (image + 1) * images.channels; ++p) {
    for (const torch::Tensor& planes : planes_of(images)) change(planes[p]);
  }
}

void mirror(const ImageBatch& images, SplitMix random) {
  for (int64_t i = 0; i < images.size(); ++i) {
    if (random.uniform() < 0.5) {
      change_image(images, i, [](const torch::Tensor& plane) { plane.copy_(plane.flip(-1)); });
    }
  }
}

void shift(const ImageBatch& images, uint32_t pixels, SplitMix random) {
  const auto offset = [&] {
    return static_cast<int64_t>(random.below(2 * pixels + 1)) - static_cast<int64_t>(pixels);
  };
  for (int64_t i = 0; i < images.size(); ++i) {
    const int64_t dx = offset(), dy = offset();
    change_image(images, i,
                 [&](const torch::Tensor& plane) { plane.copy_(shifted(plane, dx, dy)); });
  }
}

// Uniform in [min, max], one for each image.
torch::Tensor uniform(double min, double max, int64_t count, SplitMix random) {
  torch::Tensor numbers = torch::empty({count});
  for (int64_t i = 0; i < count; ++i) numbers[i] = min + (max - min) * random.uniform();
  return numbers;
}

// Colours of a render come from the same paths, so that their noise is alike, and the more so, the
// more alike their media. Added noise with any correlation of colours hides how much. (That of a
// prediction has none, as some of training's.)
torch::Tensor alike_in_colours(const torch::Tensor& normal, int64_t channels,
                               const torch::Generator& generator, SplitMix random) {
  const int64_t side = normal.size(-1);
  const int64_t images = normal.size(0) / channels;
  const torch::Tensor correlation = per_plane(for_planes(uniform(0, 1, images, random), channels));
  const torch::Tensor common =
      torch::randn({images, side, side}, generator).repeat_interleave(channels, 0);
  return correlation.sqrt() * common + (1 - correlation).sqrt() * normal;
}

void require_in(const char* name, double value, double low, double high) {
  if (!(value >= low && value <= high)) {
    throw invalid_input(
        fmt::format("augmentation.{} is {}; it must be in [{}, {}]", name, value, low, high));
  }
}

}  // namespace

void validate(const v1::Augmentation& augmentation) {
  require_in("shift", augmentation.shift(), 0, 64);
  require_in("exposure", augmentation.exposure(), 0, 3);
  require_in("white_balance", augmentation.white_balance(), 0, 1);
  require_in("noise.max", augmentation.noise().max(), 0, 1);
  require_in("noise.min", augmentation.noise().min(), 0, augmentation.noise().max());
  require_in("first_order_step", augmentation.first_order_step(), 0, 2);
  validate(augmentation.camera());
}

ImageBatch augmented(const ImageBatch& images, const v1::Augmentation& augmentation,
                     uint64_t seed) {
  const torch::NoGradGuard no_gradient;
  const auto random = [seed](AugmentationChoice choice) {
    return SplitMix(derive_seed(seed, {choice}));
  };
  const auto generator = [seed](AugmentationChoice choice) {
    return at::detail::createCPUGenerator(derive_seed(seed, {choice}));
  };
  const int64_t count = images.size();
  const bool moves = augmentation.mirror() || augmentation.shift() > 0;
  ImageBatch result = moves ? copied(images) : images;
  if (augmentation.mirror()) mirror(result, random(kMirror));
  if (augmentation.shift() > 0) shift(result, augmentation.shift(), random(kShift));
  result = with_camera_effects(result, augmentation.camera(), derive_seed(seed, {kCamera}));
  if (augmentation.exposure() > 0) {
    const torch::Tensor factor =
        (torch::randn({count}, generator(kExposure)) * augmentation.exposure()).exp();
    result.luminance = result.luminance * per_plane(for_planes(factor, images.channels));
  }
  if (augmentation.white_balance() > 0 && images.channels > 1) {
    const torch::Tensor factor =
        (torch::randn({images.planes()}, generator(kWhiteBalance)) * augmentation.white_balance())
            .exp();
    result.luminance = result.luminance * per_plane(factor);
  }
  if (augmentation.noise().max() > 0) {
    const torch::Tensor level =
        uniform(augmentation.noise().min(), augmentation.noise().max(), count, random(kNoiseLevel));
    torch::Tensor normal = torch::randn(result.luminance.sizes(), generator(kNoise));
    if (images.channels > 1) {
      normal =
          alike_in_colours(normal, images.channels, generator(kCommonNoise), random(kLikeness));
    }
    result = brought_up_to_noise(result, for_planes(level, images.channels), normal);
  }
  return result;
}

v1::Augmentation noise_of_level(double level) {
  v1::Augmentation augmentation;
  augmentation.mutable_noise()->set_min(level);
  augmentation.mutable_noise()->set_max(level);
  return augmentation;
}

ImageBatch with_noise(const ImageBatch& images, double level, uint64_t seed) {
  return augmented(images, noise_of_level(level), seed);
}

}  // namespace itn
