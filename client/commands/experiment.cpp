// itn experiment: the networks and tables of Che et al. 2020, by one command.
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <thread>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/experiment/experiment.h"
#include "client/experiment/experiment_config.h"
#include "client/interrupt.h"
#include "client/output.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/flags.h"
#include "common/progress.h"

namespace itn {
namespace {

struct ExperimentOptions {
  std::string file, preset, folder;
  bool print_config = false;
  bool dry_run = false;
  int torch_threads = 0;
  WorkerFlags workers;
};

v1::Experiment experiment_of(const ExperimentOptions& options) {
  if (options.file.empty() && options.preset.empty()) {
    throw Error(ErrorKind::kUsage, "which experiment? itn experiment FILE -o FOLDER, or --preset");
  }
  return options.preset.empty() ? load_experiment(options.file)
                                : experiment_of_preset(options.preset);
}

// A bar for what is under way, a line for what is over.
class Teller {
 public:
  explicit Teller(size_t stages) : stages_(stages) {}

  void progress(const std::string& stage, const std::string& unit, uint64_t done, uint64_t total,
                const std::string& note) {
    if (unit.empty()) return;
    if (!bar_ || label_ != stage) {
      bar_.reset();
      label_ = stage;
      const uint64_t before = unit == "steps" ? done - 1 : done;
      bar_.emplace(fmt::format("[{}/{}] {}", number_, stages_, stage), unit, total, before);
    }
    bar_->update(done, note);
    if (done == total) bar_->finish();
  }

  void stage(size_t number, const Stage& stage, StageState state, const v1::StageRecord& record) {
    number_ = number + 1;
    if (state == StageState::kBegins) return;
    const bool was_shown = bar_.has_value();
    bar_.reset();
    label_.clear();
    if (was_shown) return;
    const std::string what =
        state == StageState::kDone ? "done before" : fmt::format("{:.1f} s", record.seconds());
    std::fprintf(
        stderr, "%s",
        for_terminal(fmt::format("[{}/{}] {}: {}\n", number_, stages_, stage.name, what)).c_str());
  }

 private:
  size_t stages_, number_ = 0;
  std::string label_;
  std::optional<Progress> bar_;
};

uint32_t torch_threads(const ExperimentOptions& options) {
  return options.torch_threads > 0 ? static_cast<uint32_t>(options.torch_threads)
                                   : std::max(1U, std::thread::hardware_concurrency());
}

// Which stages there are, and which are done.
void print_stages(const v1::Experiment& experiment, const ExperimentOptions& options) {
  std::set<std::string> done;
  if (!options.folder.empty()) done = done_stages(experiment, options.folder);
  for (const std::string& stage : stage_names(experiment)) {
    print_result("{}{}\n", stage, done.contains(stage) ? ": done" : "");
  }
}

void run(const ExperimentOptions& options) {
  if (options.print_config && !options.preset.empty()) {
    print_result("{}", find_experiment_preset(options.preset).file);
    return;
  }
  const v1::Experiment experiment = experiment_of(options);
  if (options.dry_run) return print_stages(experiment, options);
  if (options.folder.empty()) {
    throw Error(ErrorKind::kUsage, "where to? itn experiment FILE -o FOLDER");
  }
  check_folder_writable(options.folder);
  Teller teller(stage_names(experiment).size());
  const ExperimentResult result = run_experiment(
      experiment,
      {.folder = options.folder,
       .pool = options.workers.pool_options(),
       .torch_threads = torch_threads(options),
       .progress = [&](const auto& stage, const auto& unit, uint64_t done, uint64_t total,
                       const auto& note) { teller.progress(stage, unit, done, total, note); },
       .report = [&](size_t number, const Stage& stage, StageState state,
                     const v1::StageRecord& record) { teller.stage(number, stage, state, record); },
       .stop = interruption()});
  for (const Table& table : result.tables) {
    print_result("{}\n{}{}\n\n", table.title, to_text(table), table.caption);
  }
  print_result("The intervals are in the report, and in CSV files beside it:\n{}\n",
               result.report.string());
}

}  // namespace

void add_experiment_command(CLI::App& app) {
  const auto options = std::make_shared<ExperimentOptions>();
  CLI::App* command = add_learning_command(app, "experiment");
  CLI::Option* file = command->add_option(
      "file", options->file, "Experiment file (protobuf text format of itn.v1.Experiment)");
  std::string presets;
  for (const ExperimentPreset& preset : experiment_presets()) {
    presets +=
        fmt::format("{}{} ({})", presets.empty() ? "" : ", ", preset.name, preset.description);
  }
  command->add_option("--preset", options->preset, "Instead: " + presets)->excludes(file);
  command->add_option("-o,--output", options->folder,
                      "Folder of the experiment; required to run it");
  command->add_flag("--print-config", options->print_config, "Print the preset's file, and end");
  command->add_flag("--dry-run", options->dry_run,
                    "Print the stages, with -o which of them are done there, and end");
  command
      ->add_option("--network-threads,--torch-threads", options->torch_threads,
                   "Threads of the networks; 0: one per processor")
      ->check(number_in(0, 4096))
      ->capture_default_str();
  add_worker_flags(*command, options->workers);
  command->callback([options] { run(*options); });
}

}  // namespace itn
