// Calls of any bytes, as a client of another make may send them.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>

#include <chrono>
#include <future>
#include <memory>
#include <string>
#include <utility>

namespace itn::testing {

struct RawAnswer {
  grpc::Status status;
  std::string reply;  // as it came
};

// `method`: e.g. "/itn.v1.RenderService/RenderGrad".
inline RawAnswer call_with_bytes(const std::shared_ptr<grpc::Channel>& channel,
                                 const std::string& method, const std::string& bytes) {
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
  const grpc::Slice slice(bytes);
  grpc::ByteBuffer request(&slice, 1), reply;
  std::promise<grpc::Status> done;
  stub.UnaryCall(&context, method, grpc::StubOptions(), &request, &reply,
                 [&](grpc::Status status) { done.set_value(std::move(status)); });
  RawAnswer answer{.status = done.get_future().get(), .reply = {}};
  grpc::Slice received;
  if (answer.status.ok() && reply.DumpToSingleSlice(&received).ok()) {
    answer.reply.assign(reinterpret_cast<const char*>(received.begin()), received.size());
  }
  return answer;
}

}  // namespace itn::testing
