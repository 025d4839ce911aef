#include "client/experiment/network_stage.h"

#include <chrono>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "client/dataset/dataset_config.h"
#include "client/files/folder_lock.h"
#include "client/scene/text_proto.h"
#include "client/training/dataset_training.h"
#include "client/training/evaluation.h"
#include "client/training/metrics_log.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "common/learning/checkpoint.h"
#include "common/learning/model_files.h"
#include "common/learning/predictor.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr const char* kCostName = "cost.textproto";

// What the steps of a run cost: those of this call by its clocks, those of calls before as much
// each.
class StepClock {
 public:
  explicit StepClock(std::function<double()> cpu_seconds) : cpu_seconds_(std::move(cpu_seconds)) {}

  void begin() {
    cpu_ = cpu_seconds_();
    start_ = std::chrono::steady_clock::now();
  }
  void step() {
    ++steps_;
    cpu_at_step_ = cpu_seconds_();
    at_step_ = std::chrono::steady_clock::now();
  }
  bool has_steps() const { return steps_ > 0; }

  v1::NetworkCost cost(uint64_t steps) const {
    const double scale = static_cast<double>(steps) / static_cast<double>(steps_);
    v1::NetworkCost cost;
    cost.set_steps(steps);
    cost.set_cpu_seconds(scale * (cpu_at_step_ - cpu_));
    cost.set_seconds(scale * std::chrono::duration<double>(at_step_ - start_).count());
    return cost;
  }

 private:
  std::function<double()> cpu_seconds_;
  uint64_t steps_ = 0;
  double cpu_ = 0, cpu_at_step_ = 0;
  std::chrono::steady_clock::time_point start_, at_step_;
};

// Rounds to five digits, which is far below every error and keeps files small.
float five_digits(double value) {
  return std::stof(fmt::format("{:.5g}", value));
}

v1::ExperimentPredictions::Estimates estimates_of(Predictor& predictor, DatasetReader& dataset,
                                                  std::stop_token stop) {
  v1::ExperimentPredictions::Estimates result;
  for (const MaterialEstimate& estimate :
       estimate_all(predictor, images_of(dataset, v1::SPLIT_TEST), {}, stop)) {
    result.add_sigma_t(five_digits(estimate.material.sigma_t));
    result.add_albedo(five_digits(estimate.material.albedo));
    result.add_g(five_digits(estimate.material.g));
    if (!estimate.posterior) continue;
    const auto& parameters = estimate.posterior->material.parameters;
    result.add_sigma_t_low(five_digits(parameters[0].low));
    result.add_sigma_t_high(five_digits(parameters[0].high));
    result.add_albedo_low(five_digits(parameters[1].low));
    result.add_albedo_high(five_digits(parameters[1].high));
    result.add_g_low(five_digits(parameters[2].low));
    result.add_g_high(five_digits(parameters[2].high));
  }
  return result;
}

}  // namespace

v1::NetworkCost train_network(v1::TrainingConfig config, DatasetReader& dataset,
                              const NetworkRun& run) {
  const std::optional<v1::Model> init =
      run.init ? std::optional(read_checkpoint(*run.init / kBestCheckpointName).model())
               : std::nullopt;
  config.set_dataset_sha256(to_hex(sha256(to_text(dataset.manifest()))));
  config.set_init_sha256(init ? weights_sha256(*init) : "");
  const FolderLock lock(run.folder, "itn experiment");
  std::optional<v1::Checkpoint> existing = find_checkpoint(run.folder);
  if (existing && existing->training().config().init_sha256() != config.init_sha256()) {
    // It went on from other weights, which are gone.
    for (const char* file : {kCheckpointName, kBestCheckpointName, kMetricsName, kCostName}) {
      fs::remove(run.folder / file);
    }
    existing.reset();
  }
  // The last bits depend on it: a run keeps the number that it began with.
  config.set_torch_threads(existing ? existing->training().config().torch_threads()
                                    : run.torch_threads);
  StepClock clock(run.cpu_seconds);
  TrainingRun training;
  training.folder = run.folder;
  training.checkpoint_every = run.validate_every;
  training.model_name = existing ? "" : run.model_name;
  training.validate_every = run.validate_every;
  training.report = [&](const v1::TrainingMetrics& metrics) {
    clock.step();
    run.report(metrics);
  };
  training.stop = run.stop;
  DatasetTraining dataset_training(config, dataset, existing ? existing->model() : init,
                                   std::move(training));
  clock.begin();
  dataset_training.train(run.pool);
  // Killed between its last step and its end, it has told already.
  if (!clock.has_steps() && fs::exists(run.folder / kCostName)) return read_cost(run.folder);
  v1::NetworkCost cost = clock.has_steps() ? clock.cost(config.steps()) : v1::NetworkCost();
  cost.set_kept_step(read_checkpoint(run.folder).training().best_step());
  write_file_atomically(run.folder / kCostName, to_text_proto(cost));
  return cost;
}

Workload training_workload(const fs::path& folder, const std::string& unit, uint64_t steps) {
  Workload workload{.unit = unit, .pieces = static_cast<double>(steps)};
  for (const v1::TrainingMetrics& step : read_metrics(folder / kMetricsName)) {
    ++workload.done;
    workload.seconds += step.seconds();
  }
  return workload;
}

v1::NetworkCost read_cost(const fs::path& folder) {
  const fs::path path = folder / kCostName;
  v1::NetworkCost cost;
  parse_text_proto(read_file(path, "cost of a network"), path.string(), cost);
  return cost;
}

std::optional<v1::NetworkCost> find_cost(const fs::path& folder) {
  return fs::exists(folder / kCostName) ? std::optional(read_cost(folder)) : std::nullopt;
}

double best_score(const fs::path& folder) {
  return read_checkpoint(folder).training().best_score();
}

v1::ExperimentPredictions predict_test(const fs::path& folder, DatasetReader& dataset,
                                       DatasetReader* other_noise, DatasetReader& colours,
                                       std::stop_token stop) {
  Predictor predictor = Predictor::load(folder / kBestCheckpointName);
  v1::ExperimentPredictions predictions;
  *predictions.mutable_as_trained() = estimates_of(predictor, dataset, stop);
  if (other_noise != nullptr) {
    *predictions.mutable_other_noise() = estimates_of(predictor, *other_noise, stop);
  }
  *predictions.mutable_colours() = estimates_of(predictor, colours, stop);
  return predictions;
}

}  // namespace itn
