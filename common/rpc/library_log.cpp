#include "common/rpc/library_log.h"

#include <google/protobuf/stubs/logging.h>
#include <grpc/support/log.h>
#include <spdlog/spdlog.h>

#include <string>

#include "common/printable.h"

namespace itn {
namespace {

void log_grpc(gpr_log_func_args* args) {
  spdlog::debug("gRPC: {} ({}:{})", args->message, args->file, args->line);
}

}  // namespace

void log_libraries_through_spdlog() {
  gpr_set_log_function(log_grpc);
  google::protobuf::SetLogHandler(
      [](google::protobuf::LogLevel, const char* file, int line, const std::string& message) {
        spdlog::debug("protobuf: {} ({}:{})", printable(message, 500), file, line);
      });
}

}  // namespace itn
