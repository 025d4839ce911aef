// Tells how a server is doing (status.proto).
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>

#include "itn/v1/status.grpc.pb.h"

namespace itn {

// The bytes of requests are parsed here, not by gRPC, so that their parts are bounded before they
// are allocated.
class StatusService final
    : public v1::StatusService::WithRawCallbackMethod_GetStatus<v1::StatusService::Service> {
 public:
  // `name`: full, of the service that it tells of. `describe` sets what that one knows of itself;
  // from any thread. `most_resident_bytes`: of the process; 0: no limit.
  StatusService(std::string name, std::function<void(v1::ServerStatus&)> describe,
                uint64_t most_resident_bytes);

  v1::ServerStatus status() const;

  void set_draining() { draining_ = true; }

  grpc::ServerUnaryReactor* GetStatus(grpc::CallbackServerContext* context,
                                      const grpc::ByteBuffer* request,
                                      grpc::ByteBuffer* reply) override;

 private:
  // Of the last second, as to add up what is free holds up those who allocate.
  uint64_t allocated_bytes() const;

  const std::string name_;
  const std::function<void(v1::ServerStatus&)> describe_;
  const uint64_t most_resident_bytes_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::atomic<bool> draining_ = false;
  mutable std::mutex mutex_;  // of what follows
  mutable std::optional<std::chrono::steady_clock::time_point> counted_;
  mutable uint64_t allocated_bytes_ = 0;
};

}  // namespace itn
