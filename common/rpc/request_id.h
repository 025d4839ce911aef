// What a call is called in the logs of both sides.
#pragma once

#include <grpcpp/client_context.h>
#include <grpcpp/server_context.h>

#include <string>

namespace itn {

// Gives the call a name of its own, 16 hexadecimal digits, which travels with it as the metadata
// "x-request-id"; returns it.
std::string name_request(grpc::ClientContext& context);

// What the client calls it, made fit to be shown; "-" if it has no name.
std::string request_name(const grpc::CallbackServerContext& context);

}  // namespace itn
