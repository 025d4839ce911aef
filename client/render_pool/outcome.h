// What a worker's status means for the render and for the worker.
#pragma once

#include <grpcpp/support/status.h>

#include <chrono>
#include <optional>
#include <string>

namespace itn {

enum class Outcome {
  kAnswered,
  kBusy,         // the worker lives and has no place: nothing failed
  kUnreachable,  // it is not there, or stops: the render has nothing to do with it
  kLost,         // it vanished, or the deadline passed, with the render under way
  kFailed,       // it could not do this render: another worker may
  kInvalid,      // no worker can do this render
  kBadReply,     // it gave an answer that cannot be right; no status says so, the check of a reply
                 // does
};

//   OK                              kAnswered
//   UNAVAILABLE with a v1::Busy     kBusy
//   UNAVAILABLE with a v1::Stopping kUnreachable
//   UNAVAILABLE without details     kLost: gRPC says so of a connection that broke
//   CANCELLED                       kUnreachable: what we cancelled ourselves is nobody's outcome
//   DEADLINE_EXCEEDED               kLost
//   INVALID_ARGUMENT                kInvalid
//   UNIMPLEMENTED                   kUnreachable: it is not a render worker
//   UNAUTHENTICATED                 kUnreachable: its token and ours differ, or do for a moment
//   all others                      kFailed, RESOURCE_EXHAUSTED and INTERNAL among them
Outcome outcome_of(const grpc::Status& status);

// When a busy worker wants to be asked again; nothing if it does not say.
std::optional<std::chrono::milliseconds> retry_after(const grpc::Status& status);

// For people: what a worker's failure was.
std::string describe(const grpc::Status& status);

}  // namespace itn
