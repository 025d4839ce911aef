// Renders through `itn relay`, which asks workers for a process that has no gRPC.
#pragma once

#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <string>
#include <thread>

#include "client/render/job_renderer.h"

namespace itn {

class RelayRenderer final : public JobRenderer {
 public:
  // Takes a connected socket, whose other end the program reads from and writes to. `version`: of
  // the program that is expected there.
  RelayRenderer(int socket, std::string version);
  // Closes the socket: the program gives up what is under way, and ends.
  ~RelayRenderer() override;

  // The future throws Error also if the program ends (kUnavailable), or is of another version
  // (kInternal).
  std::future<v1::RenderGradReply> submit(RenderJob job) override;

  // As the last reply said.
  int parallelism() const override;

 private:
  void send_requests();
  void read_replies();
  // Fails what is pending, and what will be asked for.
  void end();

  const int socket_;
  const std::string version_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable submitted_;
  std::deque<std::promise<v1::RenderGradReply>> pending_;
  std::deque<RenderJob> unsent_;  // the program may not read yet
  int parallelism_ = 1;
  bool ended_ = false;

  std::thread writer_, reader_;  // last: they use what is above
};

}  // namespace itn
