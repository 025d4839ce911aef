// Training the networks of an experiment, and asking them about its test.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>

#include "client/dataset/dataset.h"
#include "client/experiment/stages.h"
#include "client/render/job_renderer.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

struct NetworkRun {
  std::filesystem::path folder;
  std::optional<std::filesystem::path> init;  // the run that it goes on from
  std::string model_name;
  uint64_t validate_every = 500;
  uint32_t torch_threads = 1;
  std::function<JobRenderer&()> pool;  // called if the image term is rendered
  std::function<double()> cpu_seconds;
  std::function<void(const v1::TrainingMetrics&)> report;
  std::stop_token stop;
};

// Trains a network on the dataset's training split to its last step, going on where it was stopped;
// what its steps cost is in its folder then (cost.textproto), and the model that was best on the
// validation split (best.itn). Returns the cost. Throws as train().
v1::NetworkCost train_network(v1::TrainingConfig config, DatasetReader& dataset,
                              const NetworkRun& run);

// What a run of so many steps has taken of them.
Workload training_workload(const std::filesystem::path& folder, const std::string& unit,
                           uint64_t steps);

// The cost of a network that has been trained.
v1::NetworkCost read_cost(const std::filesystem::path& folder);
// Likewise; none if the file is gone.
std::optional<v1::NetworkCost> find_cost(const std::filesystem::path& folder);

// The mean of the best validation errors of a run (score()).
double best_score(const std::filesystem::path& folder);

// What the run's best model says of each image of the tests. `other_noise`: null if there is none.
v1::ExperimentPredictions predict_test(const std::filesystem::path& folder, DatasetReader& dataset,
                                       DatasetReader* other_noise, DatasetReader& colours,
                                       std::stop_token stop);

}  // namespace itn
