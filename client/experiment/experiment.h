// An experiment in its folder: dataset, networks, tables, report.
//
//   experiment.textproto   what it is, with all defaults
//   data/, other_noise/, colours/   datasets (itn dataset)
//   rates/, shared/, networks/   runs (itn train)
//   answers/, image_errors/, refinements/   what the networks say of the test
//   references/, images/   renders of the truth and of what networks say
//   stages/                what is done
//   table_1.csv, ..., report.md, report/
//
// Of answers, image_errors, refinements and experiment.textproto the tables are made; datasets,
// runs and images are made again only for stages that are not done.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "client/experiment/stages.h"
#include "client/experiment/tables.h"
#include "client/render_pool/render_pool.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

struct ExperimentRun {
  std::filesystem::path folder;
  RenderPoolOptions pool;
  uint32_t torch_threads = 1;
  // Within a stage: what is done of what; `unit` is empty while it is not known.
  std::function<void(const std::string& stage, const std::string& unit, uint64_t done,
                     uint64_t total, const std::string& note)>
      progress;
  StageReport report;
  std::stop_token stop;
};

// Names of all stages, in order.
std::vector<std::string> stage_names(const v1::Experiment& experiment);

// Says how far each stage is, in order. `folder` need not exist. Throws Error (invalid input) if
// something else than the experiment is there.
std::vector<StageStatus> stage_status(const v1::Experiment& experiment,
                                      const std::filesystem::path& folder);

struct ExperimentResult {
  std::vector<Table> tables;
  std::filesystem::path report;  // Markdown; empty: the datasets are gone
};

// Writes the tables of the networks that have answered in the folder of an experiment. Renders
// nothing. Throws Error (kIo, kInvalidInput).
std::vector<Table> write_experiment_tables(const std::filesystem::path& folder);

// Does what is not done yet. Throws Error: kInvalidInput if the folder holds another experiment
// (says what differs), or other files; kCancelled soon after a stop is requested, and can be called
// again then; what datasets, training and rendering throw.
ExperimentResult run_experiment(const v1::Experiment& experiment, const ExperimentRun& run);

}  // namespace itn
