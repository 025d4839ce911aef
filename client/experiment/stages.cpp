#include "client/experiment/stages.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <numeric>
#include <optional>
#include <set>

#include <fmt/format.h>

#include "client/experiment/experiment_config.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

fs::path record_path(const fs::path& folder, const Stage& stage) {
  return folder / "stages" / (file_name_of(stage.name) + ".textproto");
}

std::optional<v1::StageRecord> record_of(const fs::path& folder, const Stage& stage) {
  const fs::path path = record_path(folder, stage);
  if (!fs::exists(path)) return std::nullopt;
  v1::StageRecord record;
  parse_text_proto(read_file(path, "stage"), path.string(), record);
  return record;
}

// The digest of what a stage takes. `outputs`: digests of what is made, by the name of the stage.
std::string digest_of_inputs(const Stage& stage, const std::string& inputs,
                             const std::map<std::string, std::string>& outputs) {
  std::string all = inputs + '\n' + stage.name;
  for (const std::string& name : stage.after) all += '\n' + outputs.at(name);
  return to_hex(sha256(all));
}

// What is known of a stage before it runs.
struct StagePlan {
  std::string inputs;                     // digest; empty while what it takes is to be made
  std::optional<v1::StageRecord> record;  // absent: it was not made of these inputs
  bool is_wanted = false;
};

// A stage is wanted if it was not made of these inputs, or if its output is gone and either is a
// result or is taken by a stage that is wanted.
std::vector<StagePlan> plan_stages(std::span<const Stage> stages, const fs::path& folder,
                                   const std::string& inputs) {
  std::vector<StagePlan> plans(stages.size());
  std::map<std::string, std::string> outputs;  // digests, by the name of the stage
  for (size_t i = 0; i < stages.size(); ++i) {
    const Stage& stage = stages[i];
    const auto is_known = [&](const std::string& name) { return outputs.contains(name); };
    if (!std::ranges::all_of(stage.after, is_known)) continue;
    plans[i].inputs = digest_of_inputs(stage, inputs, outputs);
    std::optional<v1::StageRecord> record = record_of(folder, stage);
    if (!record || record->inputs_sha256() != plans[i].inputs) continue;
    outputs[stage.name] = record->outputs_sha256();
    plans[i].record = std::move(record);
  }
  std::set<std::string> taken;  // by stages that are wanted
  for (size_t i = stages.size(); i-- > 0;) {
    const Stage& stage = stages[i];
    if (!plans[i].record) {
      plans[i].is_wanted = true;
    } else if (plans[i].record->being_made() || !fs::exists(stage.output)) {
      plans[i].is_wanted = stage.is_result || taken.contains(stage.name);
    }
    if (plans[i].is_wanted) taken.insert(stage.after.begin(), stage.after.end());
  }
  return plans;
}

}  // namespace

void run_stages(std::span<const Stage> stages, const fs::path& folder, const std::string& inputs,
                const std::function<double()>& cpu_seconds, const StageReport& report,
                const std::stop_token& stop) {
  fs::create_directories(folder / "stages");
  for (size_t reported = 0;;) {
    // Anew after each stage: what it made may be other than what was there.
    const std::vector<StagePlan> plans = plan_stages(stages, folder, inputs);
    const auto wanted = std::ranges::find(plans, true, &StagePlan::is_wanted);
    const auto number = static_cast<size_t>(wanted - plans.begin());
    for (; reported < number; ++reported) {
      report(reported, stages[reported], StageState::kDone, *plans[reported].record);
    }
    if (wanted == plans.end()) return;
    reported = std::max(reported, number + 1);
    if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
    const Stage& stage = stages[number];
    report(number, stage, StageState::kBegins, {});
    if (wanted->record) {
      v1::StageRecord begun = *wanted->record;
      begun.set_being_made(true);
      write_file_atomically(record_path(folder, stage), to_text_proto(begun));
    }
    const auto start = std::chrono::steady_clock::now();
    const double cpu = cpu_seconds();
    v1::StageRecord record;
    record.set_name(stage.name);
    record.set_inputs_sha256(wanted->inputs);
    record.set_outputs_sha256(to_hex(sha256(stage.work())));
    record.set_seconds(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    record.set_cpu_seconds(cpu_seconds() - cpu);
    if (!fs::exists(stage.output)) {
      throw Error(ErrorKind::kInternal,
                  fmt::format("{} has not made {}", stage.name, stage.output.string()));
    }
    write_file_atomically(record_path(folder, stage), to_text_proto(record));
    report(number, stage, StageState::kEnds, record);
  }
}

std::vector<StageStatus> stage_status(std::span<const Stage> stages, const fs::path& folder,
                                      const std::string& inputs) {
  std::vector<StageStatus> all;
  std::map<std::string, double> pieces, seconds;  // that are done, by unit
  const std::vector<StagePlan> plans = plan_stages(stages, folder, inputs);
  for (size_t i = 0; i < stages.size(); ++i) {
    StageStatus& status = all.emplace_back();
    status.name = stages[i].name;
    status.is_done = !plans[i].is_wanted;
    if (stages[i].workload) status.workload = stages[i].workload();
    Workload& workload = status.workload;
    if (status.is_done && workload.done == 0) {
      workload.done = workload.pieces;
      workload.seconds = plans[i].record->seconds();
    }
    pieces[workload.unit] += workload.done;
    seconds[workload.unit] += workload.seconds;
  }
  for (StageStatus& status : all) {
    const Workload& workload = status.workload;
    if (status.is_done) {
      status.seconds_left = 0;
    } else if (seconds[workload.unit] > 0) {
      status.seconds_left = std::max(0.0, workload.pieces - workload.done) *
                            seconds[workload.unit] / pieces[workload.unit];
    }
  }
  return all;
}

FilesMade files_made(std::span<const fs::path> files) {
  std::vector<fs::file_time_type> times;
  for (const fs::path& file : files) {
    if (fs::exists(file)) times.push_back(fs::last_write_time(file));
  }
  if (times.size() < 2) return {times.size(), 0};
  std::ranges::sort(times);
  std::vector<double> gaps;
  for (size_t i = 1; i < times.size(); ++i) {
    gaps.push_back(std::chrono::duration<double>(times[i] - times[i - 1]).count());
  }
  // A pause is much longer than what most files took.
  constexpr double kPause = 30;
  std::ranges::sort(gaps);
  const double longest = kPause * std::max(1.0, gaps[gaps.size() / 2]);
  const auto end = std::ranges::upper_bound(gaps, longest);
  const double sum = std::accumulate(gaps.begin(), end, 0.0);
  return {times.size(),
          sum * static_cast<double>(times.size()) / static_cast<double>(end - gaps.begin())};
}

std::vector<v1::StageRecord> stage_records(std::span<const Stage> stages, const fs::path& folder) {
  std::vector<v1::StageRecord> records;
  for (const Stage& stage : stages) {
    if (std::optional<v1::StageRecord> record = record_of(folder, stage)) {
      records.push_back(std::move(*record));
    }
  }
  return records;
}

}  // namespace itn
