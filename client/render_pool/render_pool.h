// The render workers that a client uses: any number of remote ones, or one inside this process.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <vector>

#include "client/render/job_renderer.h"
#include "client/render_pool/render_statistics.h"
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
class RenderPool final : public JobRenderer {
 public:
  // Throws Error: kUnavailable that names the workers if there are some and none answers; as
  // WorkerList and Connector.
  explicit RenderPool(RenderPoolOptions options);
  // Cancels what is under way.
  ~RenderPool() override;

  // The future throws Error: kInvalidInput (as the first worker says); kLimit, kInternal (as all
  // workers say, or the first few); kUnavailable; kCancelled.
  std::future<v1::RenderGradReply> submit(RenderJob job) override;

  // Changes as workers join and leave.
  int parallelism() const override;

  RenderStatistics statistics() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace itn
