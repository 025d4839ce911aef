// A request from its message to the answer: what the service does behind its queue, and what a
// program does that needs no service. No gRPC.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <stop_token>
#include <string>

#include "itn/v1/render.pb.h"
#include "server/render/scene_cache.h"
#include "server/scene_compiler/request_builder.h"
#include "server/tracer/render.h"

namespace itn {

// What the renders of a process share.
struct RenderMeans {
  RenderLimits limits;
  int threads = 1;         // of each render
  double max_seconds = 0;  // a request that must take longer is refused; 0: none
  SceneCache& cache;
};

// Used by one thread at a time, but for activity(), paths() and what `reserve` does.
class RequestRender {
 public:
  // Called before memory is allocated: bytes that the request takes in all, and those of them that
  // it takes beyond the cache's budget whenever it comes. May throw.
  using Reserve = std::function<void(uint64_t bytes, uint64_t beyond_cache)>;

  RequestRender(const RenderMeans& means, Reserve reserve);

  // Checks what is quickly checked. Whether there is a scene: false where the request names one by
  // its digest that is not held. `bytes`: of the request as it came. Throws Error (invalid input).
  bool accept(v1::RenderGradRequest request, uint64_t bytes);

  // Throws Error: invalid input; kLimit; kCancelled when a stop was requested.
  v1::RenderGradReply render(const std::stop_token& stop);

  const v1::RenderGradRequest& request() const { return request_; }
  uint64_t paths() const { return paths_; }  // that were traced
  std::string activity() const;              // for people: what it is at. From any thread

 private:
  SceneCache::ScenePtr find_or_build_scene(const std::stop_token& stop);
  std::string key_of(const std::string& digest) const;
  tracer::SceneDescription describe(const std::stop_token& stop);
  void hold_description(const std::string& digest, const std::stop_token& stop);
  SceneCache::ScenePtr build(tracer::SceneDescription description, uint64_t held,
                             const std::stop_token& stop);
  void check_time(uint64_t pixels) const;
  void log(const tracer::FilmSums& sums) const;

  const RenderMeans& means_;
  const Reserve reserve_;
  v1::RenderGradRequest request_;
  uint64_t request_bytes_ = 0;
  // The scene of a request that waits and names one: it stays until then.
  SceneCache::ScenePtr scene_;
  SceneCache::DescribedPtr described_;
  BuiltRequest built_;
  std::atomic<uint64_t> paths_ = 0;
  std::atomic<bool> has_scene_ = false;
};

}  // namespace itn
