#include "common/learning/predictor.h"

#include <ATen/CPUGeneratorImpl.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
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
// its coordinate goes to infinity. Ranges of sigma_t count by their logarithm, as they may span
// decades.
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
    if (parameter == 0) {
      for (double* value : {&low, &high, &min, &max}) *value = std::log(*value);
    }
    if (low <= min + kAtBound * (max - min)) reached.push_back(least);
    if (high >= max - kAtBound * (max - min)) reached.push_back(most);
  };
  const Material& m = estimate.material;
  look(0, m.sigma_t, range.sigma_t().min(), range.sigma_t().max(), v1::SIGMA_T_MIN,
       v1::SIGMA_T_MAX);
  look(1, m.albedo, range.albedo().min(), range.albedo().max(), v1::ALBEDO_MIN, v1::ALBEDO_MAX);
  look(2, m.g, range.g().min(), range.g().max(), v1::G_MIN, v1::G_MAX);
  return reached;
}

std::optional<double> size_of(const v1::Capture& capture) {
  return capture.has_object_size() ? std::optional(capture.object_size()) : std::nullopt;
}

void throw_if_stopped(const std::stop_token& stop) {
  if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "the prediction was cancelled");
}

// The farther of both.
void take_worse(const std::optional<OutlierScore>& other, std::optional<OutlierScore>& worst) {
  if (other && (!worst || other->score > worst->score)) worst = other;
}

// A network answers for an object whose longest side is 1 mm.
void make_per_mm(MaterialEstimate& estimate, double object_size) {
  estimate.material.sigma_t /= object_size;
  if (!estimate.posterior) return;
  const auto scale = [](ParameterPosterior& p, double factor) {
    for (double* value : {&p.mean, &p.standard_deviation, &p.median, &p.low, &p.high}) {
      *value *= factor;
    }
  };
  Posterior& posterior = *estimate.posterior;
  scale(posterior.material.parameters[0], 1 / object_size);
  for (ParameterPosterior& p : posterior.scattering.parameters) scale(p, 1 / object_size);
  scale(posterior.diffusion_length, object_size);
}

// Adds warnings of a kind that is not there yet.
void add_new(std::span<const v1::Warning> from, std::vector<v1::Warning>& to) {
  for (const v1::Warning& warning : from) {
    const auto same = [&](const v1::Warning& other) { return other.kind() == warning.kind(); };
    if (std::ranges::none_of(to, same)) to.push_back(warning);
  }
}

torch::Tensor row_of(const std::vector<double>& values) {
  return torch::tensor(values, torch::kFloat64).unsqueeze(0);
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
  if (model.has_outlier_model()) {
    outlier_detector_.emplace(model.outlier_model(), embedding_size(model));
  }
  if (model.has_calibration()) {
    if (model.output() != v1::GAUSSIAN) {
      throw invalid_input("the model corrects the widths of answers that have none");
    }
    calibration_ = to_tensor(model.calibration(), space_.size());
    levels_ = interval_levels(model.calibration());
  }
  model_.clear_weights();
  model_.clear_outlier_model();
  const int64_t side = model.resolution();
  noise_ = torch::randn({static_cast<int64_t>(space_.channels()), side, side},
                        at::detail::createCPUGenerator(kNoiseSeed));
}

ImageBatch Predictor::as_noisy_as_training(const ImageBatch& image) const {
  return brought_up_to_noise(image, torch::full({image.planes()}, model_.noise()), noise_);
}

NetworkView Predictor::seen(const Photograph& photograph, const v1::Capture& capture,
                            const std::stop_token& stop) const {
  validate(photograph, stop);
  validate(capture, photograph.channels);
  const auto colours = static_cast<int64_t>(space_.channels());
  if (colours > 1 && photograph.channels != colours) {
    throw invalid_input(
        fmt::format("the model {} answers about photographs in "
                    "colour; this one has one channel",
                    model_.name()));
  }
  const FramedPhotograph square = framed(photograph, stop);
  std::vector<ImageBatch> channels;
  for (int channel = 0; channel < square.channels; ++channel) {
    channels.push_back(resampled(square.side, channel_of(square, channel), square.mask,
                                 static_cast<int>(model_.resolution()), model_.input()));
    channels.back().luminance *= radiance_factor(capture, model_, channel);
    if (!channels.back().luminance.isfinite().all().item<bool>()) {
      throw invalid_input(
          "the image is too bright to be computed with after it was brought to the model's scale: "
          "is capture.exposure or capture.white right?");
    }
  }
  NetworkView view{concatenated(channels), size_of(capture),
                   warnings(photograph, capture, model_, stop)};
  view.channels.channels = colours;
  return view;
}

