#include "client/training/augmentation.h"

#include <ATen/CPUGeneratorImpl.h>

namespace itn {

ImageBatch with_noise(ImageBatch images, double noise, uint64_t seed) {
  const at::Generator generator = at::detail::createCPUGenerator(seed);
  const torch::Tensor missing =
      (noise * noise - images.noise.square()).clamp_min(0).sqrt().unsqueeze(1).unsqueeze(2);
  const torch::Tensor factor = 1 + missing * torch::randn(images.luminance.sizes(), generator);
  images.luminance = (images.luminance * factor).clamp_min(0);
  images.noise = images.noise.clamp_min(noise);
  return images;
}

}  // namespace itn
