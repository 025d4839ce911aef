// Work in stages that a folder remembers: what is done is not done again, whatever stopped it.
#pragma once

#include <filesystem>
#include <functional>
#include <set>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "itn/v1/experiment.pb.h"

namespace itn {

struct Stage {
  std::string name;
  std::vector<std::string> after;  // names of stages before it, whose outputs it takes
  std::filesystem::path output;    // what it makes: not done without
  // Makes it, going on where a call before was stopped; returns what tells its outputs from others,
  // e.g. a digest.
  std::function<std::string()> work;
};

enum class StageState { kDone, kBegins, kEnds };

// Called for each stage in turn. `record`: of a stage that is done or has ended.
using StageReport = std::function<void(size_t number, const Stage& stage, StageState state,
                                       const v1::StageRecord& record)>;

// Runs the stages whose record in `folder`/stages is not there, or is of other inputs. `inputs`:
// what all of them depend on. `cpu_seconds`: of all work so far, in this process and elsewhere.
// Throws what a stage throws, and Error (cancelled) soon after a stop is requested.
void run_stages(std::span<const Stage> stages, const std::filesystem::path& folder,
                const std::string& inputs, const std::function<double()>& cpu_seconds,
                const StageReport& report, const std::stop_token& stop);

// Names of those that run_stages() would leave as they are; none that come after one that is still
// to be made, as what it will make is not known. The folder need not exist.
std::set<std::string> done_stages(std::span<const Stage> stages,
                                  const std::filesystem::path& folder, const std::string& inputs);

// The records of stages that are done, whatever their inputs are, in order.
std::vector<v1::StageRecord> stage_records(std::span<const Stage> stages,
                                           const std::filesystem::path& folder);

}  // namespace itn