std::vector<MaterialEstimate> Predictor::estimates_of(std::span<const double> outputs,
                                                      double object_size,
                                                      const IntervalLevels& levels) const {
  std::vector<MaterialEstimate> estimates(space_.channels());
  if (model_.output() == v1::GAUSSIAN) {
    const std::vector<Posterior> channels = posteriors(space_, outputs, levels);
    for (size_t c = 0; c < channels.size(); ++c) {
      estimates[c].posterior = channels[c];
      estimates[c].material = channels[c].mean();
    }
  } else {
    const std::vector<Material> channels = space_.materials(outputs);
    for (size_t c = 0; c < channels.size(); ++c) estimates[c].material = channels[c];
  }
  for (MaterialEstimate& estimate : estimates) {
    estimate.outputs.assign(outputs.begin(), outputs.end());
    estimate.at_bounds = bounds_reached(estimate, model_.bounds());
    make_per_mm(estimate, object_size);
  }
  return estimates;
}

std::vector<MaterialEstimate> Predictor::estimate(const ImageBatch& as_measured) const {
  const std::vector<double> sizes(static_cast<size_t>(as_measured.size()), 1);
  return estimate(as_measured, sizes, [this](const torch::Tensor& input) { return embed(input); });
}

std::vector<MaterialEstimate> Predictor::estimate(const ImageBatch& as_measured,
                                                  std::span<const double> object_sizes,
                                                  const Embed& embed) const {
  const torch::InferenceMode inference;
  const Features features = features_of(as_measured, embed);
  std::vector<MaterialEstimate> estimates;
  for (size_t i = 0; i < object_sizes.size(); ++i) {
    const auto row = static_cast<int64_t>(i);
    const Features image{features.embedding.slice(0, row, row + 1),
                         features.statistics.slice(0, row, row + 1)};
    const torch::Tensor outputs = outputs_of(image.embedding);
    std::vector<MaterialEstimate> channels =
        estimates_of({outputs.data_ptr<double>(), static_cast<size_t>(outputs.size(1))},
                     object_sizes[i], levels_);
    std::optional<OutlierScore> outlier;
    if (outlier_detector_) outlier = outlier_detector_->scores(image).front();
    for (MaterialEstimate& channel : channels) {
      channel.outlier = outlier;
      estimates.push_back(std::move(channel));
    }
  }
  return estimates;
}

Features Predictor::features(const ImageBatch& as_measured) const {
  const torch::InferenceMode inference;
  return features_of(as_measured, [this](const torch::Tensor& input) { return embed(input); });
}

torch::Tensor Predictor::embed(const torch::Tensor& input) const {
  const torch::InferenceMode inference;
  return encoder_->embed(input);
}

int64_t Predictor::inputs_at_a_time() const {
  constexpr int64_t kPixels = int64_t{1} << 17;  // 32 inputs of 64 x 64
  const int64_t pixels = int64_t{model_.resolution()} * model_.resolution();
  return std::max<int64_t>(kPixels / pixels, 1 + int64_t{model_.mirrored()});
}

