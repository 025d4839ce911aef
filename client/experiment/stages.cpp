#include "client/experiment/stages.h"

#include <algorithm>
#include <chrono>
#include <map>
#include <numeric>
#include <optional>

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

// If it was made of inputs with this digest, and is still there.
std::optional<v1::StageRecord> record_if_done(const fs::path& folder, const Stage& stage,
                                              const std::string& inputs_digest) {
  std::optional<v1::StageRecord> record = record_of(folder, stage);
  if (record && (record->inputs_sha256() != inputs_digest || !fs::exists(stage.output))) {
    record.reset();
  }
  return record;
}

}  // namespace

void run_stages(std::span<const Stage> stages, const fs::path& folder, const std::string& inputs,
                const std::function<double()>& cpu_seconds, const StageReport& report,
                const std::stop_token& stop) {
  fs::create_directories(folder / "stages");
  std::map<std::string, std::string> outputs;  // digests, by the name of the stage
  for (size_t number = 0; number < stages.size(); ++number) {
    const Stage& stage = stages[number];
    const std::string digest = digest_of_inputs(stage, inputs, outputs);
    if (const auto existing = record_if_done(folder, stage, digest)) {
      outputs[stage.name] = existing->outputs_sha256();
      report(number, stage, StageState::kDone, *existing);
      continue;
    }
    if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
    report(number, stage, StageState::kBegins, {});
    const auto start = std::chrono::steady_clock::now();
    const double cpu = cpu_seconds();
    v1::StageRecord record;
    record.set_name(stage.name);
    record.set_inputs_sha256(digest);
    record.set_outputs_sha256(to_hex(sha256(stage.work())));
    record.set_seconds(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    record.set_cpu_seconds(cpu_seconds() - cpu);
    write_file_atomically(record_path(folder, stage), to_text_proto(record));
    outputs[stage.name] = record.outputs_sha256();
    report(number, stage, StageState::kEnds, record);
  }
}

std::vector<StageStatus> stage_status(std::span<const Stage> stages, const fs::path& folder,
                                      const std::string& inputs) {
  std::vector<StageStatus> all;
  std::map<std::string, std::string> outputs;
  std::map<std::string, double> pieces, seconds;  // that are done, by unit
  for (const Stage& stage : stages) {
    StageStatus& status = all.emplace_back();
    status.name = stage.name;
    if (stage.workload) status.workload = stage.workload();
    Workload& workload = status.workload;
    const auto is_made = [&](const std::string& name) { return outputs.contains(name); };
    if (std::ranges::all_of(stage.after, is_made)) {
      const std::string digest = digest_of_inputs(stage, inputs, outputs);
      if (const auto existing = record_if_done(folder, stage, digest)) {
        outputs[stage.name] = existing->outputs_sha256();
        status.is_done = true;
        if (workload.done == 0) {
          workload.done = workload.pieces;
          workload.seconds = existing->seconds();
        }
      }
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
