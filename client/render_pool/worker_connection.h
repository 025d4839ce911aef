// The connection to one render worker.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <chrono>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <utility>

#include "client/render_pool/render_worker.h"
#include "itn/v1/render.grpc.pb.h"

namespace itn {

// Whether the worker answered that it does not hold the scene of this digest, which is to be sent.
bool asks_for_scene(const grpc::Status& status, const std::string& digest);

class WorkerConnection final : public RenderWorker {
 public:
  // Adds to a failed status why there is no connection, where gRPC does not say it.
  using Explain = std::function<grpc::Status(const grpc::Status&)>;

  // `explain` is empty for a worker in this process, which writes no log to look up requests in.
  explicit WorkerConnection(const std::shared_ptr<grpc::Channel>& channel, Explain explain = {})
      : stub_(v1::RenderService::NewStub(channel)), explain_(std::move(explain)) {}

  grpc::Status probe(bool patient, const std::stop_token& stop,
                     v1::Capabilities& capabilities) override;

  // The scene travels only to a worker that says that it does not hold it.
  Answer render(const RenderJob& job, std::chrono::milliseconds deadline,
                const std::stop_token& stop) override;

 private:
  grpc::Status call(const v1::RenderGradRequest& request, std::chrono::milliseconds deadline,
                    const std::stop_token& stop, v1::RenderGradReply& reply);

  const std::unique_ptr<v1::RenderService::Stub> stub_;
  const Explain explain_;
};

}  // namespace itn