// Each image is prepared by itself, as sums over several at once would depend on how many they are.
// The last layer is linear: the mean of what it sees gives the mean of its answers.
Features Predictor::features_of(const ImageBatch& as_measured, const Embed& embed) const {
  if (as_measured.channels != static_cast<int64_t>(space_.channels())) {
    throw invalid_input(fmt::format("the model {} answers about images of {} channels, not of {}",
                                    model_.name(), space_.channels(), as_measured.channels));
  }
  std::vector<torch::Tensor> inputs, statistics;
  for (int64_t i = 0; i < as_measured.size(); ++i) {
    const ImageBatch measured = image_of(as_measured, i);
    const ImageBatch image = as_noisy_as_training(measured);
    inputs.push_back(network_input(model_, image));
    if (model_.mirrored()) {
      inputs.push_back(network_input(model_, as_noisy_as_training(mirrored(measured))));
    }
    statistics.push_back(image_statistics(model_, image));
  }
  const auto at_a_time = static_cast<size_t>(inputs_at_a_time());
  std::vector<torch::Tensor> rows;
  for (size_t i = 0; i < inputs.size(); i += at_a_time) {
    const size_t count = std::min(at_a_time, inputs.size() - i);
    rows.push_back(embed(torch::cat(at::TensorList(inputs).slice(i, count))));
  }
  torch::Tensor embedding = torch::cat(rows);
  if (model_.mirrored()) {
    embedding = (embedding.slice(0, 0, {}, 2) + embedding.slice(0, 1, {}, 2)) / 2;
  }
  return {embedding, torch::cat(statistics)};
}

torch::Tensor Predictor::outputs_of(const torch::Tensor& embedding) const {
  torch::Tensor outputs = encoder_->answer(embedding).to(torch::kFloat64);
  if (calibration_) outputs = calibrated(outputs, *calibration_);
  return outputs.contiguous();
}

Predictor::Outcomes Predictor::estimate_each(size_t count,
                                             const std::function<NetworkView(size_t)>& seen,
                                             bool one_material, const std::stop_token& stop) const {
  return estimate_each(count, seen, one_material, stop,
                       [this](const torch::Tensor& input) { return embed(input); });
}

Predictor::Outcomes Predictor::estimate_each(size_t count,
                                             const std::function<NetworkView(size_t)>& seen,
                                             bool one_material, const std::stop_token& stop,
                                             const Embed& embed) const {
  const auto at_a_time = static_cast<size_t>(inputs_at_a_time() / (1 + int64_t{model_.mirrored()}));
  Outcomes outcomes;
  outcomes.each.resize(count);
  std::vector<std::optional<double>> photograph_sizes(count);
  std::vector<ImageBatch> waiting;
  // By channel that waits.
  std::vector<size_t> whose;
  std::vector<std::vector<v1::Warning>> warnings;
  // By image, which has one channel or all colours.
  std::vector<double> sizes;
  const auto estimate_waiting = [&] {
    if (waiting.empty()) return;
    std::vector<MaterialEstimate> estimates = estimate(concatenated(waiting), sizes, embed);
    for (size_t i = 0; i < estimates.size(); ++i) {
      estimates[i].warnings = std::move(warnings[i]);
      std::get<std::vector<MaterialEstimate>>(outcomes.each[whose[i]])
          .push_back(std::move(estimates[i]));
    }
    waiting.clear();
    whose.clear();
    sizes.clear();
    warnings.clear();
  };
  for (size_t i = 0; i < count; ++i) {
    throw_if_stopped(stop);
    try {
      NetworkView photograph = seen(i);
      whose.insert(whose.end(), photograph.warnings.size(), i);
      sizes.insert(sizes.end(), static_cast<size_t>(photograph.channels.size()),
                   photograph.object_size.value_or(1));
      waiting.push_back(std::move(photograph.channels));
      photograph_sizes[i] = photograph.object_size;
      std::ranges::move(photograph.warnings, std::back_inserter(warnings));
    } catch (const Error& error) {
      if (error.kind() == ErrorKind::kCancelled) throw;
      outcomes.each[i] = error;
    }
    if (sizes.size() >= at_a_time) estimate_waiting();
  }
  estimate_waiting();
  if (one_material) outcomes.combined = combined(outcomes.each, photograph_sizes, stop);
  return outcomes;
}

std::vector<MaterialEstimate> Predictor::combined(
    std::span<const std::vector<MaterialEstimate>> images) const {
  const std::vector<Outcome> outcomes(images.begin(), images.end());
  const std::vector<std::optional<double>> no_sizes(images.size());
  return combined(outcomes, no_sizes, {});
}

