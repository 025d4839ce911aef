// itn models: the trained models that come with itn.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "client/commands/command.h"
#include "client/output.h"
#include "common/error.h"
#include "common/learning/model_files.h"

namespace itn {
namespace {

void run() {
  const std::vector<ShippedModel> models = shipped_models();
  if (models.empty()) {
    throw Error(ErrorKind::kIo,
                fmt::format("there is no model in {} (ITN_MODELS says where else to look)",
                            models_folder().string()));
  }
  size_t width = 0;
  for (const ShippedModel& model : models) width = std::max(width, model.name.size());
  for (const ShippedModel& model : models) {
    print_result("{:{}}  {:>7.1f} MB  {}{}\n", model.name, width,
                 static_cast<double>(std::filesystem::file_size(model.file)) / 1e6,
                 model.title.empty() ? "(no card)" : model.title,
                 model.name == kDefaultModel ? " (default)" : "");
  }
}

}  // namespace

void add_models_command(CLI::App& app) {
  CLI::App* command = app.add_subcommand(
      "models", "Trained models that come with itn, each with the first line of its card");
  command->callback([] { run(); });
}

}  // namespace itn
