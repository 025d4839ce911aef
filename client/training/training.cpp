#include "client/training/training.h"

#include <chrono>
#include <cmath>
#include <fstream>
#include <optional>

#include <fmt/format.h>
#include <google/protobuf/util/message_differencer.h>

#include "client/json.h"
#include "client/training/adam_state.h"
#include "client/training/augmentation.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/learning/checkpoint.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

// Branches of the tree of random choices below a run's seed.
enum Choice : uint64_t { kInitialWeights, kOrder, kRenders, kNoise };

// The two terms are balanced over the first steps and then left alone: from there on the loss that
// is minimised is one and the same.
constexpr uint64_t kBalanceSteps = 10;

torch::Tensor standardized_targets(const OutputSpace& space, const LabelledImages& images) {
  torch::Tensor targets = torch::empty({static_cast<int64_t>(images.truth.size()), 3});
  auto values = targets.accessor<float, 2>();
  for (size_t i = 0; i < images.truth.size(); ++i) {
    const Triple target = space.standardized(images.truth[i]);
    for (size_t k = 0; k < 3; ++k) {
      values[static_cast<int64_t>(i)][static_cast<int64_t>(k)] = static_cast<float>(target[k]);
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
  if (start.weights_size() > 0) {
    return load_encoder(start);
  }
  torch::manual_seed(derive_seed(config.seed(), {kInitialWeights}));
  return new_encoder(start);
}

// Of the configuration's kind and schedule, of which there is one each (validate()).
std::unique_ptr<torch::optim::Adam> new_optimizer(const Encoder& encoder,
                                                  const v1::TrainingConfig& config) {
  return std::make_unique<torch::optim::Adam>(encoder->parameters(),
                                              torch::optim::AdamOptions(config.learning_rate()));
}

v1::Model named(v1::Model model, const v1::TrainingConfig& config) {
  const char* kind = config.architecture().has_residual_convolutions() ? "residual"
                     : config.parameterization() == v1::NAIVE          ? "naive"
                     : config.parameterization() == v1::SIMILARITY     ? "similarity"
                                                                       : "unbounded";
  model.set_name(
      fmt::format("{}-{}", config.loss() == v1::TrainingConfig::ITN ? "itn" : "rn", kind));
  model.clear_weights();
  return model;
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
    for (auto& [tensor, value] : before_) {
      tensor.copy_(value);
    }
  }
  RunningStatistics(const RunningStatistics&) = delete;
  RunningStatistics& operator=(const RunningStatistics&) = delete;

  void keep() { before_.clear(); }

 private:
  std::vector<std::pair<torch::Tensor, torch::Tensor>> before_;
};

const v1::TrainingConfig& validated(const v1::TrainingConfig& config) {
  validate(config);
  return config;
}

}  // namespace

