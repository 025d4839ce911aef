#include "common/learning/predictor.h"

#include <fmt/format.h>

#include "common/error.h"
#include "common/learning/checkpoint.h"

namespace itn {
namespace {

// One of the interleaved channels.
std::vector<float> channel_of(const FramedPhotograph& photograph, int channel) {
  std::vector<float> values;
  for (size_t i = channel; i < photograph.pixels.size(); i += photograph.channels) {
    values.push_back(photograph.pixels[i]);
  }
  return values;
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
}

ImageBatch Predictor::seen(const Photograph& photograph, const std::stop_token& stop) const {
  validate(photograph, stop);
  const FramedPhotograph square = framed(photograph, stop);
  std::vector<ImageBatch> channels;
  for (int channel = 0; channel < square.channels; ++channel) {
    channels.push_back(resampled(square.side, channel_of(square, channel), square.mask,
                                 static_cast<int>(model_.resolution()), model_.input()));
  }
  return concatenated(channels);
}

std::vector<MaterialEstimate> Predictor::estimate(const ImageBatch& images) {
  const torch::NoGradGuard no_gradient;
  const torch::Tensor outputs =
      encoder_->forward(network_input(model_, images)).to(torch::kFloat64).contiguous();
  std::vector<MaterialEstimate> estimates;
  for (int64_t i = 0; i < images.size(); ++i) {
    const double* o = outputs[i].data_ptr<double>();
    if (model_.output() == v1::GAUSSIAN) {
      const Posterior p = posterior(space_, std::span<const double, kGaussianOutputs>(o, 9));
      estimates.push_back({p.mean(), p, std::vector<double>(o, o + 9)});
    } else {
      estimates.push_back(
          {space_.material({o[0], o[1], o[2]}), std::nullopt, std::vector<double>(o, o + 3)});
    }
  }
  return estimates;
}

std::vector<MaterialEstimate> Predictor::estimate(const Photograph& photograph,
                                                  const std::stop_token& stop) {
  return estimate(seen(photograph, stop));
}

std::vector<Material> Predictor::predict(const Photograph& photograph,
                                         const std::stop_token& stop) {
  std::vector<Material> materials;
  for (const MaterialEstimate& a : estimate(photograph, stop)) {
    materials.push_back(a.material);
  }
  return materials;
}

double Predictor::log_likelihood(const MaterialEstimate& estimate, const Material& truth) const {
  const Triple z = space_.standardized(truth);
  return -negative_log_likelihood(
              torch::tensor(estimate.outputs, torch::kFloat64).unsqueeze(0),
              torch::tensor(std::vector<double>(z.begin(), z.end()), torch::kFloat64).unsqueeze(0))
              .item<double>();
}

std::string Predictor::name() const {
  return fmt::format("{}, step {}", model_.name(), model_.step());
}

}  // namespace itn
