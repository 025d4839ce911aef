// itn models: the trained models that come with itn, or those of a predictor.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/output.h"
#include "client/predict/predictor_error.h"
#include "client/rpc/channel.h"
#include "client/rpc/deadline.h"
#include "common/error.h"
#include "common/flags.h"
#include "common/learning/model_files.h"
#include "common/printable.h"
#include "itn/v1/predict.grpc.pb.h"

namespace itn {
namespace {

void list_shipped() {
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
                 model.name == kDefaultModel       ? " (default)"
                 : model.name == kDefaultGrayModel ? " (default for photographs of one channel)"
                 : model.name == kScaleModel ? " (default where the scale of radiance is known)"
                                             : "");
  }
}

struct ModelsOptions {
  std::string predictor;
  ClientSecurity security;
  double timeout = 10;  // in seconds
};

void list_served(const ModelsOptions& options) {
  const Connector connector(options.security);
  const auto stub = v1::PredictService::NewStub(connector.connect_to(options.predictor));
  grpc::ClientContext context;
  context.set_deadline(deadline_in(std::chrono::duration<double>(options.timeout)));
  v1::ListModelsReply reply;
  const grpc::Status status =
      connector.with_cause(stub->ListModels(&context, {}, &reply), options.predictor);
  if (!status.ok()) throw predictor_error(status, options.predictor);
  for (const v1::ListedModel& model : reply.models()) {
    print_result("{}  {}  step {}  weights {:.12}  {}{}\n", printable(model.name()),
                 model.version().empty() ? "(no version)" : printable(model.version()),
                 model.model().step(), printable(model.model().sha256()),
                 model.title().empty() ? "(no card)" : printable(model.title(), 200),
                 model.by_default() ? " (default)" : "");
  }
}

}  // namespace

void add_models_command(CLI::App& app) {
  const auto options = std::make_shared<ModelsOptions>();
  CLI::App* command = app.add_subcommand(
      "models", "Trained models that come with itn, each with the first line of its card");
  const auto predictor = command->add_option(
      "--predictor", options->predictor,
      "HOST:PORT of an itn-predictor: list those that it answers with instead, with version, "
      "training step and digest of the weights");
  add_security_flags(*command, options->security);
  command->add_option("--timeout", options->timeout, "Of the call, in seconds")
      ->check(number_in(0.01, 3600.0))
      ->needs(predictor)
      ->capture_default_str();
  command->callback(
      [options] { options->predictor.empty() ? list_shipped() : list_served(*options); });
}

}  // namespace itn
