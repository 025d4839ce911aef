#include "common/rpc/status.h"

#include <gtest/gtest.h>

#include <new>
#include <stdexcept>

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
