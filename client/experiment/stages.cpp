#include "client/experiment/stages.h"

#include <algorithm>
#include <chrono>
#include <map>
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

std::set<std::string> done_stages(std::span<const Stage> stages, const fs::path& folder,
                                  const std::string& inputs) {
  std::set<std::string> done;
  std::map<std::string, std::string> outputs;
  for (const Stage& stage : stages) {
    const auto is_made = [&](const std::string& name) { return outputs.contains(name); };
    if (!std::ranges::all_of(stage.after, is_made)) continue;
    const std::string digest = digest_of_inputs(stage, inputs, outputs);
    if (const auto existing = record_if_done(folder, stage, digest)) {
      outputs[stage.name] = existing->outputs_sha256();
      done.insert(stage.name);
    }
  }
  return done;
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
