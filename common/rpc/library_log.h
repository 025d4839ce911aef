#pragma once

namespace itn {

// What gRPC and protobuf themselves log goes to our log, as debug messages. To be called at start.
void log_libraries_through_spdlog();

}  // namespace itn
