#include "common/rpc/token_file.h"

#include <gtest/gtest.h>

#include <string>

#include "common/error.h"
#include "tests/support/captured_log.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace testing;

const std::string kOne = "0123456789abcdef";
const std::string kOther = "fedcba9876543210";

TEST(TokenFile, AdmitsItsTokensAlone) {
  const TemporaryFolder folder;
  TokenFile tokens(folder.write("token", "\n" + kOne + "\r\n\n" + kOther + "\n"));
  EXPECT_EQ(tokens.header(), "Bearer " + kOne);
  EXPECT_TRUE(tokens.admits("Bearer " + kOne));
  EXPECT_TRUE(tokens.admits("Bearer " + kOther));
  for (const std::string& header :
       {std::string(), std::string("Bearer "), kOne, "bearer " + kOne, "Bearer " + kOne + "0",
        "Bearer " + kOne.substr(1), "Bearer " + kOne + kOther, "Bearer  " + kOne}) {
    EXPECT_FALSE(tokens.admits(header)) << header;
  }
}

TEST(TokenFile, IsReadAgainWhenItChanges) {
  const TemporaryFolder folder;
  TokenFile tokens(folder.write("token", kOne));
  folder.write("token", kOther + "\n");
  EXPECT_FALSE(tokens.admits("Bearer " + kOne));
  EXPECT_TRUE(tokens.admits("Bearer " + kOther));
  // By renaming, as well.
  folder.write("next", kOne + "\n");
  std::filesystem::rename(folder.path("next"), folder.path("token"));
  EXPECT_EQ(tokens.header(), "Bearer " + kOne);
}

TEST(TokenFile, KeepsItsTokensWhenTheFileIsGoneOrBad) {
  const TemporaryFolder folder;
  TokenFile tokens(folder.write("token", kOne));
  testing::CapturedLog log;
  folder.write("token", "short");
  EXPECT_TRUE(tokens.admits("Bearer " + kOne));
  EXPECT_FALSE(tokens.admits("Bearer short"));
  std::filesystem::remove(folder.path("token"));
  EXPECT_TRUE(tokens.admits("Bearer " + kOne));
  EXPECT_TRUE(tokens.admits("Bearer " + kOne));
  EXPECT_THAT(log.text(), ::testing::HasSubstr("line 1 has 5 characters rather than 16 to 4096"));
  EXPECT_THAT(log.text(), ::testing::HasSubstr("cannot read the token file"));
  EXPECT_THAT(log.text(), ::testing::Not(::testing::HasSubstr(kOne)));
}

TEST(TokenFile, SaysWhatIsWrongWithIt) {
  const TemporaryFolder folder;
  const auto refused = [&](const std::string& content, const std::string& why) {
    const std::string path = folder.write("token", content);
    expect_error(ErrorKind::kInvalidInput, {why}, [&] { const TokenFile file(path); });
  };
  refused("", "is empty");
  refused("\n\n", "is empty");
  refused("0123456789abcde\n", "line 1 has 15 characters");
  refused(std::string(4097, 'a'), "has 4097 characters rather than 16 to 4096");
  refused(kOne + "\na token of words", "line 2 has a space");
  refused("0123456789abcde\x01", "not printable");
  expect_error(ErrorKind::kIo, {"token file", "none"},
               [&] { const TokenFile file(folder.path("none")); });
}

}  // namespace
}  // namespace itn
