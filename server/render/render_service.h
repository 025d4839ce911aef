// itn.v1.RenderService: checks requests, finds or builds their scenes, renders, answers.
#pragma once

#include <cstddef>

#include "common/rpc/job_queue.h"
#include "itn/v1/render.grpc.pb.h"
#include "server/render/request_check.h"
#include "server/render/scene_cache.h"

namespace itn {

struct RenderServiceOptions {
  int threads = 0;                       // of each render; 0: one per processor
  int renders = 1;                       // at a time
  size_t queue_capacity = 16;            // requests that wait
  size_t cache_bytes = size_t{1} << 30;  // of scenes
  RenderLimits limits;
};

class RenderService final : public v1::RenderService::CallbackService {
 public:
  explicit RenderService(const RenderServiceOptions& options);

  grpc::ServerUnaryReactor* RenderGrad(grpc::CallbackServerContext* context,
                                       const v1::RenderGradRequest* request,
                                       v1::RenderGradReply* reply) override;
  grpc::ServerUnaryReactor* GetCapabilities(grpc::CallbackServerContext* context,
                                            const v1::GetCapabilitiesRequest* request,
                                            v1::Capabilities* reply) override;

  // Answers further requests UNAVAILABLE; returns when those accepted before are answered.
  void drain() { queue_.drain(); }

 private:
  class RenderCall;

  SceneCache::ScenePtr scene_of(const v1::RenderGradRequest& request);

  const RenderServiceOptions options_;
  SceneCache cache_;
  JobQueue queue_;  // last: its threads use what is above
};

}  // namespace itn
