#include "client/render_pool/outcome.h"

#include <algorithm>
#include <string_view>

#include "common/rpc/status.h"
#include "itn/v1/render.pb.h"

namespace itn {

Outcome outcome_of(const grpc::Status& status) {
  switch (status.error_code()) {
    case grpc::StatusCode::OK: return Outcome::kAnswered;
    case grpc::StatusCode::UNAVAILABLE:
      if (status.error_details().empty()) return Outcome::kLost;
      return retry_after(status) ? Outcome::kBusy : Outcome::kUnreachable;
    case grpc::StatusCode::CANCELLED:
    case grpc::StatusCode::UNAUTHENTICATED:
    case grpc::StatusCode::UNIMPLEMENTED: return Outcome::kUnreachable;
    case grpc::StatusCode::DEADLINE_EXCEEDED: return Outcome::kLost;
    case grpc::StatusCode::INVALID_ARGUMENT: return Outcome::kInvalid;
    default: return Outcome::kFailed;
  }
}

std::optional<std::chrono::milliseconds> retry_after(const grpc::Status& status) {
  v1::Busy busy;
  if (!busy.ParseFromString(status.error_details()) || !(busy.retry_after_seconds() > 0)) return {};
  // Whatever a server says: not at once, and not in days.
  constexpr double kMinSeconds = 0.001, kMaxSeconds = 3600;
  return std::chrono::milliseconds(static_cast<int64_t>(
      1000 * std::clamp(busy.retry_after_seconds(), kMinSeconds, kMaxSeconds)));
}

std::string describe(const grpc::Status& status) {
  if (status.error_code() == grpc::StatusCode::UNIMPLEMENTED) return "it is not a render worker";
  // What gRPC says of it.
  constexpr std::string_view kSilence = "keepalive watchdog timeout";
  const std::string message = message_of(status);
  return message.starts_with(kSilence)
             ? "no sign of life for ten seconds" + message.substr(kSilence.size())
             : message;
}

}  // namespace itn
