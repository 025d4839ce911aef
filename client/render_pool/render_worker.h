// What the pool asks of a worker, wherever it is.
#pragma once

#include <grpcpp/support/status.h>

#include <chrono>
#include <stop_token>

#include "client/render/render_job.h"
#include "client/render_pool/outcome.h"
#include "itn/v1/render.pb.h"

namespace itn {

// What became of one attempt at a render.
struct Answer {
  Outcome outcome = Outcome::kUnreachable;
  grpc::Status status;        // the message is for people where the outcome is not kAnswered
  v1::RenderGradReply reply;  // checked (reply_check.h), where the outcome is kAnswered
  bool scene_sent = false;    // the worker did not hold the scene
};

// Thread-safe. Every call blocks.
class RenderWorker {
 public:
  virtual ~RenderWorker() = default;

  // Whether the worker is there, of our version, and what it takes. A patient call waits for a
  // connection that is being made; an impatient one says at once why there is none.
  virtual grpc::Status probe(bool patient, const std::stop_token& stop,
                             v1::Capabilities& capabilities) = 0;

  // Renders.
  virtual Answer render(const RenderJob& job, std::chrono::milliseconds deadline,
                        const std::stop_token& stop) = 0;
};

}  // namespace itn
