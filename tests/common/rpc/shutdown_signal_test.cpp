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
    for (;;) {
      ::raise(SIGTERM);
      ::usleep(20'000);
    }
  };
  ::testing::GTEST_FLAG(death_test_style) = "threadsafe";
  EXPECT_EXIT(interrupted_twice(), ::testing::ExitedWithCode(130), "interrupted again");
}

// A shell sends it to the process, and to its group.
TEST(ShutdownSignal, TwoAtOnceAreOne) {
  const auto interrupted = [] {
    ShutdownSignal signal;
    ::raise(SIGINT);
    ::raise(SIGINT);
    signal.wait();
    signal.exit_on_next();
    ::usleep(50'000);  // the thread has taken the second by now, or takes it for one all the same
    ::_exit(7);
  };
  ::testing::GTEST_FLAG(death_test_style) = "threadsafe";
  EXPECT_EXIT(interrupted(), ::testing::ExitedWithCode(7), "");
}

}  // namespace
}  // namespace itn
