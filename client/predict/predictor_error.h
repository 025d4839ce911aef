// What is said of a predictor that did not answer.
#pragma once

#include <fmt/format.h>
#include <grpcpp/support/status.h>

#include <string>

#include "common/error.h"
#include "common/rpc/status.h"

namespace itn {

// The error of a call of PredictService at this address that failed.
inline Error predictor_error(const grpc::Status& status, const std::string& address) {
  if (status.error_code() == grpc::StatusCode::UNIMPLEMENTED) {
    return {ErrorKind::kUnavailable,
            fmt::format("{} is not a predictor; itn-predictor is one", address)};
  }
  return to_error(status, "predictor " + address);
}

}  // namespace itn
