#include "client/training/training.h"

#include <chrono>
#include <cmath>
#include <fstream>

#include <fmt/format.h>
#include <google/protobuf/util/message_differencer.h>

#include "client/json.h"
#include "client/render_pool/render_pool.h"
#include "client/render_pool/render_wait.h"
#include "client/training/adam_state.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/learning/checkpoint.h"
#include "common/rpc/wire_array.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

// Branches of the tree of random choices below a run's seed.
enum Choice : uint64_t { kInitialWeights, kOrder, kRenders };

// The two terms are balanced over the first steps and then left alone: from there on the loss that
// is minimised is one and the same.
constexpr uint64_t kBalanceSteps = 10;

RenderJob render_job(DatasetReader& dataset, const RenderQuery& query,
                     const v1::TrainingConfig& config) {
  RenderJob job;
  job.scene = dataset.scene(*query.item);
  v1::Material& material = *job.request.mutable_material();
  material.set_sigma_t(query.material.sigma_t);
  material.set_albedo(query.material.albedo);
  material.set_g(query.material.g);
  job.request.set_spp(config.spp());
  job.request.set_seed(query.seed);
  job.request.set_estimates(config.estimates());
  job.request.set_pilot_spp(config.pilot_spp());
  job.request.set_pixels(v1::OBJECT_PIXELS);
  for (const v1::Parameter parameter : {v1::SIGMA_T, v1::ALBEDO, v1::G}) {
    job.request.add_derivatives(parameter);
  }
  job.request.mutable_loss()->set_image(to_bytes(query.image));
  job.request.mutable_loss()->set_weight(to_bytes(query.weight));
  return job;
}

Triple row(const torch::Tensor& doubles, int64_t index) {
  const double* values = doubles[index].data_ptr<double>();
  return {values[0], values[1], values[2]};
}

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

Encoder initial_encoder(const v1::TrainingConfig& config, const v1::Model& start) {
  if (start.weights_size() > 0) {
    return load_encoder(start);
  }
  torch::manual_seed(derive_seed(config.seed(), {kInitialWeights}));
  return new_encoder(start);
}

torch::optim::AdamOptions adam_options(const v1::TrainingConfig& config) {
  return torch::optim::AdamOptions(config.learning_rate());
}

std::unique_ptr<torch::optim::Adam> new_optimizer(const Encoder& encoder,
                                                  const v1::TrainingConfig& config) {
  return std::make_unique<torch::optim::Adam>(encoder->parameters(), adam_options(config));
}

v1::Model named(v1::Model model, const v1::TrainingConfig& config) {
  model.set_name(fmt::format("{}-{}", config.loss() == v1::TrainingConfig::ITN ? "itn" : "rn",
                             config.parameterization() == v1::NAIVE ? "naive" : "similarity"));
  model.clear_weights();
  return model;
}

}  // namespace

RenderBatch render_with(DatasetReader& dataset, RenderPool& pool, const v1::TrainingConfig& config,
                        std::stop_token stop) {
  return [&dataset, &pool, config, stop](std::span<const RenderQuery> queries) {
    std::vector<std::future<v1::RenderGradReply>> replies;
    for (const RenderQuery& query : queries) {
      replies.push_back(pool.submit(render_job(dataset, query, config)));
    }
    std::vector<RenderingLoss> results;
    for (auto& future : replies) {
      const v1::RenderGradReply reply = wait_for_render(future, stop);
      results.push_back(
          {reply.loss(), {reply.loss_gradient(0), reply.loss_gradient(1), reply.loss_gradient(2)}});
    }
    return results;
  };
}

torch::Tensor stand_in(const torch::Tensor& outputs, const torch::Tensor& gradients) {
  return (outputs * gradients.detach()).sum(1).mean();
}

