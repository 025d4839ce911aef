#include "client/render_pool/outcome.h"

#include <gtest/gtest.h>

#include "common/error.h"
#include "common/rpc/status.h"
#include "tests/support/fake_worker.h"

namespace itn {
namespace {

using grpc::StatusCode;

TEST(Outcome, OfStatuses) {
  const auto outcome = [](StatusCode code) { return outcome_of(grpc::Status(code, "oh")); };
  EXPECT_EQ(outcome_of(grpc::Status::OK), Outcome::kAnswered);
  EXPECT_EQ(outcome(StatusCode::UNAVAILABLE), Outcome::kLost);
  EXPECT_EQ(outcome(StatusCode::DEADLINE_EXCEEDED), Outcome::kLost);
  EXPECT_EQ(outcome(StatusCode::CANCELLED), Outcome::kUnreachable);
  EXPECT_EQ(outcome(StatusCode::UNIMPLEMENTED), Outcome::kUnreachable);
  EXPECT_EQ(outcome(StatusCode::UNAUTHENTICATED), Outcome::kUnreachable);
  EXPECT_EQ(outcome(StatusCode::INVALID_ARGUMENT), Outcome::kInvalid);
  for (const StatusCode code :
       {StatusCode::RESOURCE_EXHAUSTED, StatusCode::INTERNAL, StatusCode::UNKNOWN,
        StatusCode::ABORTED, StatusCode::DATA_LOSS, StatusCode::PERMISSION_DENIED}) {
    EXPECT_EQ(outcome(code), Outcome::kFailed) << code;
  }
}

TEST(Outcome, OfAWorkerThatSaysWhenItHasAPlace) {
  EXPECT_EQ(outcome_of(testing::busy(0.25)), Outcome::kBusy);
  EXPECT_EQ(retry_after(testing::busy(0.25)), std::chrono::milliseconds(250));
}

TEST(Outcome, OfAWorkerThatStops) {
  const Error stopping(ErrorKind::kUnavailable, "this server is stopping");
  EXPECT_EQ(outcome_of(to_status(stopping)), Outcome::kUnreachable);
}

TEST(Outcome, IsSaidToPeople) {
  EXPECT_EQ(describe({StatusCode::UNAVAILABLE, "Socket closed"}), "Socket closed");
  EXPECT_EQ(describe({StatusCode::UNIMPLEMENTED, ""}), "it is not a render worker");
  EXPECT_EQ(describe({StatusCode::UNAVAILABLE, "keepalive watchdog timeout (request 1)"}),
            "no sign of life for ten seconds (request 1)");
}

}  // namespace
}  // namespace itn
