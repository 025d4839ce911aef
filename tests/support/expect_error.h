// What a failing call says, for tests of error messages.
#pragma once

#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "common/error.h"

namespace itn::testing {

// Expects that `call` throws Error of this kind with a message that contains each of `parts`.
template <typename F>
void expect_error(ErrorKind kind, const std::vector<std::string>& parts, F&& call) {
  try {
    call();
  } catch (const Error& error) {
    EXPECT_EQ(exit_code(error.kind()), exit_code(kind)) << error.what();
    for (const std::string& part : parts) EXPECT_THAT(error.what(), ::testing::HasSubstr(part));
    return;
  }
  ADD_FAILURE() << "no error was thrown";
}

}  // namespace itn::testing
