#include "client/exports/rgb_material.h"

#include <fmt/format.h>

#include "common/error.h"

namespace itn {
namespace {

double common_g(std::span<const Material> channels) {
  double sum_of_g = 0, sum_of_weights = 0;
  for (const Material& channel : channels) {
    sum_of_g += channel.sigma_s() * channel.g;
    sum_of_weights += channel.sigma_s();
  }
  return sum_of_weights > 0 ? sum_of_g / sum_of_weights : 0;
}

}  // namespace

RgbMaterial rgb_material(std::span<const Material> channels) {
  if (channels.size() != 1 && channels.size() != 3) {
    throw invalid_input(
        fmt::format("{} materials; there must be one, or those of R, G and B", channels.size()));
  }
  for (const Material& channel : channels) validate(channel);

  RgbMaterial material;
  material.gray = channels.size() == 1;
  material.g = common_g(channels);
  for (size_t c = 0; c < 3; ++c) {
    const Material& channel = channels[material.gray ? 0 : c];
    material.sigma_a[c] = channel.sigma_a();
    material.sigma_s[c] = channel.sigma_s_reduced() / (1 - material.g);
  }
  return material;
}

RgbMaterial with_lengths_scaled(RgbMaterial material, double factor) {
  for (double& sigma : material.sigma_a) sigma /= factor;
  for (double& sigma : material.sigma_s) sigma /= factor;
  return material;
}

}  // namespace itn
