// The render workers that a client uses: any number of remote ones, or one inside this process.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <vector>

#include "common/scene/scene_bytes.h"
#include "itn/v1/render.pb.h"

namespace itn {

// One render. `request` has neither scene nor digest: the pool fills in what the worker needs.
struct RenderJob {
  std::shared_ptr<const SerializedScene> scene;
  v1::RenderGradRequest request;
};

struct RenderPoolOptions {
  // HOST:PORT each; empty: an embedded worker behind gRPC's in-process channel.
  std::vector<std::string> workers;
  // Threads of the embedded worker; 0: all.
  int embedded_threads = 0;
  // Of one attempt.
  std::chrono::milliseconds deadline = std::chrono::minutes(10);
  // How long the constructor waits for the first worker to answer.
  std::chrono::milliseconds connect_within = std::chrono::seconds(5);
  // A job that no worker could answer is tried again, on whichever worker is free, until this much
  // time has passed since it first failed without any job having succeeded.
  std::chrono::milliseconds give_up_after = std::chrono::seconds(30);
};

// Gives the next job to the worker that is free; a job whose worker fails goes to another. As
// answers depend on the request alone, the results are the same in every arrangement, bit for bit.
// Thread-safe.
class RenderPool {
 public:
  // Throws Error (kUnavailable) that names the workers if none answers.
  explicit RenderPool(RenderPoolOptions options);
  // Cancels what is under way.
  ~RenderPool();

  // The future throws Error: kInvalidInput, kLimit (as the worker says; not retried), kUnavailable,
  // kCancelled.
  std::future<v1::RenderGradReply> submit(RenderJob job);

  // Called on the caller's thread some ten times a second, with the fraction done, in [0, 1]. May
  // throw to give up; what was handed out to workers by then is still rendered.
  using Progress = std::function<void(double fraction)>;

  // Renders one job split by sample range over all workers and puts the parts together: the same
  // images as one worker gives, bit for bit. Throws what the futures of `submit` throw.
  v1::RenderGradReply render_split(const RenderJob& job, const Progress& progress = {});

  // Jobs that can be under way at once; keep somewhat more submitted.
  int parallelism() const;

  struct Statistics {
    uint64_t jobs = 0;         // that succeeded
    uint64_t retries = 0;      // attempts beyond the first
    uint64_t scenes_sent = 0;  // scenes that a worker did not hold
    double cpu_seconds = 0;    // spent by the workers
  };
  Statistics statistics() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace itn
