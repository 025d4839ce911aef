#include "server/server_main.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>

namespace itn {
namespace {

// A server that is told to stop as soon as it is there.
class StoppedServer {
 public:
  explicit StoppedServer(bool stops) : stops_(stops) { raise(SIGTERM); }
  std::string address() const { return "here"; }
  ServerMetrics metrics() const { return {}; }
  bool drain(std::chrono::duration<double> patience) const {
    std::fprintf(stderr, "drained within %g s\n", patience.count());
    return stops_;
  }

 private:
  bool stops_;
};

int run(bool stops) {
  ServerFlags flags;
  flags.drain_seconds = 7;
  CLI::App app;
  std::string name = "server";
  std::array<char*, 2> argv{name.data(), nullptr};
  return server_main(app, name, 1, argv.data(), flags,
                     [&] { return std::make_unique<StoppedServer>(stops); });
}

TEST(ServerMain, EndsWellWhenAllHasEnded) {
  EXPECT_EXIT(std::exit(run(true)), ::testing::ExitedWithCode(0), "drained within 7 s");
}

TEST(ServerMain, NamesAFlagThatItDoesNotHave) {
  const auto run_with_port = [] {
    ServerFlags flags;
    std::string listen;
    CLI::App app;
    app.add_option("--listen", listen);
    std::string name = "itn-server", flag = "--lisen", value = "5";
    std::array<char*, 4> argv{name.data(), flag.data(), value.data(), nullptr};
    return server_main(app, name, 3, argv.data(), flags,
                       [] { return std::make_unique<StoppedServer>(true); });
  };
  EXPECT_EXIT(std::exit(run_with_port()), ::testing::ExitedWithCode(2),
              "^itn-server: itn-server has no flag --lisen; did you mean --listen\\?\n");
}

TEST(ServerMain, LeavesWhatDoesNotStop) {
  EXPECT_EXIT(std::exit(run(false)), ::testing::ExitedWithCode(130),
              "drained within 7 s\n.*does not stop: the process ends without it");
}

}  // namespace
}  // namespace itn
