#include "client/training/training.h"

#include <cmath>
#include <utility>

#include <ATen/autocast_mode.h>
#include <fmt/format.h>
#include <torch/nn/utils/clip_grad.h>

#include "client/training/augmentation.h"
#include "client/training/camera_augmentation.h"
#include "client/training/first_order_augmentation.h"
#include "client/training/learning_rate.h"
#include "client/training/shuffled_colours.h"
#include "common/error.h"
#include "common/random.h"

namespace itn {
namespace {

// Branches of the tree of random choices below a run's seed.
enum TrainingChoice : uint64_t {
  kInitialWeights,
  kOrder,
  kRenders,
  kAugmentation,
  kMaterialSteps,
  kColourOrders
};

// The two terms are balanced over the first steps and then left alone: from there on the loss that
// is minimised is one and the same.
constexpr uint64_t kBalanceSteps = 10;

// `truth`: the channels of each image, one image after the other.
torch::Tensor standardized_targets(const AnswerSpace& space, std::span<const Material> truth) {
  const auto images = static_cast<int64_t>(truth.size() / space.channels());
  torch::Tensor targets = torch::empty({images, static_cast<int64_t>(space.size())});
  float* value = targets.data_ptr<float>();
  for (; !truth.empty(); truth = truth.subspan(space.channels())) {
    for (const double number : space.standardized(truth.first(space.channels()))) {
      *value++ = static_cast<float>(number);
    }
  }
  return targets;
}

// Mean over the rows of their lengths.
double mean_norm(const torch::Tensor& gradients) {
  return gradients.to(torch::kFloat64).norm(2, 1).mean().item<double>();
}

// lambda = sum of |d regression / d output| over sum of |d image / d output|, each the mean over
// the batch, summed over the first steps: from then on fixed. Both terms then pull about equally
// hard.
double balance(const LossTerm& regression, const LossTerm& image, v1::TrainingState& state) {
  if (state.balance_steps() < kBalanceSteps) {
    state.set_balance_steps(state.balance_steps() + 1);
    state.set_regression_gradient(state.regression_gradient() + mean_norm(regression.gradient));
    state.set_image_gradient(state.image_gradient() + mean_norm(image.gradient));
  }
  return state.image_gradient() > 0 ? state.regression_gradient() / state.image_gradient() : 0;
}

Encoder initial_encoder(const v1::TrainingConfig& config, const v1::Model& start) {
  if (start.weights_size() > 0) return load_encoder(start);
  torch::manual_seed(derive_seed(config.seed(), {kInitialWeights}));
  return new_encoder(start);
}

// The model that a training begins with: under the name that it has, or one that says what it is;
// with what predictions must know of the training; without what was true of earlier weights alone.
v1::Model model_to_train(v1::Model model, const v1::TrainingConfig& config) {
  const char* kind = config.architecture().has_residual_convolutions() ? "residual"
                     : config.parameterization() == v1::NAIVE          ? "naive"
                     : config.parameterization() == v1::SIMILARITY     ? "similarity"
                                                                       : "unbounded";
  if (model.name().empty()) {
    model.set_name(
        fmt::format("{}-{}", config.loss() == v1::TrainingConfig::ITN ? "itn" : "rn", kind));
  }
  model.set_noise(config.augmentation().noise().max());
  model.set_mirrored(config.augmentation().mirror());
  model.clear_camera();
  if (changes_images(config.augmentation().camera())) {
    *model.mutable_camera() = config.augmentation().camera();
  }
  model.clear_weights();
  model.clear_outlier_model();
  model.clear_calibration();
  return model;
}

// In its scope torch's convolutions are of bfloat16, and so will be those of the gradient.
class Bfloat16Scope {
 public:
  Bfloat16Scope() {
    at::autocast::set_autocast_cpu_dtype(at::kBFloat16);
    at::autocast::set_cpu_enabled(true);
  }
  ~Bfloat16Scope() {
    at::autocast::clear_cache();  // of weights, which the next step has others of
    at::autocast::set_cpu_enabled(false);
  }
  Bfloat16Scope(const Bfloat16Scope&) = delete;
  Bfloat16Scope& operator=(const Bfloat16Scope&) = delete;
};

// The last layer computes with float32 in any case: a Gaussian may be as narrow as a rounding of
// its mean.
torch::Tensor forward(EncoderNetwork& encoder, const torch::Tensor& input,
                      v1::TrainingConfig::Precision precision) {
  if (precision != v1::TrainingConfig::BFLOAT16) return encoder.forward(input);
  const torch::Tensor embedding = [&] {
    const Bfloat16Scope scope;
    return encoder.embed(input);
  }();
  return encoder.answer(embedding.to(torch::kFloat32));
}

// A sum is finite only if all of its terms are.
bool is_finite(const torch::Tensor& tensor) {
  return std::isfinite(tensor.sum().item<double>());
}

// Puts a network's running statistics back as they were, unless they are to be kept.
class RunningStatistics {
 public:
  explicit RunningStatistics(const EncoderNetwork& encoder) {
    for (const NamedTensor& named : running_statistics(encoder)) {
      before_.emplace_back(named.tensor, named.tensor.clone());
    }
  }
  ~RunningStatistics() {
    const torch::NoGradGuard no_gradient;
    for (auto& [tensor, value] : before_) tensor.copy_(value);
  }
  RunningStatistics(const RunningStatistics&) = delete;
  RunningStatistics& operator=(const RunningStatistics&) = delete;