void validate(const v1::TrainingConfig& config) {
  const auto require = [](bool condition, const char* message) {
    if (!condition) {
      throw invalid_input(message);
    }
  };
  require(config.loss() == v1::TrainingConfig::RN || config.loss() == v1::TrainingConfig::ITN,
          "loss must be RN or ITN");
  require(config.parameterization() == v1::NAIVE || config.parameterization() == v1::SIMILARITY,
          "parameterization must be NAIVE or SIMILARITY");
  require(config.steps() >= 1 && config.steps() <= UINT32_MAX, "steps must be in [1, 2^32)");
  require(config.batch() >= 1, "batch must be 1 at least");
  require(config.architecture().kind_case() != v1::Architecture::KIND_NOT_SET,
          "an architecture is needed");
  require(config.output() == v1::POINT, "output must be POINT");
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

Trainer::Trainer(v1::TrainingConfig config, const LabelledImages& images, v1::Model start,
                 RenderBatch render)
    : images_(images),
      render_(std::move(render)),
      model_(named(start, config)),
      space_(model_),
      inputs_(encoder_inputs(images, model_.image_scale())),
      targets_(standardized_targets(space_, images)),
      encoder_(initial_encoder(config, start)),
      optimizer_(new_optimizer(encoder_, config)),
      sampler_(static_cast<uint32_t>(images.items.size()), derive_seed(config.seed(), {kOrder})) {
  validate(config);
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
  model_ = checkpoint.model();
  model_.clear_weights();
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

// Eqs. 2 and 3. The image term enters through a stand-in with the same gradient: outputs .
// gradient, where the gradient was computed by the renderer and is a constant to torch.
v1::TrainingMetrics Trainer::step() {
  const v1::TrainingConfig& config = state_.config();
  // Take the batch of this step.
  const std::vector<uint32_t> batch = sampler_.batch(state_.step(), config.batch());
  const torch::Tensor index = torch::tensor(std::vector<int64_t>(batch.begin(), batch.end()));
  const torch::Tensor targets = targets_.index_select(0, index);
  // Predict.
  const torch::Tensor outputs = encoder_->forward(inputs_.index_select(0, index));
  // Regression term: mean over the batch of the squared distance.
  const torch::Tensor regression = (outputs - targets).square().sum(1).mean();
  torch::Tensor loss = regression;
  // Image term.
  v1::TrainingMetrics metrics;
  if (config.loss() == v1::TrainingConfig::ITN) {
    const ImageTerm term = image_term(batch, outputs.detach(), targets);
    loss = loss + term.lambda * stand_in(outputs, term.gradient);
    metrics.set_image_loss(term.loss);
    metrics.set_lambda(term.lambda);
  }
  // Descend.
  optimizer_->zero_grad();
  loss.backward();
  optimizer_->step();
  state_.set_step(state_.step() + 1);
  metrics.set_step(static_cast<uint32_t>(state_.step()));
  metrics.set_epoch(static_cast<double>(state_.step()) * config.batch() /
                    static_cast<double>(images_.items.size()));
  metrics.set_regression_loss(regression.item<double>());
  return metrics;
}

Trainer::ImageTerm Trainer::image_term(std::span<const uint32_t> batch,
                                       const torch::Tensor& outputs, const torch::Tensor& targets) {
  // Render every prediction, and compare it with its input.
  const torch::Tensor predictions = outputs.to(torch::kFloat64);
  std::vector<RenderQuery> queries;
  for (size_t i = 0; i < batch.size(); ++i) {
    const std::vector<float>& image = images_.radiance[batch[i]];
    queries.push_back({images_.items[batch[i]],
                       space_.material(row(predictions, static_cast<int64_t>(i))),
                       image,
                       {inputs_[batch[i]][1].data_ptr<float>(), image.size()},
                       derive_seed(state_.config().seed(), {kRenders, state_.step(), i})});
  }
  const std::vector<RenderingLoss> losses = render_(queries);
  // Carry the gradients back to the outputs.
  ImageTerm term;
  term.gradient = torch::empty({static_cast<int64_t>(batch.size()), 3});
  auto gradient = term.gradient.accessor<float, 2>();
  for (size_t i = 0; i < batch.size(); ++i) {
    const auto r = static_cast<int64_t>(i);
    const std::vector<double>& g = losses[i].gradient;  // by sigma_t, albedo and g
    const Triple by_output =
        space_.output_gradient(row(predictions, r), {g.at(0), g.at(1), g.at(2)});
    for (size_t k = 0; k < 3; ++k) {
      gradient[r][static_cast<int64_t>(k)] = static_cast<float>(by_output[k]);
    }
    term.loss += losses[i].value / static_cast<double>(batch.size());
  }
  term.lambda = state_.config().has_lambda() ? state_.config().lambda()
                                             : balance(2 * (outputs - targets), term.gradient);
  return term;
}

// lambda = sum of |d regression / d output| over sum of |d image / d output|, each the mean over
// the batch, summed over the first steps: from then on fixed. Both terms then pull about equally
// hard.
double Trainer::balance(const torch::Tensor& regression_gradient,
                        const torch::Tensor& image_gradient) {
  if (state_.balance_steps() < kBalanceSteps) {
    state_.set_balance_steps(state_.balance_steps() + 1);
    state_.set_regression_gradient(state_.regression_gradient() + mean_norm(regression_gradient));
    state_.set_image_gradient(state_.image_gradient() + mean_norm(image_gradient));
  }
  return state_.image_gradient() > 0 ? state_.regression_gradient() / state_.image_gradient() : 0;
}

// --- A run in a folder ---

namespace {

constexpr const char* kMetricsName = "metrics.jsonl";

void require_same_config(const v1::TrainingConfig& there, v1::TrainingConfig wanted,
                         const fs::path& folder) {
  wanted.set_steps(there.steps());
  std::string text;
  google::protobuf::util::MessageDifferencer differencer;
  differencer.ReportDifferencesToString(&text);
  if (!differencer.Compare(there, wanted)) {
    throw invalid_input(fmt::format(
        "the run in {} has another configuration; it can be continued with its own only, but for "
        "more steps. Differences:\n{}",
        folder.string(), text));
  }
}

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

// Continues from the folder's checkpoint if there is one; begins a new run if there is none.
void begin_or_restore(Trainer& trainer, const v1::TrainingConfig& config, const TrainingRun& run) {
  const fs::path path = run.folder / kCheckpointName;
  if (fs::exists(path)) {
    const v1::Checkpoint checkpoint = read_checkpoint(run.folder);
    if (!run.resume) {
      throw invalid_input(
          fmt::format("{} holds a run at step {}; --resume continues it, or choose another folder",
                      run.folder.string(), checkpoint.training().step()));
    }
    require_same_config(checkpoint.training().config(), config, run.folder);
    trainer.restore(checkpoint);
  }
  std::error_code error;
  fs::create_directories(run.folder, error);
  if (error) {
    throw Error(ErrorKind::kIo,
                fmt::format("cannot create {}: {}", run.folder.string(), error.message()));
  }
  truncate_metrics(run.folder / kMetricsName, trainer.steps_taken());
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

}  // namespace

void train(const v1::TrainingConfig& config, const LabelledImages& images, const v1::Model& start,
           const RenderBatch& render, const TrainingRun& run) {
  const fs::path metrics_path = run.folder / kMetricsName;
  Trainer trainer(config, images, start, render);
  begin_or_restore(trainer, config, run);
  std::ofstream metrics_file(metrics_path, std::ios::app);
  try {
    while (trainer.steps_taken() < config.steps()) {
      if (run.stop.stop_requested()) {
        throw Error(ErrorKind::kCancelled, "interrupted");
      }
      const v1::TrainingMetrics metrics = timed_step(trainer);
      append_line(metrics_file, to_json(metrics), metrics_path);
      if (trainer.steps_taken() % run.checkpoint_every == 0) {
        write_latest_checkpoint(run.folder, trainer.checkpoint());
      }
      if (run.report) {
        run.report(metrics);
      }
    }
  } catch (const Error& error) {
    // Whatever stopped it, what was learned is kept; where that is nothing, the folder stays free.
    if (trainer.steps_taken() == 0) {
      throw;
    }
    write_latest_checkpoint(run.folder, trainer.checkpoint());
    throw Error(error.kind(), fmt::format("{}; stopped after step {}, --resume continues",
                                          error.what(), trainer.steps_taken()));
  }
  write_latest_checkpoint(run.folder, trainer.checkpoint());
}

}  // namespace itn
