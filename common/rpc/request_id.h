// What a call is called in the logs of both sides.
#pragma once

#include <grpcpp/support/status.h>

#include <string>

namespace grpc {
class CallbackServerContext;
class ClientContext;
}  // namespace grpc

namespace itn {

// Gives the call a name of its own, 16 hexadecimal digits, which travels with it as the metadata
// "x-request-id"; returns it.
std::string assign_request_id(grpc::ClientContext& context);

// The status of a call that failed: its message ends with the call's name, by which the server's
// log knows it.
grpc::Status with_request_id(const grpc::Status& status, const std::string& name);

// What the client calls it; "-" if it has no name, "?" if that is not of 1 to 64 letters, digits,
// and any of "._-": it is part of a line, and must not look like others.
std::string request_id_of(const grpc::CallbackServerContext& context);

}  // namespace itn
