#include "client/experiment/stages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <set>

#include "common/error.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
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
              if (name == breaks_) throw Error(ErrorKind::kUnavailable, "no worker");
              return made_;
            }};
  }

  std::vector<Stage> stages() {
    std::vector<Stage> all = {stage("first", {}), stage("second", {"first"})};
    all.back().is_result = true;
    all.insert(all.end(), more_.begin(), more_.end());
    return all;
  }

  std::set<std::string> done(const std::string& inputs = "experiment") {
    std::set<std::string> names;
    for (const StageStatus& status : stage_status(stages(), folder_.path(), inputs)) {
      if (status.is_done) names.insert(status.name);
    }
    return names;
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
  std::vector<Stage> more_;
  std::string made_ = "1", fails_;
  std::string breaks_;  // the name of one that fails when its output is begun
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

TEST_F(Stages, RunAgainWithOtherInputs) {
  run();
  EXPECT_THAT(run("another experiment"), ElementsAre("first", "second"));
}

// What the first makes is gone: nobody misses it, until the second is to run again.
TEST_F(Stages, WhatIsGoneIsMadeForThoseThatTakeIt) {
  run();
  fs::remove(folder_.path("first"));
  EXPECT_THAT(run(), ElementsAre());
  fs::remove(folder_.path("second"));
  EXPECT_THAT(run(), ElementsAre("first", "second"));
  fs::remove(folder_.path("second"));
  EXPECT_THAT(run(), ElementsAre("second"));
}

// The third takes nothing that is made anew, so far as is known at first.
TEST_F(Stages, AStageThatMakesSomethingElseWakesThoseAfterIt) {
  more_ = {stage("aside", {}), stage("third", {"second", "aside"})};
  EXPECT_THAT(run(), ElementsAre("first", "second", "aside", "third"));
  for (const char* name : {"first", "second", "aside", "stages/second.textproto"}) {
    fs::remove(folder_.path(name));
  }
  EXPECT_THAT(run(), ElementsAre("first", "second"));  // as before: the third stays
  fs::remove(folder_.path("stages/second.textproto"));
  made_ = "2";
  EXPECT_THAT(run(), ElementsAre("second", "aside", "third"));
}

// What is made once more is what it was, as far as is known: the third is not woken by a stop.
TEST_F(Stages, AStopWhileSomethingIsMadeOnceMoreWakesNothingElse) {
  more_ = {stage("aside", {}), stage("third", {"first", "aside"})};
  run();
  for (const char* name : {"first", "second", "aside"}) fs::remove(folder_.path(name));
  breaks_ = "first";
  EXPECT_THROW(run(), Error);
  breaks_.clear();
  EXPECT_THAT(run(), ElementsAre("first", "second"));
}

TEST_F(Stages, AStageMustMakeItsOutput) {
  Stage idle = stage("idle", {});
  idle.work = [] { return "nothing"; };
  more_ = {idle};
  expect_error(ErrorKind::kInternal, {"idle has not made"}, [&] { run(); });
}

// A gone result takes a gone stage, and that one another.
TEST_F(Stages, AreMadeAgainInChains) {
  more_ = {stage("third", {"second"})};
  more_.back().is_result = true;
  run();
  for (const char* name : {"first", "second", "third"}) fs::remove(folder_.path(name));
  EXPECT_THAT(run(), ElementsAre("first", "second", "third"));
}

TEST_F(Stages, APartOfAnOutputIsNotTakenForIt) {
  run();
  fs::remove(folder_.path("first"));
  fs::remove(folder_.path("second"));
  breaks_ = "first";
  EXPECT_THROW(run(), Error);
  EXPECT_TRUE(fs::exists(folder_.path("first")));
  breaks_.clear();
  EXPECT_THAT(run(), ElementsAre("first", "second"));
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
  fs::remove(folder_.path("first"));
  EXPECT_THAT(done(), ElementsAre("first", "second"));
  fs::remove(folder_.path("stages/first.textproto"));
  EXPECT_THAT(done(), ElementsAre());  // what it will make is not known
}

TEST_F(Stages, NoneBeginsAfterAStop) {
  std::stop_source stop;
  stop.request_stop();
  expect_error(ErrorKind::kCancelled, {"interrupted"},
               [&] { run("experiment", stop.get_token()); });
  EXPECT_THAT(ran_, ElementsAre());
}

// Ten pieces took 20 seconds: what is left of the second stage takes 2 seconds for each of its
// pieces; of the third nobody knows.
TEST_F(Stages, TellHowLongTheRestTakes) {
  std::vector<Stage> all = stages();
  all.push_back(stage("third", {}));
  all[0].workload = [] { return Workload{"steps", 10, 10, 20}; };
  all[1].workload = [] { return Workload{"steps", 30, 5, 10}; };
  all[2].workload = [] { return Workload{"images", 7, 0, 0}; };
  fails_ = "second";
  EXPECT_ANY_THROW(run());
  const std::vector<StageStatus> status = stage_status(all, folder_.path(), "experiment");
  ASSERT_EQ(status.size(), 3U);
  EXPECT_TRUE(status[0].is_done);
  EXPECT_EQ(status[0].seconds_left, 0);
  EXPECT_FALSE(status[1].is_done);
  EXPECT_EQ(status[1].seconds_left, 50);
  EXPECT_FALSE(status[2].seconds_left.has_value());
}

// Files a second apart, but for a night between them; one is not there.
TEST_F(Stages, PausesBetweenFilesAreLeftOut) {
  std::vector<fs::path> files;
  const fs::file_time_type start = fs::file_time_type::clock::now();
  for (int i = 0; i < 20; ++i) {
    files.push_back(folder_.write(std::to_string(i), ""));
    fs::last_write_time(files.back(), start + std::chrono::seconds(i < 10 ? i : 30000 + i));
  }
  files.push_back(folder_.path("none"));
  const FilesMade made = files_made(files);
  EXPECT_EQ(made.count, 20U);
  EXPECT_NEAR(made.seconds, 20, 1e-6);
  EXPECT_EQ(files_made({}).count, 0U);
}

}  // namespace
}  // namespace itn
