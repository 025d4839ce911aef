#include "common/rpc/status.h"

#include <new>

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
    case grpc::StatusCode::INVALID_ARGUMENT: return ErrorKind::kInvalidInput;
    case grpc::StatusCode::RESOURCE_EXHAUSTED: return ErrorKind::kLimit;
    case grpc::StatusCode::UNAVAILABLE:
    case grpc::StatusCode::UNIMPLEMENTED:
    case grpc::StatusCode::DEADLINE_EXCEEDED: return ErrorKind::kUnavailable;
    case grpc::StatusCode::CANCELLED: return ErrorKind::kCancelled;
    case grpc::StatusCode::DATA_LOSS: return ErrorKind::kDataLoss;
    default: return ErrorKind::kInternal;
  }
}

}  // namespace

grpc::Status to_status(const Error& error) {
  return {code_of(error.kind()), error.what()};
}

grpc::Status status_of_current_exception() {
  try {
    throw;
  } catch (const Error& error) {
    return to_status(error);
  } catch (const std::bad_alloc&) {
    return {grpc::StatusCode::UNAVAILABLE, "out of memory"};
  } catch (const std::exception& error) {
    return {grpc::StatusCode::INTERNAL, error.what()};
  } catch (...) {
    return {grpc::StatusCode::INTERNAL, "unknown exception"};
  }
}

Error to_error(const grpc::Status& status, const std::string& who) {
  const std::string prefix = who.empty() ? "" : who + ": ";
  return Error(kind_of(status.error_code()), prefix + status.error_message());
}

}  // namespace itn
