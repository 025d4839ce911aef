#include "common/rpc/status_service.h"

#include <utility>

#include "common/rpc/process_memory.h"
#include "common/rpc/queued_call.h"
#include "common/rpc/wire_check.h"

namespace itn {

StatusService::StatusService(std::string name, std::function<void(v1::ServerStatus&)> describe,
                             uint64_t most_resident_bytes)
    : name_(std::move(name)),
      describe_(std::move(describe)),
      most_resident_bytes_(most_resident_bytes) {}

v1::ServerStatus StatusService::status() const {
  v1::ServerStatus status;
  status.set_service(name_);
  status.set_version(ITN_VERSION);
  status.set_uptime_seconds(
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count());
  status.set_draining(draining_);
  status.set_resident_bytes(resident_memory());
  status.set_allocated_bytes(allocated_bytes());
  status.set_most_resident_bytes(most_resident_bytes_);
  describe_(status);
  return status;
}

uint64_t StatusService::allocated_bytes() const {
  const std::lock_guard lock(mutex_);
  const auto now = std::chrono::steady_clock::now();
  if (!counted_ || now - *counted_ > std::chrono::seconds(1)) {
    allocated_bytes_ = allocated_memory();
    counted_ = now;
  }
  return allocated_bytes_;
}

grpc::ServerUnaryReactor* StatusService::GetStatus(grpc::CallbackServerContext* context,
                                                   const grpc::ByteBuffer* request,
                                                   grpc::ByteBuffer* reply) {
  return answer_at_once(*context, [&] {
    v1::GetStatusRequest nothing;
    parse_checked(*request, "request", {}, nothing);
    *reply = serialized(status());
  });
}

}  // namespace itn
