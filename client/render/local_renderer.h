// Renders in this process, by all its processors. No service and no gRPC: what a program links that
// only renders by itself.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <future>
#include <mutex>
#include <stop_token>
#include <thread>
#include <vector>

#include "client/render/job_renderer.h"
#include "server/render/request_render.h"

namespace itn {

class LocalRenderer final : public JobRenderer {
 public:
  // `cache` holds the scenes of earlier renders, of this one and of others; it must outlive it.
  // `threads` is how many there are in all, 0: one for each processor.
  explicit LocalRenderer(SceneCache& cache, int threads = 0);
  // Cancels what is under way.
  ~LocalRenderer() override;

  // Jobs that wait together are rendered at the same time with a thread each; a job that is alone
  // is rendered by all threads.
  std::future<v1::RenderGradReply> submit(RenderJob job) override;
  int parallelism() const override { return static_cast<int>(threads_); }

 private:
  struct Waiting {
    RenderJob job;
    std::promise<v1::RenderGradReply> reply;
  };

  void serve(const std::stop_token& stop);
  v1::RenderGradReply render(const RenderJob& job, size_t threads, const std::stop_token& stop);

  SceneCache& cache_;
  const size_t threads_;

  std::mutex mutex_;  // guards what follows
  std::condition_variable_any submitted_;
  std::deque<Waiting> waiting_;
  size_t free_;      // threads
  size_t idle_ = 0;  // servers that wait for a job

  std::vector<std::jthread> servers_;  // last: they use what is above
};

}  // namespace itn
