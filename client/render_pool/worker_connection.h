// The connection to one render worker. Every call blocks.
#pragma once

#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include <chrono>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <utility>

#include "client/render_pool/outcome.h"
#include "client/render_pool/render_job.h"
#include "itn/v1/render.grpc.pb.h"

namespace itn {

// What became of one attempt at a render.
struct Answer {
  Outcome outcome = Outcome::kAway;
  grpc::Status status;        // the message is for people where the outcome is not kAnswered
  v1::RenderGradReply reply;  // checked (reply_check.h), where the outcome is kAnswered
  bool scene_sent = false;    // the worker did not hold the scene
};

// Thread-safe.
class WorkerConnection {
 public:
  // Why there is no connection, where gRPC's status does not say so.
  using Explain = std::function<grpc::Status(const grpc::Status&)>;

  explicit WorkerConnection(
      const std::shared_ptr<grpc::Channel>& channel,
      Explain explain = [](const grpc::Status& status) { return status; })
      : stub_(v1::RenderService::NewStub(channel)), explain_(std::move(explain)) {}

  // Whether the worker is there, of our version, and what it takes. A patient call waits for a
  // connection that is being made; an impatient one says at once why there is none.
  grpc::Status probe(bool patient, const std::stop_token& stop, v1::Capabilities& capabilities);

  // Renders. The scene travels only to a worker that says that it does not hold it.
  Answer render(const RenderJob& job, std::chrono::milliseconds deadline,
                const std::stop_token& stop);

 private:
  grpc::Status call(const v1::RenderGradRequest& request, std::chrono::milliseconds deadline,
                    const std::stop_token& stop, v1::RenderGradReply& reply);

  const std::unique_ptr<v1::RenderService::Stub> stub_;
  const Explain explain_;
};

}  // namespace itn