std::vector<MaterialEstimate> Predictor::combined(
    std::span<const Outcome> outcomes, std::span<const std::optional<double>> object_sizes,
    const std::stop_token& stop) const {
  const Combination combination(model_);
  std::vector<const std::vector<MaterialEstimate>*> images;
  std::vector<std::optional<double>> sizes;
  for (size_t i = 0; i < outcomes.size(); ++i) {
    if (const auto* image = std::get_if<std::vector<MaterialEstimate>>(&outcomes[i])) {
      images.push_back(image);
      sizes.push_back(object_sizes[i]);
    }
  }
  for (const std::optional<double>& size : sizes) {
    if (size.has_value() != sizes.front().has_value()) {
      throw invalid_input(
          "of images of one material capture.object_size must be known of all or of none");
    }
  }
  std::vector<MaterialEstimate> result;
  // An answer is about one channel, or about all colours.
  for (size_t first = 0; !images.empty() && first < images.front()->size();
       first += space_.channels()) {
    std::vector<ImageAnswer> answers;
    std::vector<v1::Warning> warnings;
    std::optional<OutlierScore> outlier;
    for (size_t i = 0; i < images.size(); ++i) {
      throw_if_stopped(stop);
      if (images[i]->size() != images.front()->size()) {
        throw invalid_input(fmt::format(
            "images of one material must have the same channels; one has {}, another {}",
            images.front()->size(), images[i]->size()));
      }
      const MaterialEstimate& estimate = (*images[i])[first];
      ImageAnswer& answer = answers.emplace_back();
      answer.outputs = estimate.outputs;
      answer.object_size = sizes[i].value_or(1);
      for (size_t c = 0; c < space_.channels(); ++c) {
        add_new((*images[i])[first + c].warnings, warnings);
      }
      take_worse(estimate.outlier, outlier);
    }
    for (MaterialEstimate& channel :
         estimates_of(combination(answers), sizes.front().value_or(1), nominal_levels())) {
      result.push_back(std::move(channel));
      result.back().warnings = warnings;
      result.back().outlier = outlier;
    }
  }
  return result;
}

std::vector<MaterialEstimate> Predictor::estimate(const Photograph& photograph,
                                                  const v1::Capture& capture,
                                                  const std::stop_token& stop) const {
  const auto see = [&](size_t) { return seen(photograph, capture, stop); };
  Outcome outcome = std::move(estimate_each(1, see, false, stop).each.front());
  if (const Error* error = std::get_if<Error>(&outcome)) throw *error;
  return std::get<std::vector<MaterialEstimate>>(std::move(outcome));
}

std::vector<Material> Predictor::predict(const Photograph& photograph,
                                         const std::stop_token& stop) const {
  std::vector<Material> materials;
  for (const MaterialEstimate& a : estimate(photograph, {}, stop)) materials.push_back(a.material);
  return materials;
}

double Predictor::log_likelihood(const MaterialEstimate& estimate,
                                 std::span<const Material> truth) const {
  return -negative_log_likelihood(row_of(estimate.outputs), row_of(standardized(truth)))
              .item<double>();
}

double Predictor::region_probability(const MaterialEstimate& estimate,
                                     std::span<const Material> truth) const {
  return itn::region_probability(row_of(estimate.outputs), row_of(standardized(truth)))
      .item<double>();
}

std::vector<double> Predictor::marginal_probability(const MaterialEstimate& estimate,
                                                    std::span<const Material> truth) const {
  const torch::Tensor row =
      itn::marginal_probability(row_of(estimate.outputs), row_of(standardized(truth)));
  return {row.data_ptr<double>(), row.data_ptr<double>() + row.numel()};
}

std::vector<IntervalLevels> Predictor::levels_that_reach(const MaterialEstimate& estimate,
                                                         std::span<const Material> truth) const {
  return itn::levels_that_reach(space_, estimate.outputs, truth);
}

std::string name(const v1::ModelVersion& version) {
  return fmt::format("{}{}{}, step {}", version.name(), version.version().empty() ? "" : " ",
                     version.version(), version.step());
}

std::string Predictor::name() const {
  return itn::name(version_);
}

}  // namespace itn