  void keep() { before_.clear(); }

 private:
  std::vector<std::pair<torch::Tensor, torch::Tensor>> before_;
};

// The batches of a dataset that the configuration wants.
std::unique_ptr<Batches> batches_of(const v1::TrainingConfig& config, const LabelledImages& images,
                                    const PackedInputs& inputs, const v1::Model& model) {
  std::unique_ptr<Batches> batches =
      std::make_unique<DatasetBatches>(images, inputs, derive_seed(config.seed(), {kOrder}),
                                       config.loss() == v1::TrainingConfig::RN);
  if (has_first_order_augmentation(config)) {
    batches = std::make_unique<FirstOrderAugmentation>(
        std::move(batches), *inputs.derivatives(), model.bounds(),
        config.augmentation().first_order_step(), derive_seed(config.seed(), {kMaterialSteps}));
  }
  if (config.augmentation().shuffle_colours()) {
    batches = std::make_unique<ShuffledColours>(std::move(batches),
                                                derive_seed(config.seed(), {kColourOrders}));
  }
  return batches;
}

const v1::TrainingConfig& validated(const v1::TrainingConfig& config) {
  validate(config);
  return config;
}

}  // namespace

bool has_first_order_augmentation(const v1::TrainingConfig& config) {
  return config.augmentation().first_order_step() > 0;
}

void validate(const v1::TrainingConfig& config) {
  const auto require = [](bool condition, const char* message) {
    if (!condition) throw invalid_input(message);
  };
  require(config.loss() == v1::TrainingConfig::RN || config.loss() == v1::TrainingConfig::ITN,
          "loss must be RN or ITN");
  require(config.parameterization() == v1::NAIVE || config.parameterization() == v1::SIMILARITY ||
              config.parameterization() == v1::UNBOUNDED,
          "parameterization must be NAIVE, SIMILARITY or UNBOUNDED");
  require(config.steps() >= 1 && config.steps() <= UINT32_MAX, "steps must be in [1, 2^32)");
  require(config.batch() >= 1, "batch must be 1 at least");
  require(config.architecture().kind_case() != v1::Architecture::KIND_NOT_SET,
          "an architecture is needed");
  require(config.output() == v1::POINT || config.output() == v1::GAUSSIAN,
          "output must be POINT or GAUSSIAN");
  require(config.output() != v1::GAUSSIAN || config.parameterization() == v1::UNBOUNDED,
          "a Gaussian output needs the parameterization UNBOUNDED");
  require(config.components() <= kMaxComponents, "there are at most 16 components");
  static_assert(kMaxComponents == 16);
  require(
      config.components() <= 1 ||
          (config.output() == v1::GAUSSIAN && config.loss() == v1::TrainingConfig::RN),
      "components are Gaussians of a mixture: several take the output GAUSSIAN and the loss RN");
  require(config.input() != v1::NETWORK_INPUT_UNSPECIFIED, "an input is needed");
  require(config.exposure() != v1::EXPOSURE_UNSPECIFIED, "exposure must be known or unknown");
  validate(config.augmentation());
  require(!has_first_order_augmentation(config) || config.loss() == v1::TrainingConfig::RN,
          "augmentation.first_order_step changes what images are of: it takes the loss RN");
  require(!config.augmentation().shuffle_colours() || config.loss() == v1::TrainingConfig::RN,
          "augmentation.shuffle_colours changes what images are of: it takes the loss RN");
  require(!has_first_order_augmentation(config) || !needs_weight_map(config.input()),
          "augmentation.first_order_step changes the luminance, from which the input "
          "LUMINANCE_AND_WEIGHT has a weight map: it takes the input RATIOS");
  require(!changes_images(config.augmentation().camera()) || !needs_weight_map(config.input()),
          "augmentation.camera changes masks and luminance, from which the input "
          "LUMINANCE_AND_WEIGHT has a weight map: it takes the input RATIOS");
  require(!config.architecture().has_residual_convolutions() || config.input() == v1::RATIOS,
          "the residual architecture takes the input RATIOS, which has the mask among its planes");
  require(v1::TrainingConfig::Precision_IsValid(config.precision()),
          "precision must be FLOAT32 or BFLOAT16");
  require(config.optimizer() == v1::TrainingConfig::ADAM ||
              config.optimizer() == v1::TrainingConfig::MUON,
          "optimizer must be ADAM or MUON");
  require(config.mean_weight() >= 0 && std::isfinite(config.mean_weight()),
          "mean_weight must be finite and >= 0");
  require(config.mean_weight() == 0 || config.output() == v1::GAUSSIAN,
          "mean_weight is for the output GAUSSIAN: a POINT is its own mean");
  require(config.schedule() == v1::TrainingConfig::CONSTANT ||
              config.schedule() == v1::TrainingConfig::COSINE,
          "schedule must be CONSTANT or COSINE");
  require(config.learning_rate() > 0 && std::isfinite(config.learning_rate()),
          "the learning rate must be positive");
  require(config.warmup_steps() < config.steps(), "there must be more steps than warmup_steps");
  require(config.weight_decay() >= 0 && config.weight_decay() <= 1,
          "weight_decay must be in [0, 1]");
  require(config.max_gradient_norm() >= 0 && std::isfinite(config.max_gradient_norm()),
          "max_gradient_norm must be >= 0");
  require(config.weight_average_decay() >= 0 && config.weight_average_decay() < 1,
          "weight_average_decay must be in [0, 1)");
  require(v1::TrainingConfig::ImageWeights_IsValid(config.image_weights()),
          "image_weights must be WEIGHT_MAP or UNIFORM");
  require(!config.has_lambda() || (config.lambda() >= 0 && std::isfinite(config.lambda())),
          "lambda must be >= 0");
  if (config.loss() == v1::TrainingConfig::ITN) {
    require(config.estimates() >= 2 && config.estimates() <= 16,
            "estimates must be in [2, 16]: products of one estimate with itself are biased");
    require(config.spp() >= config.estimates(), "spp must be as large as estimates at least");
    require(config.pilot_spp() <= 64, "pilot_spp must be in [0, 64]");
  }
}

Trainer::Trainer(v1::TrainingConfig config, std::unique_ptr<Batches> batches,
                 const v1::Model& start)
    : batches_(std::move(batches)),
      model_(model_to_train(start, validated(config))),
      space_(model_),
      encoder_(initial_encoder(config, start)),
      optimizer_(*encoder_, config),
      regression_loss_(make_regression_loss(config.output(), config.mean_weight())) {
  if (start.resolution() != static_cast<uint32_t>(batches_->resolution())) {
    throw invalid_input(
        fmt::format("the network is for {0} x {0} pixels; the images have {1} x {1}",
                    start.resolution(), batches_->resolution()));
  }
  if (config.weight_average_decay() > 0) average_.emplace(*encoder_, config.weight_average_decay());
  *state_.mutable_config() = std::move(config);
}

Trainer::Trainer(v1::TrainingConfig config, const LabelledImages& images,
                 const PackedInputs& inputs, const v1::Model& start,
                 RerenderingEvaluator image_term)
    : Trainer(config, batches_of(config, images, inputs, start), start) {
  if (config.loss() != v1::TrainingConfig::ITN) return;
  image_loss_ = std::make_unique<RerenderingLoss>(space_.channel(0), images, std::move(image_term),
                                                  config.image_weights(),
                                                  derive_seed(config.seed(), {kRenders}));
}

void Trainer::restore(const v1::Checkpoint& checkpoint) {
  encoder_ = load_encoder(checkpoint.model());
  if (average_) {
    average_->restore(*encoder_, checkpoint.training().step());
    v1::Model last = checkpoint.model();
    *last.mutable_weights() = checkpoint.training().weights();
    encoder_ = load_encoder(last);
  }
  optimizer_ = Optimizer(*encoder_, state_.config());
  optimizer_.restore(checkpoint.training().optimizer());
  const v1::TrainingConfig config = state_.config();
  state_ = checkpoint.training();
  state_.clear_optimizer();
  state_.clear_weights();
  *state_.mutable_config() = config;  // may ask for more steps
}

v1::Checkpoint Trainer::checkpoint() const {
  v1::Checkpoint checkpoint;
  *checkpoint.mutable_model() = model();
  *checkpoint.mutable_training() = state_;
  *checkpoint.mutable_training()->mutable_optimizer() = optimizer_.state();
  if (average_) {
    v1::Model last;
    store_weights(*encoder_, last);
    checkpoint.mutable_training()->mutable_weights()->Swap(last.mutable_weights());
  }
  return checkpoint;
}

v1::Model Trainer::model() const {
  v1::Model model = model_;
  model.set_step(state_.step());
  store_weights(average_ ? average_->means() : all_tensors(*encoder_), model);
  return model;
}

// Eqs. 2 and 3. Torch sees a surrogate of the loss with the same gradient in the outputs: outputs .
// gradient, where the gradient was computed by the terms and is a constant to it.
v1::TrainingMetrics Trainer::step() {
  const v1::TrainingConfig config = state_.config();  // a copy: the state is replaced
  v1::TrainingState next = state_;
  next.set_step(state_.step() + 1);
  v1::TrainingMetrics metrics;
  // Take the batch of this step.
  const TrainingImages taken = batches_->batch_at(state_.step(), config.batch());
  const Batch batch{.step = state_.step(),
                    .items = taken.items,
                    .targets = standardized_targets(space_, taken.truth)};
  // Predict.
  encoder_->train();
  RunningStatistics statistics(*encoder_);
  const torch::Tensor outputs =
      forward(*encoder_, input_of(taken.images, state_.step()), config.precision());
  if (!is_finite(outputs)) throw diverged("the network's answers are");
  // Add up the terms of the loss.
  const int64_t count = outputs.size(0), labelled = batch.targets.size(0);
  const LossTerm regression =
      regression_loss_->evaluate(batch, outputs.slice(0, 0, labelled).detach());
  torch::Tensor gradient = torch::zeros_like(outputs);
  // A mean over all of the batch is taken below, and this one is over those with labels.
  gradient.slice(0, 0, labelled)
      .copy_(regression.gradient * (static_cast<double>(count) / static_cast<double>(labelled)));
  metrics.set_regression_loss(regression.value);
  if (image_loss_) {
    const LossTerm image = image_loss_->evaluate(batch, outputs.detach());
    const double lambda = config.has_lambda() ? config.lambda() : balance(regression, image, next);
    gradient = gradient + lambda * image.gradient;
    metrics.set_image_loss(image.value);
    metrics.set_lambda(lambda);
  }
  if (!std::isfinite(regression.value) || !std::isfinite(metrics.image_loss())) {
    throw diverged("the loss is");
  }
  // Descend.
  encoder_->zero_grad();
  surrogate_loss(outputs, gradient).backward();
  for (const torch::Tensor& parameter : encoder_->parameters()) {
    if (!is_finite(parameter.grad())) throw diverged("the gradient is");
  }
  metrics.set_learning_rate(learning_rate(config, state_.step()));
  descend(metrics.learning_rate());
  statistics.keep();
  for (const torch::Tensor& parameter : encoder_->parameters()) {
    if (!is_finite(parameter)) throw diverged("the weights are");
  }
  if (average_) average_->update(*encoder_);
  state_ = next;
  metrics.set_step(static_cast<uint32_t>(state_.step()));
  metrics.set_images(batches_->image_count());
  metrics.set_epoch(static_cast<double>(state_.step()) * config.batch() /
                    static_cast<double>(metrics.images()));
  return metrics;
}

void Trainer::descend(double rate) {
  const v1::TrainingConfig& config = state_.config();
  if (config.max_gradient_norm() > 0) {
    torch::nn::utils::clip_grad_norm_(encoder_->parameters(), config.max_gradient_norm());
  }
  if (config.weight_decay() > 0) {
    const torch::NoGradGuard no_gradient;
    for (torch::Tensor& parameter : encoder_->parameters()) {
      if (parameter.dim() > 1) {  // not biases, nor the scales of normalisations
        parameter.mul_(1 - rate * config.weight_decay());
      }
    }
  }
  optimizer_.step(rate);
}

void Trainer::require_finite_answers() const {
  if (state_.step() == 0) return;
  const uint64_t last = state_.step() - 1;
  const TrainingImages taken = batches_->batch_at(last, state_.config().batch());
  const torch::NoGradGuard no_gradient;
  encoder_->eval();
  if (!is_finite(encoder_->forward(input_of(taken.images, last)))) {
    throw diverged("the network's answers are");
  }
}

torch::Tensor Trainer::input_of(const ImageBatch& images, uint64_t step) const {
  const v1::TrainingConfig& config = state_.config();
  return network_input(model_, augmented(images, config.augmentation(),
                                         derive_seed(config.seed(), {kAugmentation, step})));
}

Diverged Trainer::diverged(const char* what) const {
  return {ErrorKind::kInvalidInput,
          fmt::format("the training has diverged: {} not finite after step {}; a smaller learning "
                      "rate than {:g} may help (--learning-rate)",
                      what, state_.step(), state_.config().learning_rate())};
}

}  // namespace itn
