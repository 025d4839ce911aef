// How errors cross the wire: Error kinds to gRPC status codes and back, in one place.
#pragma once

#include <grpcpp/support/status.h>

#include <string>

#include "common/error.h"

namespace itn {

//   kind                     status                 and back
//   kInvalidInput, kUsage    INVALID_ARGUMENT       kInvalidInput
//   kLimit                   RESOURCE_EXHAUSTED     kLimit
//   kUnavailable             UNAVAILABLE            kUnavailable (so too DEADLINE_EXCEEDED and
//                                                   UNIMPLEMENTED: another server may do)
//   kCancelled               CANCELLED              kCancelled
//   kDataLoss                DATA_LOSS              kDataLoss
//   kIo, kInternal           INTERNAL               kInternal (and every other code)
grpc::Status to_status(const Error& error);

// Of the exception being handled: call it inside a catch block. Memory that could not be had is
// RESOURCE_EXHAUSTED; an exception that is not an Error is INTERNAL.
grpc::Status status_of_current_exception();

// Of a call that failed; `who` answered it (e.g. "worker 10.0.0.1:50051") and begins the message,
// unless it is empty.
Error to_error(const grpc::Status& status, const std::string& who);

}  // namespace itn
