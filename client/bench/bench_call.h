// What a benchmark calls: one method of a server, with one request.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/byte_buffer.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "client/bench/load.h"
#include "client/render_pool/render_job.h"
#include "itn/v1/predict.pb.h"

namespace itn {

// A request as it travels, and what is known of its reply.
struct BenchRequest {
  std::string method;  // e.g. "/itn.v1.PredictService/Predict"
  grpc::ByteBuffer message;
  // Where the server says that it does not hold the scene of this digest, the call goes on with
  // this message.
  std::string scene_digest;
  grpc::ByteBuffer with_scene;
  // What is done in a call, in `unit`, as its reply says. Throws Error (kInternal) if it is none.
  std::function<double(const grpc::ByteBuffer& reply)> units;
  std::string unit;
};

// The scene travels when the server asks for it, as of every client. In camera "paths".
BenchRequest bench_request(const RenderJob& job);
// In "images".
BenchRequest bench_request(const v1::PredictRequest& request);

// Makes the calls, all with the same bytes, so that many can be under way and few threads suffice.
// Thread-safe.
class BenchCaller {
 public:
  // Calls go over the channels in turn; each ends after `timeout` at the latest.
  BenchCaller(const std::vector<std::shared_ptr<grpc::Channel>>& channels, BenchRequest request,
              std::chrono::milliseconds timeout);

  // As Load::StartCall.
  void start(const std::stop_token& stop, Load::Done done);

  // One call by itself, and what its reply says was done. While the server is busy it is made
  // again, when the server says, until the user interrupts.
  grpc::Status try_once(double& units);

  const std::string& unit() const { return request_.unit; }

 private:
  class Call;

  std::vector<std::unique_ptr<grpc::GenericStub>> stubs_;
  std::atomic<size_t> next_ = 0;
  const BenchRequest request_;
  const std::chrono::milliseconds timeout_;
};

}  // namespace itn
