#include "common/printable.h"

#include <gtest/gtest.h>

namespace itn {
namespace {

TEST(Printable, IsOneLineOfBoundedLengthThatSteersNoTerminal) {
  EXPECT_EQ(printable("bunny.ply"), "bunny.ply");
  EXPECT_EQ(printable("a\nb\x1b[31m\x7f"), "a\\x0ab\\x1b[31m\\x7f");
  EXPECT_EQ(printable("a\\x0a"), "a\\\\x0a");
  EXPECT_EQ(printable("\xff"), "\\xff");
  EXPECT_EQ(printable("abcdef", 3), "abc...");
  EXPECT_EQ(printable("abc", 3), "abc");
}

}  // namespace
}  // namespace itn
