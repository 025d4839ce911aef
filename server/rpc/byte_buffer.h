// The bytes of calls, as gRPC has them.
#pragma once

#include <google/protobuf/message.h>
#include <grpcpp/support/byte_buffer.h>

#include <string>

#include "server/wire/wire_check.h"

namespace itn {

// As parse_checked() of wire_check.h.
void parse_checked(const grpc::ByteBuffer& bytes, const std::string& path,
                   const ElementLimits& limits, google::protobuf::Message& message);

// The reply of a call: serialized into memory that gRPC gives back when it is sent.
grpc::ByteBuffer serialized(const google::protobuf::Message& message);

}  // namespace itn
