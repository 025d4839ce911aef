// itn experiment: its flags.
#include <fmt/format.h>

#include <memory>
#include <string>

#include "client/commands/command.h"
#include "client/commands/experiment.h"
#include "client/commands/options.h"
#include "client/presets/presets.h"
#include "common/flags.h"

namespace itn {
void add_experiment_command(CLI::App& app) {
  const auto options = std::make_shared<ExperimentOptions>();
  CLI::App* command = app.add_subcommand(
      "experiment", "The networks and tables of Che et al. 2020; the same command continues");
  CLI::Option* file = command->add_option(
      "file", options->file, "Experiment file (protobuf text format of itn.v1.Experiment)");
  CLI::Option* preset = command
                            ->add_option("--preset", options->preset,
                                         "Instead: " + description_of(experiment_presets()))
                            ->excludes(file);
  command->add_option("-o,--output", options->folder,
                      "Folder of the experiment; required to run it");
  command->add_flag("--print-config", options->print_config, "Print the preset's file, and end");
  CLI::Option* status = command->add_flag(
      "--status,--dry-run", options->status,
      "Print the stages, with -o what is done of them there and how many hours are left, and end");
  command
      ->add_flag(
          "--tables", options->tables,
          "Print and write the tables of the results that are in -o, render nothing, and end")
      ->excludes(file)
      ->excludes(preset)
      ->excludes(status);
  command
      ->add_option("--network-threads,--torch-threads", options->torch_threads,
                   "Threads of the networks; 0: one per processor")
      ->check(number_in(0, 4096))
      ->capture_default_str();
  add_worker_flags(*command, options->workers);
  command->callback([options] { run_experiment(*options); });
}

}  // namespace itn
