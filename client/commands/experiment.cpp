// itn experiment: the networks and tables of Che et al. 2020, by one command.
#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <string>
#include <thread>

#include "client/commands/experiment.h"
#include "client/presets/presets.h"

#include "client/experiment/experiment.h"
#include "client/experiment/experiment_config.h"
#include "client/interrupt.h"
#include "client/output.h"
#include "client/progress.h"
#include "common/error.h"
#include "common/files/atomic_file.h"

namespace itn {
namespace {

v1::Experiment experiment_of(const ExperimentOptions& options) {
  if (options.file.empty() && options.preset.empty()) {
    throw Error(ErrorKind::kUsage, "which experiment? itn experiment FILE -o FOLDER, or --preset");
  }
  return options.preset.empty() ? load_experiment(options.file)
                                : experiment_of_preset(options.preset);
}

constexpr double kSecondsAnHour = 3600;

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

// What there is to do, what is done, and how long the rest takes on a machine like this one.
void print_status(const v1::Experiment& experiment, const ExperimentOptions& options) {
  if (options.folder.empty()) {
    for (const std::string& stage : stage_names(experiment)) print_result("{}\n", stage);
    return;
  }
  double left = 0;
  size_t untold = 0;  // stages of which nobody knows how long they take
  for (const StageStatus& stage : stage_status(experiment, options.folder)) {
    const Workload& workload = stage.workload;
    const double part = workload.pieces > 0 ? std::min(1.0, workload.done / workload.pieces) : 0;
    if (stage.is_done) {
      print_result("{}: done, {:.2f} h\n", stage.name, workload.seconds / kSecondsAnHour);
    } else if (stage.seconds_left) {
      print_result("{}: {:.0f} %, {:.2f} h left\n", stage.name, 100 * part,
                   *stage.seconds_left / kSecondsAnHour);
    } else {
      print_result("{}\n", stage.name);
    }
    left += stage.seconds_left.value_or(0);
    untold += stage.seconds_left ? 0 : 1;
  }
  print_result(
      "{:.1f} h left{}\n", left / kSecondsAnHour,
      untold == 0 ? "" : fmt::format(", and {} stages that are like none before them", untold));
}

void print_tables(const std::vector<Table>& tables) {
  for (const Table& table : tables) {
    print_result("{}\n{}{}\n\n", table.title, to_text(table), table.caption);
  }
}

}  // namespace

void run_experiment(const ExperimentOptions& options) {
  if (options.print_config && !options.preset.empty()) {
    print_result("{}", find_preset(experiment_presets(), options.preset).file);
    return;
  }
  if (options.tables) {
    if (options.folder.empty()) {
      throw Error(ErrorKind::kUsage, "tables of which folder? itn experiment --tables -o FOLDER");
    }
    return print_tables(write_experiment_tables(options.folder));
  }
  const v1::Experiment experiment = experiment_of(options);
  if (options.status) return print_status(experiment, options);
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
  print_tables(result.tables);
  if (result.report.empty()) {
    print_result(
        "The intervals are in CSV files in {}. The images are gone, so there is no report.\n",
        options.folder);
  } else {
    print_result("The intervals are in the report, and in CSV files beside it:\n{}\n",
                 result.report.string());
  }
}

}  // namespace itn
