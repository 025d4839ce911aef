// How errors cross the wire: Error kinds to gRPC status codes and back, in one place.
#pragma once

#include <grpcpp/support/status.h>

#include <exception>
#include <string>
#include <utility>

#include "common/error.h"

namespace itn {

//   kind                     status                 and back
//   kInvalidInput, kUsage    INVALID_ARGUMENT       kInvalidInput (so too NOT_FOUND: a name)
//   kLimit                   RESOURCE_EXHAUSTED     kLimit
//   kUnavailable             UNAVAILABLE            kUnavailable (so too DEADLINE_EXCEEDED,
//                                                   UNIMPLEMENTED and UNAUTHENTICATED: another
//                                                   server may do)
//   kCancelled               CANCELLED              kCancelled
//   kDataLoss                DATA_LOSS              kDataLoss
//   kIo, kInternal           INTERNAL               kInternal (and every other code)
// A server is unavailable when it stops: that status carries a serialized v1::Stopping.
grpc::Status to_status(const Error& error);

// A status with details, thrown as it is to be answered.
class StatusError : public std::exception {
 public:
  explicit StatusError(grpc::Status status)
      : status_(std::move(status)), message_(status_.error_message()) {}
  const grpc::Status& status() const { return status_; }
  const char* what() const noexcept override { return message_.c_str(); }

 private:
  grpc::Status status_;
  std::string message_;
};

// UNAVAILABLE with a serialized Busy: there will be room in about so many seconds.
StatusError busy(const std::string& message, double retry_after_seconds);

// The status of the exception being handled: call it inside a catch block. Memory that could not be
// had is RESOURCE_EXHAUSTED: the same request would ask for as much again. An exception that is
// neither an Error nor a StatusError is INTERNAL. Messages are cut at 2000 bytes: they travel as a
// header.
grpc::Status status_of_current_exception();

// The name that gRPC's documents write, e.g. "NOT_FOUND".
std::string status_name(grpc::StatusCode code);

// What a server said, fit to be shown: one line, of its first 2000 bytes (printable.h).
std::string message_of(const grpc::Status& status);

// The error of a call that failed; `who` answered it (e.g. "worker 10.0.0.1:50051") and begins the
// message, unless it is empty.
Error to_error(const grpc::Status& status, const std::string& who);

}  // namespace itn
