#include "common/rpc/status.h"

#include <iterator>
#include <new>
#include <system_error>

#include "common/printable.h"
#include "itn/v1/render.pb.h"

namespace itn {
namespace {

grpc::StatusCode code_of(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kUsage:
    case ErrorKind::kInvalidInput: return grpc::StatusCode::INVALID_ARGUMENT;
    case ErrorKind::kLimit: return grpc::StatusCode::RESOURCE_EXHAUSTED;
    case ErrorKind::kUnavailable: return grpc::StatusCode::UNAVAILABLE;
    case ErrorKind::kCancelled: return grpc::StatusCode::CANCELLED;
    case ErrorKind::kDataLoss: return grpc::StatusCode::DATA_LOSS;
    case ErrorKind::kIo:
    case ErrorKind::kInternal: return grpc::StatusCode::INTERNAL;
  }
  return grpc::StatusCode::INTERNAL;
}

ErrorKind kind_of(grpc::StatusCode code) {
  switch (code) {
    case grpc::StatusCode::NOT_FOUND:
    case grpc::StatusCode::INVALID_ARGUMENT: return ErrorKind::kInvalidInput;
    case grpc::StatusCode::RESOURCE_EXHAUSTED: return ErrorKind::kLimit;
    case grpc::StatusCode::UNAUTHENTICATED:
    case grpc::StatusCode::UNAVAILABLE:
    case grpc::StatusCode::UNIMPLEMENTED:
    case grpc::StatusCode::DEADLINE_EXCEEDED: return ErrorKind::kUnavailable;
    case grpc::StatusCode::CANCELLED: return ErrorKind::kCancelled;
    case grpc::StatusCode::DATA_LOSS: return ErrorKind::kDataLoss;
    default: return ErrorKind::kInternal;
  }
}

constexpr size_t kMaxMessageBytes = 2000;

// Within what gRPC lets a header take.
std::string bounded(const std::string& message) {
  return message.size() > kMaxMessageBytes ? message.substr(0, kMaxMessageBytes) + "..." : message;
}

}  // namespace

grpc::Status to_status(const Error& error) {
  grpc::Status status(code_of(error.kind()), bounded(error.what()));
  if (error.kind() != ErrorKind::kUnavailable) return status;
  v1::Stopping details;  // a server is away for no other reason
  details.set_stopping(true);
  return {status.error_code(), status.error_message(), details.SerializeAsString()};
}

StatusError busy(const std::string& message, double retry_after_seconds) {
  v1::Busy details;
  details.set_retry_after_seconds(retry_after_seconds);
  return StatusError({grpc::StatusCode::UNAVAILABLE, message, details.SerializeAsString()});
}

grpc::Status status_of_current_exception() {
  try {
    throw;
  } catch (const StatusError& error) {
    return error.status();
  } catch (const Error& error) {
    return to_status(error);
  } catch (const std::bad_alloc&) {
    return {grpc::StatusCode::RESOURCE_EXHAUSTED, "this server has no memory for the request"};
  } catch (const std::system_error& error) {
    // A thread that could not be started.
    return {grpc::StatusCode::RESOURCE_EXHAUSTED,
            bounded(std::string("this server has no means for the request: ") + error.what())};
  } catch (const std::exception& error) {
    return {grpc::StatusCode::INTERNAL, bounded(error.what())};
  } catch (...) {
    return {grpc::StatusCode::INTERNAL, "unknown exception"};
  }
}

std::string status_name(grpc::StatusCode code) {
  static constexpr const char* kNames[] = {"OK",
                                           "CANCELLED",
                                           "UNKNOWN",
                                           "INVALID_ARGUMENT",
                                           "DEADLINE_EXCEEDED",
                                           "NOT_FOUND",
                                           "ALREADY_EXISTS",
                                           "PERMISSION_DENIED",
                                           "RESOURCE_EXHAUSTED",
                                           "FAILED_PRECONDITION",
                                           "ABORTED",
                                           "OUT_OF_RANGE",
                                           "UNIMPLEMENTED",
                                           "INTERNAL",
                                           "UNAVAILABLE",
                                           "DATA_LOSS",
                                           "UNAUTHENTICATED"};
  const auto number = static_cast<size_t>(code);
  return number < std::size(kNames) ? kNames[number] : std::to_string(number);
}

std::string message_of(const grpc::Status& status) {
  return printable(status.error_message(), kMaxMessageBytes);
}

Error to_error(const grpc::Status& status, const std::string& who) {
  const std::string prefix = who.empty() ? "" : who + ": ";
  return Error(kind_of(status.error_code()), prefix + message_of(status));
}

}  // namespace itn