void validate(const v1::TrainingConfig& config) {
  const auto require = [](bool condition, const char* message) {
    if (!condition) {
      throw invalid_input(message);
    }
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
  require(config.input() != v1::NETWORK_INPUT_UNSPECIFIED, "an input is needed");
  require(config.exposure() != v1::EXPOSURE_UNSPECIFIED, "exposure must be known or unknown");
  require(config.noise() >= 0 && config.noise() <= 1, "noise must be in [0, 1]");
  require(!config.architecture().has_residual_convolutions() || config.input() == v1::RATIOS,
          "the residual architecture takes the input RATIOS, which has the mask among its planes");
  require(config.optimizer() == v1::TrainingConfig::ADAM, "optimizer must be ADAM");
  require(config.schedule() == v1::TrainingConfig::CONSTANT, "schedule must be CONSTANT");
  require(config.learning_rate() > 0 && std::isfinite(config.learning_rate()),
          "the learning rate must be positive");
  if (config.loss() == v1::TrainingConfig::ITN) {
    require(config.estimates() >= 2 && config.estimates() <= 16,
            "estimates must be in [2, 16]: products of one estimate with itself are biased");
    require(config.spp() >= config.estimates(), "spp must be as large as estimates at least");
    require(config.pilot_spp() <= 64, "pilot_spp must be in [0, 64]");
    require(!config.has_lambda() || (config.lambda() >= 0 && std::isfinite(config.lambda())),
            "lambda must be >= 0");
  }
}

Trainer::Trainer(v1::TrainingConfig config, const LabelledImages& images,
                 const PackedInputs& inputs, const v1::Model& start, ImageTerm image_term)
    : images_(images),
      inputs_(inputs),
      model_(named(start, validated(config))),
      space_(model_),
      targets_(standardized_targets(space_, images)),
      encoder_(initial_encoder(config, start)),
      optimizer_(new_optimizer(encoder_, config)),
      sampler_(static_cast<uint32_t>(images.items.size()), derive_seed(config.seed(), {kOrder})),
      regression_loss_(distance_to_truth(config.output())) {
  if (start.resolution() != static_cast<uint32_t>(inputs.format().resolution)) {
    throw invalid_input(
        fmt::format("the network is for {0} x {0} pixels; the images have {1} x {1}",
                    start.resolution(), inputs.format().resolution));
  }
  if (config.loss() == v1::TrainingConfig::ITN) {
    image_loss_ = std::make_unique<ImageLoss>(space_, images_, std::move(image_term),
                                              derive_seed(config.seed(), {kRenders}));
  }
  *state_.mutable_config() = std::move(config);
}

void Trainer::restore(const v1::Checkpoint& checkpoint) {
  encoder_ = load_encoder(checkpoint.model());
  optimizer_ = new_optimizer(encoder_, state_.config());
  restore_state(*optimizer_, *encoder_, checkpoint.training().optimizer());
  const v1::TrainingConfig config = state_.config();
  state_ = checkpoint.training();
  state_.clear_optimizer();
  *state_.mutable_config() = config;  // may ask for more steps
}

v1::Checkpoint Trainer::checkpoint() const {
  v1::Checkpoint checkpoint;
  *checkpoint.mutable_model() = model_;
  checkpoint.mutable_model()->set_step(state_.step());
  store_weights(*encoder_, *checkpoint.mutable_model());
  *checkpoint.mutable_training() = state_;
  *checkpoint.mutable_training()->mutable_optimizer() = state_of(*optimizer_, *encoder_);
  return checkpoint;
}

// Eqs. 2 and 3. Torch sees a surrogate of the loss with the same gradient in the outputs: outputs .
// gradient, where the gradient was computed by the terms and is a constant to it.
v1::TrainingMetrics Trainer::step() {
  const v1::TrainingConfig& config = state_.config();
  v1::TrainingState next = state_;
  next.set_step(state_.step() + 1);
  v1::TrainingMetrics metrics;
  // Take the batch of this step.
  const std::vector<uint32_t> items = sampler_.batch(state_.step(), config.batch());
  const torch::Tensor index = torch::tensor(std::vector<int64_t>(items.begin(), items.end()));
  const Batch batch{
      .step = state_.step(), .items = items, .targets = targets_.index_select(0, index)};
  // Predict.
  encoder_->train();
  RunningStatistics statistics(*encoder_);
  const torch::Tensor outputs = encoder_->forward(inputs_of(items, state_.step()));
  if (!is_finite(outputs)) {
    throw diverged("the network's answers are");
  }
  // Add up the terms of the loss.
  const LossTerm regression = regression_loss_->evaluate(batch, outputs.detach());
  torch::Tensor gradient = regression.gradient;
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
  optimizer_->zero_grad();
  surrogate_loss(outputs, gradient).backward();
  for (const torch::Tensor& parameter : encoder_->parameters()) {
    if (!is_finite(parameter.grad())) {
      throw diverged("the gradient is");
    }
  }
  optimizer_->step();
  statistics.keep();
  for (const torch::Tensor& parameter : encoder_->parameters()) {
    if (!is_finite(parameter)) {
      throw diverged("the weights are");
    }
  }
  state_ = next;
  metrics.set_step(static_cast<uint32_t>(state_.step()));
  metrics.set_epoch(static_cast<double>(state_.step()) * config.batch() /
                    static_cast<double>(images_.items.size()));
  return metrics;
}

void Trainer::require_finite_answers() const {
  if (state_.step() == 0) {
    return;
  }
  EpochSampler sampler = sampler_;
  const std::vector<uint32_t> items = sampler.batch(state_.step() - 1, state_.config().batch());
  const torch::NoGradGuard no_gradient;
  encoder_->eval();
  if (!is_finite(encoder_->forward(inputs_of(items, state_.step() - 1)))) {
    throw diverged("the network's answers are");
  }
}

torch::Tensor Trainer::inputs_of(std::span<const uint32_t> items, uint64_t step) const {
  const v1::TrainingConfig& config = state_.config();
  ImageBatch images = inputs_.batch(items);
  if (config.noise() > 0) {
    images =
        with_noise(std::move(images), config.noise(), derive_seed(config.seed(), {kNoise, step}));
  }
  return network_input(model_, images);
}

Diverged Trainer::diverged(const char* what) const {
  return {ErrorKind::kInvalidInput,
          fmt::format("the training has diverged: {} not finite after step {}; a smaller learning "
                      "rate than {:g} may help (--lr)",
                      what, state_.step(), state_.config().learning_rate())};
}

// --- A run in a folder ---

namespace {

constexpr const char* kMetricsName = "metrics.jsonl";

// Forgets the lines of steps that will be taken again.
void truncate_metrics(const fs::path& path, uint64_t step) {
  std::ifstream file(path);
  std::string kept, line;
  for (uint64_t i = 0; i < step && std::getline(file, line); ++i) {
    kept += line + '\n';
  }
  file.close();
  write_file_atomically(path, kept);
}

v1::TrainingMetrics timed_step(Trainer& trainer) {
  const auto start = std::chrono::steady_clock::now();
  v1::TrainingMetrics metrics = trainer.step();
  metrics.set_seconds(
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  return metrics;
}

void append_line(std::ofstream& file, const std::string& line, const fs::path& path) {
  file << line << '\n' << std::flush;
  if (!file) {
    throw Error(ErrorKind::kIo, fmt::format("cannot write {}", path.string()));
  }
}

// A checkpoint is written only of a network that answers.
void save(const Trainer& trainer, const TrainingRun& run) {
  trainer.require_finite_answers();
  v1::Checkpoint checkpoint = trainer.checkpoint();
  checkpoint.mutable_training()->set_dataset(run.dataset);
  checkpoint.mutable_training()->set_checkpoint_every(run.checkpoint_every);
  write_latest_checkpoint(run.folder, std::move(checkpoint));
}

}  // namespace

void require_same_config(const v1::TrainingState& there, v1::TrainingConfig wanted,
                         const fs::path& folder) {
  if (wanted.steps() < there.step()) {
    throw invalid_input(fmt::format("the run in {} has taken {} steps; {} are fewer",
                                    folder.string(), there.step(), wanted.steps()));
  }
  wanted.set_steps(there.config().steps());
  std::string text;
  google::protobuf::util::MessageDifferencer differencer;
  differencer.ReportDifferencesToString(&text);
  if (!differencer.Compare(there.config(), wanted)) {
    throw invalid_input(fmt::format(
        "the run in {} has another configuration; --resume continues it with its own (more steps "
        "are possible), or choose another folder. Differences:\n{}",
        folder.string(), text));
  }
}

void train(const v1::TrainingConfig& config, const LabelledImages& images,
           const PackedInputs& inputs, const v1::Model& start, const ImageTerm& image_term,
           const TrainingRun& run) {
  const std::optional<v1::Checkpoint> there = find_checkpoint(run.folder);
  if (there) {
    require_same_config(there->training(), config, run.folder);
  }
  Trainer trainer(config, images, inputs, there ? there->model() : start, image_term);
  if (there) {
    trainer.restore(*there);
  }
  uint64_t saved = trainer.steps_taken();
  const fs::path metrics_path = run.folder / kMetricsName;
  truncate_metrics(metrics_path, saved);
  std::ofstream metrics_file(metrics_path, std::ios::app);
  const auto save_once = [&] {
    if (trainer.steps_taken() != saved) {
      save(trainer, run);
      saved = trainer.steps_taken();
    }
  };
  try {
    try {
      while (trainer.steps_taken() < config.steps()) {
        if (run.stop.stop_requested()) {
          throw Error(ErrorKind::kCancelled, "interrupted");
        }
        const v1::TrainingMetrics metrics = timed_step(trainer);
        append_line(metrics_file, to_json(metrics), metrics_path);
        if (trainer.steps_taken() % run.checkpoint_every == 0) {
          save_once();
        }
        if (run.report) {
          run.report(metrics);
        }
      }
    } catch (const Diverged&) {
      throw;
    } catch (const Error& error) {
      // Whatever else stopped it, what was learned is kept.
      save_once();
      throw Error(error.kind(),
                  trainer.steps_taken() == 0
                      ? error.what()
                      : fmt::format("{}; stopped after step {}, the same command continues, or "
                                    "--resume without the other flags",
                                    error.what(), trainer.steps_taken()));
    }
    save_once();
  } catch (const Diverged& error) {
    throw Error(error.kind(),
                fmt::format("{}. {}", error.what(),
                            saved == 0 ? "No checkpoint was written"
                                       : fmt::format("The checkpoint of step {} is kept", saved)));
  }
}

}  // namespace itn
