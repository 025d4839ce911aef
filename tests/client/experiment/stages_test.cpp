#include "client/experiment/stages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <set>

#include "common/error.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using ::testing::ElementsAre;
using namespace testing;

// Two stages, the second of which takes what the first makes.
class Stages : public ::testing::Test {
 protected:
  Stage stage(const std::string& name, std::vector<std::string> after) {
    return {name, std::move(after), folder_.path(name), [this, name] {
              if (name == fails_) throw Error(ErrorKind::kUnavailable, "no worker");
              ran_.push_back(name);
              folder_.write(name, made_);
              return made_;
            }};
  }

  std::vector<Stage> stages() { return {stage("first", {}), stage("second", {"first"})}; }

  std::set<std::string> done(const std::string& inputs = "experiment") {
    return done_stages(stages(), folder_.path(), inputs);
  }

  // The names of those that ran.
  std::vector<std::string> run(const std::string& inputs = "experiment",
                               std::stop_token stop = {}) {
    ran_.clear();
    run_stages(
        stages(), folder_.path(), inputs, [] { return 0.0; },
        [](size_t, const Stage&, StageState, const v1::StageRecord&) {}, stop);
    return ran_;
  }

  TemporaryFolder folder_;
  std::string made_ = "1", fails_;
  std::vector<std::string> ran_;
};

TEST_F(Stages, WhatIsDoneIsNotDoneAgain) {
  EXPECT_THAT(run(), ElementsAre("first", "second"));
  EXPECT_THAT(run(), ElementsAre());
}

TEST_F(Stages, GoOnWhereOneFailed) {
  fails_ = "second";
  expect_error(ErrorKind::kUnavailable, {"no worker"}, [&] { run(); });
  EXPECT_THAT(ran_, ElementsAre("first"));
  fails_.clear();
  EXPECT_THAT(run(), ElementsAre("second"));
}

TEST_F(Stages, RunAgainWithoutTheirOutputAndWithOtherInputs) {
  run();
  std::filesystem::remove(folder_.path("first"));
  EXPECT_THAT(run(), ElementsAre("first"));  // makes the same: the second stays
  std::filesystem::remove(folder_.path("first"));
  made_ = "2";
  EXPECT_THAT(run(), ElementsAre("first", "second"));
  EXPECT_THAT(run("another experiment"), ElementsAre("first", "second"));
}

TEST_F(Stages, SayWhichAreDone) {
  EXPECT_THAT(done(), ElementsAre());
  fails_ = "second";
  EXPECT_THROW(run(), Error);
  EXPECT_THAT(done(), ElementsAre("first"));
  fails_.clear();
  run();
  EXPECT_THAT(done(), ElementsAre("first", "second"));
  EXPECT_THAT(done("another experiment"), ElementsAre());
  std::filesystem::remove(folder_.path("first"));
  EXPECT_THAT(done(), ElementsAre());  // what it will make is not known
}

TEST_F(Stages, NoneBeginsAfterAStop) {
  std::stop_source stop;
  stop.request_stop();
  expect_error(ErrorKind::kCancelled, {"interrupted"},
               [&] { run("experiment", stop.get_token()); });
  EXPECT_THAT(ran_, ElementsAre());
}

}  // namespace
}  // namespace itn
