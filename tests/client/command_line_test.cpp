#include "client/command_line.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "client/output.h"

namespace itn {
namespace {

using Arguments = std::vector<std::string>;

struct SmallApp {
  SmallApp() {
    CLI::App* render = app.add_subcommand("render");
    render->add_option("scene", scene)->required();
    render->add_option("--workers", workers)->delimiter(',')->allow_extra_args(false);
    render->add_option("--sigma-t", sigma_t)->required();
    app.add_subcommand("evaluate");
  }

  CLI::App app;
  std::string scene;
  std::vector<std::string> workers;
  double sigma_t = 0;
};

TEST(CommandLine, ListsMayHaveSpacesAtTheirCommas) {
  const SmallApp small;
  const Arguments wanted = {"render", "--workers", "a,b,c", "scene"};
  for (const Arguments& given : {Arguments{"render", "--workers", "a,b,c", "scene"},
                                 Arguments{"render", "--workers", "a,", "b,", "c", "scene"},
                                 Arguments{"render", "--workers", "a", ",b", ",", "c", "scene"},
                                 Arguments{"render", "--workers", "a, b , c", "scene"}}) {
    EXPECT_EQ(with_lists_joined(small.app, given), wanted);
  }
  EXPECT_EQ(with_lists_joined(small.app, {"render", "--workers=a,", "b", "scene"}),
            (Arguments{"render", "--workers=a,b", "scene"}));
  // No list: left alone.
  EXPECT_EQ(with_lists_joined(small.app, {"render", "my, scene", "--sigma-t", "1,", "2"}),
            (Arguments{"render", "my, scene", "--sigma-t", "1,", "2"}));
  EXPECT_EQ(with_lists_joined(small.app, {"render", "--workers"}),
            (Arguments{"render", "--workers"}));
}

// CLI11 would drop it.
TEST(CommandLine, RefusesAnEmptyEntryOfAList) {
  const SmallApp small;
  EXPECT_EQ(empty_entry(small.app, {"render", "--workers", "a,,b", "scene"}),
            "--workers a,,b: an entry of the list is empty");
  EXPECT_EQ(empty_entry(small.app, {"render", "scene", "--workers=a,"}),
            "--workers a,: an entry of the list is empty");
  EXPECT_NE(empty_entry(small.app, {"render", "--workers", ",a"}), "");
  EXPECT_EQ(empty_entry(small.app, {"render", "my,,scene", "--workers", "a,b"}), "");
  EXPECT_EQ(empty_entry(small.app, {"render", "scene", "--workers"}), "");
}

TEST(CommandLine, SaysWhichNameMayHaveBeenMeant) {
  const SmallApp small;
  EXPECT_EQ(unknown_name(small.app, {"rendre"}),
            "there is no command rendre; did you mean render?");
  EXPECT_EQ(unknown_name(small.app, {"eval"}), "there is no command eval; did you mean evaluate?");
  EXPECT_EQ(unknown_name(small.app, {"paint"}), "there is no command paint");
  EXPECT_EQ(unknown_name(small.app, {"render", "s", "--sgima-t=3"}),
            "itn render has no flag --sgima-t; did you mean --sigma-t?");
  EXPECT_EQ(unknown_name(small.app, {"render", "--worker", "a"}),
            "itn render has no flag --worker; did you mean --workers?");
  EXPECT_EQ(unknown_name(small.app, {"render", "--frobnicate"}),
            "itn render has no flag --frobnicate");
  EXPECT_EQ(unknown_name(small.app, {"--hepl"}), "there is no flag --hepl; did you mean --help?");
  EXPECT_EQ(unknown_name(small.app, {"render", "s", "--sigma-t", "-3"}), "");
}

TEST(Output, CannotSteerATerminal) {
  EXPECT_EQ(for_terminal("plain, grün\n"), "plain, grün\n");
  EXPECT_EQ(for_terminal("\x1b[2Jgone\r\t\x7f"), "\\x1b[2Jgone\\x0d\\x09\\x7f");
  EXPECT_EQ(for_terminal("\xc2\x9b"
                         "2J"),
            "\\xc2\\x9b2J");  // CSI as one character
  EXPECT_EQ(for_terminal("\xc2\xa0\xc2"), "\xc2\xa0\xc2");
}

}  // namespace
}  // namespace itn
