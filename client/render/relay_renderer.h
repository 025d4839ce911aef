// Renders through `itn relay`, which asks workers for a process that has no gRPC.
#pragma once

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
  void read_replies();

  const int socket_;
  const std::string version_;

  mutable std::mutex mutex_;  // guards what follows
  std::deque<std::promise<v1::RenderGradReply>> pending_;
  std::string last_digest_;  // of the scene that the program holds
  int parallelism_ = 1;
  bool ended_ = false;

  std::thread reader_;  // last: it uses what is above
};

}  // namespace itn
