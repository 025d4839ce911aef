#include "common/rpc/status.h"

#include <gtest/gtest.h>

#include <new>
#include <stdexcept>
#include <string>

namespace itn {
namespace {

struct Row {
  ErrorKind kind;
  grpc::StatusCode code;
  ErrorKind back;
};

TEST(Status, CarriesKindAndMessageAcrossTheWire) {
  const Row rows[] = {
      {ErrorKind::kInvalidInput, grpc::INVALID_ARGUMENT, ErrorKind::kInvalidInput},
      {ErrorKind::kUsage, grpc::INVALID_ARGUMENT, ErrorKind::kInvalidInput},
      {ErrorKind::kLimit, grpc::RESOURCE_EXHAUSTED, ErrorKind::kLimit},
      {ErrorKind::kUnavailable, grpc::UNAVAILABLE, ErrorKind::kUnavailable},
      {ErrorKind::kCancelled, grpc::CANCELLED, ErrorKind::kCancelled},
      {ErrorKind::kDataLoss, grpc::DATA_LOSS, ErrorKind::kDataLoss},
      {ErrorKind::kIo, grpc::INTERNAL, ErrorKind::kInternal},
      {ErrorKind::kInternal, grpc::INTERNAL, ErrorKind::kInternal},
  };
  for (const Row& row : rows) {
    const grpc::Status status = to_status(Error(row.kind, "what and where"));
    EXPECT_EQ(status.error_code(), row.code);
    const Error error = to_error(status, "worker a:1");
    EXPECT_EQ(error.kind(), row.back);
    EXPECT_STREQ(error.what(), "worker a:1: what and where");
  }
}

TEST(Status, TakesADeadlineAMissingServiceAndAnUnwelcomeClientForUnavailable) {
  EXPECT_EQ(to_error({grpc::DEADLINE_EXCEEDED, ""}, "").kind(), ErrorKind::kUnavailable);
  EXPECT_EQ(to_error({grpc::UNIMPLEMENTED, ""}, "").kind(), ErrorKind::kUnavailable);
  EXPECT_EQ(to_error({grpc::UNAUTHENTICATED, ""}, "").kind(), ErrorKind::kUnavailable);
}

TEST(Status, HasItsName) {
  EXPECT_EQ(status_name(grpc::StatusCode::OK), "OK");
  EXPECT_EQ(status_name(grpc::StatusCode::NOT_FOUND), "NOT_FOUND");
  EXPECT_EQ(status_name(grpc::StatusCode::UNAUTHENTICATED), "UNAUTHENTICATED");
}

// What another process says can neither steer the terminal nor fill it.
TEST(Status, OfAStrangerIsFitToBeShown) {
  const std::string said = "no\x1b[2J\nroot# " + std::string(1 << 20, 'x');
  const std::string shown = to_error({grpc::INTERNAL, said}, "worker a:1").what();
  EXPECT_TRUE(shown.starts_with("worker a:1: no\\x1b[2J\\x0aroot# xxx")) << shown.substr(0, 80);
  EXPECT_LT(shown.size(), 3000U);
}

template <typename Exception>
grpc::Status status_of(const Exception& exception) {
  try {
    throw exception;
  } catch (...) {
    return status_of_current_exception();
  }
}

TEST(Status, OfExceptionsThatAreNoErrors) {
  EXPECT_EQ(status_of(std::bad_alloc()).error_code(), grpc::RESOURCE_EXHAUSTED);
  EXPECT_EQ(status_of(std::runtime_error("x")).error_code(), grpc::INTERNAL);
  EXPECT_EQ(status_of(1).error_code(), grpc::INTERNAL);
}

}  // namespace
}  // namespace itn
