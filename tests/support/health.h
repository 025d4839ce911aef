// Asks a server for its health.
#pragma once

#include <google/protobuf/wrappers.pb.h>
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include <cstdint>
#include <future>
#include <memory>
#include <string>
#include <utility>

namespace itn::testing {

// Status of the call, and the service's (1: it serves). The messages of grpc.health.v1 by what they
// are on the wire.
inline std::pair<grpc::Status, uint32_t> health(const std::shared_ptr<grpc::Channel>& channel,
                                                const std::string& service) {
  grpc::TemplatedGenericStub<google::protobuf::StringValue, google::protobuf::UInt32Value> stub(
      channel);
  grpc::ClientContext context;
  google::protobuf::StringValue request;
  request.set_value(service);
  google::protobuf::UInt32Value response;
  std::promise<grpc::Status> done;
  stub.UnaryCall(&context, "/grpc.health.v1.Health/Check", grpc::StubOptions(), &request, &response,
                 [&](grpc::Status status) { done.set_value(std::move(status)); });
  return {done.get_future().get(), response.value()};
}

}  // namespace itn::testing
