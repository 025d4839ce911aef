#include "common/logging.h"

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include "common/error.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

std::string logged(const char* level) {
  ::testing::internal::CaptureStderr();
  set_up_logging(level);
  spdlog::info("an info");
  spdlog::warn("a warning");
  return ::testing::internal::GetCapturedStderr();
}

TEST(Logging, GoesToStderrFromTheLevelOnWithoutColourOffATerminal) {
  const std::string info = logged("info");
  EXPECT_THAT(info, ::testing::ContainsRegex("info an info\n.*warning a warning\n"));
  EXPECT_THAT(info, ::testing::Not(::testing::HasSubstr("\x1b")));
  EXPECT_THAT(logged("warning"), ::testing::Not(::testing::HasSubstr("an info")));
  EXPECT_EQ(logged("off"), "");
}

// Names of files may be in it.
TEST(Logging, DoesNotSteerATerminal) {
  ::testing::internal::CaptureStderr();
  set_up_logging("info");
  spdlog::warn("n\x1b[2J");
  EXPECT_THAT(::testing::internal::GetCapturedStderr(), ::testing::EndsWith("n\\x1b[2J\n"));
}

// The field of what a JSON reader reads.
TEST(Logging, JsonLinesAreWholeWhateverTheMessage) {
  ::testing::internal::CaptureStderr();
  set_up_logging("info", LogFormat::kJson);
  spdlog::warn("a \"quoted\" back\\slash,\na line and \xc3\xa9");
  const std::string line = ::testing::internal::GetCapturedStderr();
  EXPECT_THAT(line, ::testing::ContainsRegex(
                        "^\\{\"time\":\"20[0-9-]+T[0-9:.]+Z\",\"level\":\"warning\",\"message\":"));
  EXPECT_THAT(line, ::testing::EndsWith("\"a \\\"quoted\\\" back\\\\slash,\\u000aa line and "
                                        "\\u00c3\\u00a9\"}\n"));
}

TEST(Logging, JsonLinesHaveFieldsOfTheirOwn) {
  const auto line = [](LogFormat format) {
    ::testing::internal::CaptureStderr();
    set_up_logging("info", format);
    const LogField fields[] = {{"method", std::string("a \"b\"")},
                               {"queue_ms", 0.25},
                               {"paths", 123456789.0},
                               {"work_ms", 0.1}};
    log_with_fields(spdlog::level::info, "a call", fields);
    spdlog::info("another");
    return ::testing::internal::GetCapturedStderr();
  };
  EXPECT_THAT(
      line(LogFormat::kJson),
      ::testing::HasSubstr("\"message\":\"a call\",\"method\":\"a \\\"b\\\"\","
                           "\"queue_ms\":0.25,\"paths\":123456789,\"work_ms\":0.1}\n{\"time\""));
  EXPECT_THAT(line(LogFormat::kJson), ::testing::EndsWith("\"message\":\"another\"}\n"));
  EXPECT_THAT(line(LogFormat::kText), ::testing::ContainsRegex("info a call\n.*another\n$"));
}

TEST(Logging, UnknownLevelIsAUsageError) {
  testing::expect_error(ErrorKind::kUsage, {"\"loud\"", "trace, debug, info"},
                        [] { set_up_logging("loud"); });
}

}  // namespace
}  // namespace itn
