// The connection to one render worker.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <chrono>
#include <memory>
#include <stop_token>
#include <string>

#include "client/render_pool/render_worker.h"
#include "itn/v1/render.grpc.pb.h"

namespace itn {

class WorkerConnection final : public RenderWorker {
 public:
  explicit WorkerConnection(const std::shared_ptr<grpc::Channel>& channel)
      : stub_(v1::RenderService::NewStub(channel)) {}

  grpc::Status probe(bool patient, const std::stop_token& stop,
                     v1::Capabilities& capabilities) override;

  // The scene travels only to a worker that says that it does not hold it.
  Answer render(const RenderJob& job, std::chrono::milliseconds deadline,
                const std::stop_token& stop) override;

 private:
  grpc::Status call(const v1::RenderGradRequest& request, std::chrono::milliseconds deadline,
                    const std::stop_token& stop, v1::RenderGradReply& reply);

  const std::unique_ptr<v1::RenderService::Stub> stub_;
};

}  // namespace itn
