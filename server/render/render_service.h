// itn.v1.RenderService: checks requests, finds or builds their scenes, renders, answers.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>

#include "itn/v1/render.grpc.pb.h"
#include "server/render/request_render.h"
#include "server/render/scene_cache.h"
#include "server/rpc/metrics.h"
#include "server/rpc/queued_call.h"

namespace itn {

struct RenderServiceOptions {
  int threads = 0;                         // of each render; 0: one per processor
  int renders = 1;                         // at a time
  size_t queue_capacity = 16;              // requests that wait
  size_t cache_bytes = size_t{512} << 20;  // of scenes and their parts
  // Memory of all requests under way together, and of scenes in use as far as they do not fit into
  // cache_bytes; 0: no limit.
  uint64_t memory_bytes = 0;
  double max_seconds = 600;  // of a render, its scene included; 0: no limit
  bool log_calls = false;    // a line for each that is answered
  RenderLimits limits;
};

// The bytes of requests are parsed here, not by gRPC, so that a request is turned away before it is
// parsed and its parts are bounded before they are allocated.
class RenderService final
    : public v1::RenderService::WithRawCallbackMethod_RenderGrad<
          v1::RenderService::WithRawCallbackMethod_GetCapabilities<v1::RenderService::Service>> {
 public:
  explicit RenderService(const RenderServiceOptions& options);

  grpc::ServerUnaryReactor* RenderGrad(grpc::CallbackServerContext* context,
                                       const grpc::ByteBuffer* request,
                                       grpc::ByteBuffer* reply) override;
  grpc::ServerUnaryReactor* GetCapabilities(grpc::CallbackServerContext* context,
                                            const grpc::ByteBuffer* request,
                                            grpc::ByteBuffer* reply) override;

  static std::string full_name() { return v1::RenderService::service_full_name(); }

  size_t running() const { return scheduler_.running(); }
  size_t waiting() const { return scheduler_.waiting(); }

  void describe(ServerMetrics& metrics) const {
    scheduler_.describe(metrics);
    metrics.scene_bytes = cache_.memory();
    metrics.scene_hits = cache_.hits();
    metrics.scene_misses = cache_.misses();
  }

  // See CallScheduler.
  bool drain(std::chrono::duration<double> patience) { return scheduler_.drain(patience); }

 private:
  class RenderCall;

  const RenderServiceOptions options_;
  SceneCache cache_;
  const RenderMeans means_;
  CallScheduler scheduler_;  // last: its threads use what is above
};

}  // namespace itn
