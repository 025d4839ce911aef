#include "common/rpc/shutdown_signal.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

namespace itn {
namespace {

// Whatever the process is at, and does not end.
TEST(ShutdownSignal, TheSecondEndsTheProcessAndSaysSo) {
  const auto interrupted_twice = [] {
    ShutdownSignal signal;
    ::raise(SIGTERM);
    signal.wait();
    signal.exit_on_next();
    ::raise(SIGTERM);
    for (;;) ::pause();
  };
  ::testing::GTEST_FLAG(death_test_style) = "threadsafe";
  EXPECT_EXIT(interrupted_twice(), ::testing::ExitedWithCode(130), "interrupted again");
}

}  // namespace
}  // namespace itn
