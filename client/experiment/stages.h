// Work in stages that a folder remembers: what is done is not done again, whatever stopped it.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "itn/v1/experiment.pb.h"

namespace itn {

// How much a stage is, and what of it is there.
struct Workload {
  std::string unit;  // what is counted; a piece takes about as long in all stages of this unit
  double pieces = 0;
  double done = 0;     // of these; 0 if the stage makes all at once
  double seconds = 0;  // by the clock, that those took
};

struct Stage {
  std::string name;
  std::vector<std::string> after;  // names of stages before it, whose outputs it takes
  std::filesystem::path output;    // what it makes
  // Makes it, going on where a call before was stopped; returns what tells its outputs from others,
  // e.g. a digest.
  std::function<std::string()> work;
  std::function<Workload()> workload = {};  // optional
  // Its output is wanted for itself; otherwise for the stages that take it, and it may be gone when
  // these are done.
  bool is_result = false;
};

enum class StageState { kDone, kBegins, kEnds };

// Called for each stage in turn. `record`: of a stage that is done or has ended.
using StageReport = std::function<void(size_t number, const Stage& stage, StageState state,
                                       const v1::StageRecord& record)>;

// Runs the stages whose record in `folder`/stages is not there, or is of other inputs, and those
// whose output is gone and wanted. `inputs`: what all of them depend on. `cpu_seconds`: of all work
// so far, in this process and elsewhere. Throws what a stage throws, and Error (cancelled) soon
// after a stop is requested.
void run_stages(std::span<const Stage> stages, const std::filesystem::path& folder,
                const std::string& inputs, const std::function<double()>& cpu_seconds,
                const StageReport& report, const std::stop_token& stop);

struct StageStatus {
  std::string name;
  bool is_done = false;  // run_stages() would leave it, as far as is known
  Workload workload;
  std::optional<double> seconds_left;  // absent: no piece of its unit has been done yet
};

// Says how far each stage is, in order. The folder need not exist.
std::vector<StageStatus> stage_status(std::span<const Stage> stages,
                                      const std::filesystem::path& folder,
                                      const std::string& inputs);

struct FilesMade {
  size_t count = 0;
  double seconds = 0;  // without the pauses between calls
};
// Counts those of the files that are there, which are made one after another.
FilesMade files_made(std::span<const std::filesystem::path> files);

// The records of stages that are done, whatever their inputs are, in order.
std::vector<v1::StageRecord> stage_records(std::span<const Stage> stages,
                                           const std::filesystem::path& folder);

}  // namespace itn
