// The render workers that a client uses: any number of remote ones, or one inside this process.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "client/render_pool/render_job.h"
#include "client/rpc/client_security.h"
#include "itn/v1/render.pb.h"

namespace itn {

class RenderWorker;

struct RenderPoolOptions {
  // Addresses as worker_list.h reads them; none: an embedded worker behind gRPC's in-process
  // channel.
  std::vector<std::string> workers;
  ClientSecurity security;  // of the connections to them
  // How a worker at HOST:PORT is reached; for tests.
  std::function<std::unique_ptr<RenderWorker>(const std::string& address)> connect;
  // Threads of the embedded worker; 0: all.
  int embedded_threads = 0;
  // What it keeps of scenes for later renders, like --cache-mb of a worker.
  size_t embedded_cache_bytes = size_t{512} << 20;
  // The deadline of one attempt.
  std::chrono::milliseconds deadline = std::chrono::minutes(10);
  // How long the constructor waits for the first worker to answer, or to appear.
  std::chrono::milliseconds connect_within = std::chrono::seconds(5);
  // A job fails when no worker that could do it has answered for this long. One that says that it
  // has no place has answered. Where names or files have no address at all, jobs wait for one.
  std::chrono::milliseconds give_up_after = std::chrono::seconds(30);
};

// Gives the next job to the worker that is free; a job whose worker fails, or is late, goes to
// another (dispatcher.h has the rules). As answers depend on the request alone, the results are the
// same in every arrangement, bit for bit; an answer that cannot be right is not taken. Workers of
// another version are not used. Thread-safe.
class RenderPool {
 public:
  // Throws Error: kUnavailable that names the workers if there are some and none answers; as
  // WorkerList and Connector.
  explicit RenderPool(RenderPoolOptions options);
  // Cancels what is under way.
  ~RenderPool();

  // The future throws Error: kInvalidInput (as the first worker says); kLimit, kInternal (as all
  // workers say, or the first few); kUnavailable; kCancelled.
  std::future<v1::RenderGradReply> submit(RenderJob job);

  // Called on the caller's thread some ten times a second, with the fraction done, in [0, 1]. May
  // throw to give up; what was handed out to workers by then is still rendered.
  using Progress = std::function<void(double fraction)>;

  // Renders one job (not a loss) in tiles on all workers and puts them together. How many workers
  // there are does not matter; without a pilot, neither does it that there are tiles: the images
  // are those of `submit`, bit for bit. Throws what the futures of `submit` throw.
  v1::RenderGradReply render_split(const RenderJob& job, const Progress& progress = {});
  // Several, one after the other, and no worker idles between them.
  std::vector<v1::RenderGradReply> render_split(std::span<const RenderJob> jobs,
                                                const Progress& progress = {});

  // Jobs that can be under way at once; keep somewhat more submitted. Changes as workers join and
  // leave; never zero.
  int parallelism() const;

  RenderStatistics statistics() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

// A reply that was submitted. Throws Error (kCancelled) within a tenth of a second after a stop is
// requested, and what the future throws.
v1::RenderGradReply wait_for_render(std::future<v1::RenderGradReply>& future,
                                    const std::stop_token& stop);

}  // namespace itn
