#include "common/learning/predictor.h"

#include <ATen/CPUGeneratorImpl.h>
#include <fmt/format.h>

#include <algorithm>
#include <utility>

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

// An interval that ends within this part of the range from its end has reached it: where g ends,
// its coordinate goes to infinity.
constexpr double kAtBound = 0.01;

std::vector<v1::MaterialBound> bounds_reached(const MaterialEstimate& estimate,
                                              const v1::MaterialRange& range) {
  std::vector<v1::MaterialBound> reached;
  const auto look = [&](size_t parameter, double guess, double min, double max,
                        v1::MaterialBound least, v1::MaterialBound most) {
    double low = guess, high = guess;
    if (estimate.posterior) {
      const ParameterPosterior& p = estimate.posterior->material.parameters[parameter];
      low = p.low;
      high = p.high;
    }
    if (low <= min + kAtBound * (max - min)) reached.push_back(least);
    if (high >= max - kAtBound * (max - min)) reached.push_back(most);
  };
  const Material& m = estimate.material;
  look(0, m.sigma_t, range.sigma_t().min(), range.sigma_t().max(), v1::SIGMA_T_LEAST,
       v1::SIGMA_T_MOST);
  look(1, m.albedo, range.albedo().min(), range.albedo().max(), v1::ALBEDO_LEAST, v1::ALBEDO_MOST);
  look(2, m.g, range.g().min(), range.g().max(), v1::G_LEAST, v1::G_MOST);
  return reached;
}

constexpr uint64_t kNoiseSeed = 3;  // an image has one answer

v1::ModelVersion version_of(const v1::Model& model) {
  v1::ModelVersion version;
  version.set_name(model.name());
  version.set_version(model.version());
  version.set_step(model.step());
  version.set_sha256(weights_sha256(model));
  return version;
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
    : model_(model), version_(version_of(model)), space_(model), encoder_(load_encoder(model)) {
  if (model.has_familiarity()) {
    familiarity_.emplace(model.familiarity(), embedding_size(model));
  }
  if (model.has_widths()) {
    if (model.output() != v1::GAUSSIAN) {
      throw invalid_input("the model corrects the widths of answers that have none");
    }
    widths_ = to_tensor(model.widths());
  }
  model_.clear_weights();
  model_.clear_familiarity();
  const int64_t side = model.resolution();
  noise_ = torch::randn({1, side, side}, at::detail::createCPUGenerator(kNoiseSeed));
}

ImageBatch Predictor::as_noisy_as_training(const ImageBatch& images) const {
  return brought_up_to_noise(images, torch::full({images.size()}, model_.noise()), noise_);
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

std::vector<MaterialEstimate> Predictor::estimate(const ImageBatch& as_measured) {
  const torch::InferenceMode inference;
  const Features features = features_of(as_measured);
  const torch::Tensor outputs = outputs_of(features.embedding);
  std::vector<Unfamiliarity> unfamiliarity;
  if (familiarity_) unfamiliarity = familiarity_->of(features);
  std::vector<MaterialEstimate> estimates;
  for (int64_t i = 0; i < as_measured.size(); ++i) {
    const double* o = outputs[i].data_ptr<double>();
    MaterialEstimate& estimate = estimates.emplace_back();
    estimate.outputs.assign(o, o + outputs.size(1));
    if (model_.output() == v1::GAUSSIAN) {
      estimate.posterior =
          posterior(space_, std::span<const double, kGaussianOutputs>(o, kGaussianOutputs));
      estimate.material = estimate.posterior->mean();
    } else {
      estimate.material = space_.material({o[0], o[1], o[2]});
    }
    estimate.at_bounds = bounds_reached(estimate, model_.bounds());
    if (familiarity_) estimate.unfamiliarity = unfamiliarity[static_cast<size_t>(i)];
  }
  return estimates;
}

Features Predictor::features(const ImageBatch& as_measured) {
  const torch::InferenceMode inference;
  return features_of(as_measured);
}

// The last layer is linear: the mean of what it sees gives the mean of its answers.
Features Predictor::features_of(const ImageBatch& as_measured) const {
  const ImageBatch images = as_noisy_as_training(as_measured);
  torch::Tensor embedding = encoder_->embed(network_input(model_, images));
  if (model_.mirrored()) {
    const ImageBatch others = as_noisy_as_training(mirrored(as_measured));
    embedding = (embedding + encoder_->embed(network_input(model_, others))) / 2;
  }
  return {embedding, image_statistics(model_, images)};
}

torch::Tensor Predictor::outputs_of(const torch::Tensor& embedding) const {
  torch::Tensor outputs = encoder_->answer(embedding).to(torch::kFloat64);
  if (widths_) outputs = corrected(outputs, *widths_);
  return outputs.contiguous();
}

std::vector<Predictor::Outcome> Predictor::estimate_each(
    size_t count, const std::function<ImageBatch(size_t)>& seen, const std::stop_token& stop) {
  // So many pixels of the network's input at a time: 32 images of 64 x 64.
  constexpr int64_t kPixelsAtATime = int64_t{1} << 17;
  const int64_t pixels = int64_t{model_.resolution()} * model_.resolution();
  const int64_t at_a_time = std::max<int64_t>(1, kPixelsAtATime / pixels);
  std::vector<Outcome> outcomes(count);
  std::vector<ImageBatch> waiting;
  std::vector<size_t> whose;  // by channel that waits
  const auto estimate_waiting = [&] {
    if (waiting.empty()) return;
    std::vector<MaterialEstimate> estimates = estimate(concatenated(waiting));
    for (size_t i = 0; i < estimates.size(); ++i) {
      std::get<std::vector<MaterialEstimate>>(outcomes[whose[i]])
          .push_back(std::move(estimates[i]));
    }
    waiting.clear();
    whose.clear();
  };
  for (size_t i = 0; i < count; ++i) {
    if (stop.stop_requested()) {
      throw Error(ErrorKind::kCancelled, "the prediction was cancelled");
    }
    try {
      waiting.push_back(seen(i));
      whose.insert(whose.end(), static_cast<size_t>(waiting.back().size()), i);
    } catch (const Error& error) {
      if (error.kind() == ErrorKind::kCancelled) throw;
      outcomes[i] = error;
    }
    if (static_cast<int64_t>(whose.size()) >= at_a_time) estimate_waiting();
  }
  estimate_waiting();
  return outcomes;
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

std::string name(const v1::ModelVersion& version) {
  return fmt::format("{}{}{}, step {}", version.name(), version.version().empty() ? "" : " ",
                     version.version(), version.step());
}

std::string Predictor::name() const {
  return itn::name(version_);
}

}  // namespace itn
