#include "client/progress.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

namespace itn {
namespace {

using std::chrono::seconds;
using ::testing::HasSubstr;
using ::testing::Not;

// A file to write to, and what was written.
struct Output {
  std::FILE* file = std::tmpfile();
  ~Output() { std::fclose(file); }
  std::string text() const {
    std::string result(static_cast<size_t>(std::ftell(file)), '\0');
    std::rewind(file);
    result.resize(std::fread(result.data(), 1, result.size(), file));
    return result;
  }
};

TEST(Progress, OffATerminalIsPlainLines) {
  const Output output;
  {
    Progress progress("rendering", "images", 4, 0, output.file);
    for (uint64_t i = 0; i <= 4; ++i) progress.update(i, "loss 0.5");
    progress.finish();
    progress.finish();
  }
  const std::string text = output.text();
  // Updates within ten seconds are silent: the last line alone.
  EXPECT_EQ(std::ranges::count(text, '\n'), 1);
  EXPECT_THAT(text, HasSubstr("rendering 4/4 images  100%"));
  EXPECT_THAT(text, HasSubstr("images/s"));
  EXPECT_THAT(text, HasSubstr("in all  loss 0.5\n"));
  EXPECT_THAT(text, Not(HasSubstr("\r")));
  EXPECT_THAT(text, Not(HasSubstr("\x1b")));
}

// In a process of its own, as it holds for all that follow.
TEST(ProgressDeathTest, IsSilentOnRequest) {
  EXPECT_EXIT(
      {
        silence_progress();
        Progress("rendering", "images", 4).finish();
        std::exit(0);
      },
      ::testing::ExitedWithCode(0), "^$");
}

TEST(Progress, WhatWasDoneBeforeIsNotInTheRate) {
  const Output output;
  {
    Progress progress("rendering", "images", 100, 60, output.file);
    progress.finish();
  }
  EXPECT_THAT(output.text(), HasSubstr("60/100"));
  EXPECT_THAT(output.text(), Not(HasSubstr("/s")));
}

TEST(Progress, OnATerminalRedrawsOneLineAtMostTenTimesASecond) {
  int controller = -1, terminal = -1;
  if (::openpty(&controller, &terminal, nullptr, nullptr, nullptr) != 0) {
    GTEST_SKIP() << "no pseudo-terminal can be opened here (is /dev/pts mounted?)";
  }
  std::FILE* file = ::fdopen(terminal, "w");
  const auto start = std::chrono::steady_clock::now();
  {
    Progress progress("training", "steps", 1000, 0, file);
    for (uint64_t i = 0; i < 250; ++i) {
      if (i == 125) progress.end_within(0);
      progress.update(i);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    progress.finish();
  }
  const auto tenths = (std::chrono::steady_clock::now() - start) / std::chrono::milliseconds(100);
  std::string text;  // up to the end of the line, which may arrive in pieces
  for (char c = 0; c != '\n'; text += c) ASSERT_EQ(::read(controller, &c, 1), 1);
  // Every redrawing begins with a carriage return; the end of line of a terminal is "\r\n".
  const auto drawn = std::ranges::count(text, '\r') - 1;
  EXPECT_GE(drawn, 2);
  EXPECT_LE(drawn, tenths + 1);
  EXPECT_THAT(text, HasSubstr(" left"));
  EXPECT_THAT(text, HasSubstr("at most 0 s left"));
  std::fclose(file);
  ::close(controller);
}

TEST(Progress, Durations) {
  EXPECT_EQ(format_duration(seconds(0)), "0 s");
  EXPECT_EQ(format_duration(seconds(59)), "59 s");
  EXPECT_EQ(format_duration(seconds(68)), "1:08");
  EXPECT_EQ(format_duration(seconds(7439)), "2:03:59");
}

}  // namespace
}  // namespace itn
