// itn dataset, train and evaluate, as processes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "client/image/image.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ElementsAre;
using namespace testing;
using ::testing::HasSubstr;
using ::testing::Not;

using Arguments = std::vector<std::string>;

Arguments operator+(Arguments a, const Arguments& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

std::string content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

auto line_count(const fs::path& path) {
  const std::string text = content(path);
  return std::ranges::count(text, '\n');
}

// A dataset that all tests train with.
class TrainingCommands : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new TemporaryFolder;
    const Finished finished =
        run(Arguments{testing::kItn, "dataset", shared_->path("data")} + kDatasetFlags);
    ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  }
  static void TearDownTestSuite() { delete shared_; }

  static Arguments train(const std::string& folder, const Arguments& more) {
    return Arguments{
               testing::kItn,     "train", shared_->path("data"), "-o", folder, "--batch", "2",
               "--base-channels", "1",     "--torch-threads",     "1"} +
           more;
  }
  static Arguments resume(const std::string& folder, const Arguments& more = {}) {
    return Arguments{testing::kItn, "train", "--resume", "-o", folder} + more;
  }

  static inline const Arguments kDatasetFlags = {"--count", "8", "--resolution",  "16",
                                                 "--spp",   "1", "--test-shapes", "cube"};
  static inline TemporaryFolder* shared_ = nullptr;
  TemporaryFolder folder_;
};

// --- itn train ---

TEST_F(TrainingCommands, ResumeNeedsNoFlagAgain) {
  // The name of the folder is the model's.
  fs::create_directories(folder_.path("a"));
  fs::create_directories(folder_.path("b"));
  const std::string a = folder_.path("a/run"), b = folder_.path("b/run");
  const Arguments flags = {"--lr", "3e-3", "--seed", "5", "--checkpoint-every", "2"};
  ASSERT_EQ(run(train(a, flags + Arguments{"--steps", "6"})).exit_code, 0);
  ASSERT_EQ(run(train(b, flags + Arguments{"--steps", "3"})).exit_code, 0);
  const Finished resumed = run(resume(b, {"--steps", "6"}));
  ASSERT_EQ(resumed.exit_code, 0) << resumed.errors;
  EXPECT_THAT(resumed.errors, Not(HasSubstr("warning")));  // as of albedos out of reach
  EXPECT_EQ(content(b + "/checkpoint.itn"), content(a + "/checkpoint.itn"));
  // It has nothing to do any more.
  EXPECT_THAT(run(resume(b)).output, HasSubstr("finished already"));
  EXPECT_EQ(run(train(b, flags + Arguments{"--steps", "6"})).exit_code, 0);
}

// Under their names of 0.1, too.
TEST_F(TrainingCommands, FlagsHaveSeveralNames) {
  const auto config = [](const Arguments& flags) {
    const Finished finished = run(Arguments{testing::kItn, "train", "--print-config"} + flags);
    EXPECT_EQ(finished.exit_code, 0) << finished.errors;
    return finished.output;
  };
  const std::string now =
      config({"--learning-rate", "0.002", "--add-noise", "5%", "0.2", "--loss", "itn",
              "--pixel-weights", "uniform", "--first-order-step", "0.3"});
  EXPECT_THAT(now, AllOf(HasSubstr("learning_rate: 0.002"), HasSubstr("min: 0.05"),
                         HasSubstr("max: 0.2"), HasSubstr("UNIFORM"), HasSubstr("0.3")));
  EXPECT_EQ(config({"--lr", "0.002", "--noise", "0.05", "0.2", "--loss", "itn", "--image-weights",
                    "uniform", "--material-step", "0.3"}),
            now);
}

// The last one counts.
TEST_F(TrainingCommands, SwitchesTurnOnAndOff) {
  const auto mirrors = [](const Arguments& flags) {
    const Finished finished = run(Arguments{testing::kItn, "train", "--print-config"} + flags);
    EXPECT_EQ(finished.exit_code, 0) << finished.errors;
    return finished.output.find("mirror: true") != std::string::npos;
  };
  EXPECT_TRUE(mirrors({"--mirror"}));
  EXPECT_TRUE(mirrors({"--no-mirror", "--mirror"}));
  EXPECT_FALSE(mirrors({"--mirror", "--no-mirror"}));
  EXPECT_FALSE(mirrors({"--mirror=false"}));
  EXPECT_EQ(run({testing::kItn, "train", "--print-config", "--mirror=maybe"}).exit_code, 2);
  const auto materials = [](const std::string& flag) {
    return run({testing::kItn, "dataset", "--print-config", flag}).output;
  };
  EXPECT_THAT(materials("--grid"), HasSubstr("GRID"));
  EXPECT_THAT(materials("--grid=false"), Not(HasSubstr("GRID")));
}

TEST_F(TrainingCommands, ResumeRefusesAFlagThatDiffers) {
  const std::string run_folder = folder_.path("run");
  ASSERT_EQ(run(train(run_folder, {"--steps", "2"})).exit_code, 0);
  struct Row {
    Arguments flags;
    std::string message;
  };
  const Row rows[] = {{{"--batch", "3"}, "batch: 2 -> 3"},
                      {{"--lr", "0.5"}, "learning_rate: 0.0001 -> 0.5"},
                      {{"--seed", "1"}, "seed: 1"},
                      {{"--loss", "itn"}, "loss: RN -> ITN"},
                      {{"--steps", "1"}, "has taken 2 steps; 1 are fewer"}};
  for (const Row& row : rows) {
    const Finished finished = run(resume(run_folder, row.flags));
    EXPECT_EQ(finished.exit_code, 3);
    EXPECT_THAT(finished.errors, HasSubstr(row.message));
  }
  // Without --resume flags mean what they mean for a new run.
  const Finished other = run({testing::kItn, "train", shared_->path("data"), "-o", run_folder});
  EXPECT_EQ(other.exit_code, 3);
  EXPECT_THAT(other.errors, AllOf(HasSubstr("batch: 2 -> 60"), HasSubstr("--resume")));
}

TEST_F(TrainingCommands, ResumeSaysWhatItMisses) {
  const Finished nothing = run(resume(folder_.path("run")));
  EXPECT_EQ(nothing.exit_code, 4);
  EXPECT_THAT(nothing.errors, HasSubstr("there is no run in " + folder_.path("run")));
  EXPECT_FALSE(fs::exists(folder_.path("run")));
  fs::copy(shared_->path("data"), folder_.path("data"), fs::copy_options::recursive);
  ASSERT_EQ(run({testing::kItn, "train", folder_.path("data"), "-o", folder_.path("run"), "--batch",
                 "2", "--base-channels", "1", "--steps", "2"})
                .exit_code,
            0);
  fs::rename(folder_.path("data"), folder_.path("moved"));
  const Finished moved = run(resume(folder_.path("run"), {"--steps", "3"}));
  EXPECT_EQ(moved.exit_code, 4);
  EXPECT_THAT(moved.errors, HasSubstr(folder_.path("data")));
  EXPECT_EQ(run({testing::kItn, "train", folder_.path("moved"), "--resume", "-o",
                 folder_.path("run"), "--steps", "3"})
                .exit_code,
            0);
}

// 130: the same command continues.
TEST_F(TrainingCommands, ContinuesAfterAnInterruptionByTheSameCommand) {
  const std::string run_folder = folder_.path("run");
  const Arguments command = train(run_folder, {"--steps", "1000000"});
  for (int i = 0; i < 2; ++i) {
    const auto before = line_count(run_folder + "/metrics.jsonl");
    Process process(command, true);
    ASSERT_TRUE(eventually([&] { return line_count(run_folder + "/metrics.jsonl") > before + 2; }));
    process.send(SIGINT);
    EXPECT_THAT(process.read_stderr(), HasSubstr("the same command continues"));
    EXPECT_EQ(process.wait(), 130);
    EXPECT_GT(line_count(run_folder + "/metrics.jsonl"), before + 2);
  }
}

TEST_F(TrainingCommands, OfTwoInOneFolderTheSecondIsRefused) {
  const std::string run_folder = folder_.path("run");
  const Arguments command = train(run_folder, {"--steps", "1000000"});
  Process first(command, true);
  ASSERT_TRUE(eventually([&] { return line_count(run_folder + "/metrics.jsonl") > 2; }));
  const Finished second = run(command);
  EXPECT_EQ(second.exit_code, 4);
  EXPECT_THAT(second.errors,
              AllOf(HasSubstr(run_folder + " is in use by process"), HasSubstr("itn train")));
  // A killed process holds nobody up.
  first.send(SIGKILL);
  EXPECT_EQ(first.wait(), -SIGKILL);
  const auto taken = line_count(run_folder + "/metrics.jsonl");
  const Finished third = run(train(folder_.path("other"), {"--steps", "1"}));
  EXPECT_EQ(third.exit_code, 0) << third.errors;
  Process fourth(command, true);
  ASSERT_TRUE(eventually([&] { return line_count(run_folder + "/metrics.jsonl") != taken; }));
  fourth.send(SIGINT);
  fourth.read_stderr();
  EXPECT_EQ(fourth.wait(), 130);
}

TEST_F(TrainingCommands, ChecksItsFlagsBeforeAnythingElse) {
  for (const char* rate : {"-1", "0", "nan", "inf", "fast"}) {
    const Finished finished = run(train(folder_.path("run"), {"--lr", rate}));
    EXPECT_EQ(finished.exit_code, 2) << rate;
    EXPECT_THAT(finished.errors,
                AllOf(HasSubstr("itn: --learning-rate: "), HasSubstr("is not a number in (0, "),
                      Not(HasSubstr("frame #"))));
  }
  const Finished steps = run(train(folder_.path("run"), {"--steps", "0"}));
  EXPECT_EQ(steps.exit_code, 2);
  EXPECT_LT(steps.errors.size(), 200) << steps.errors;
  EXPECT_FALSE(fs::exists(folder_.path("run")));
}

TEST_F(TrainingCommands, ADivergedRunFailsAndKeepsNoCheckpoint) {
  const Finished finished = run(train(folder_.path("run"), {"--steps", "9", "--lr", "1e15"}));
  EXPECT_EQ(finished.exit_code, 3);
  EXPECT_THAT(finished.errors, AllOf(HasSubstr("has diverged"), HasSubstr("--learning-rate")));
  EXPECT_FALSE(fs::exists(folder_.path("run/checkpoint.itn")));
}

TEST_F(TrainingCommands, ADamagedCheckpointIsNamedAndThePreviousOffered) {
  const std::string run_folder = folder_.path("run");
  ASSERT_EQ(run(train(run_folder, {"--steps", "4", "--checkpoint-every", "2"})).exit_code, 0);
  const std::string checkpoint = run_folder + "/checkpoint.itn";
  fs::resize_file(checkpoint, fs::file_size(checkpoint) / 2);
  const std::string offer = "mv " + run_folder + "/checkpoint.previous.itn " + checkpoint;
  for (const Arguments& command :
       {resume(run_folder),
        Arguments{testing::kItn, "evaluate", run_folder, "--dataset", shared_->path("data")}}) {
    const Finished finished = run(command);
    EXPECT_EQ(finished.exit_code, 6);
    EXPECT_THAT(finished.errors, AllOf(HasSubstr(checkpoint + " is damaged"),
                                       HasSubstr("at step 2"), HasSubstr(offer)));
  }
  fs::rename(run_folder + "/checkpoint.previous.itn", checkpoint);
  EXPECT_EQ(run(resume(run_folder)).exit_code, 0);
}

TEST_F(TrainingCommands, EvaluateFindsAnUnwritablePictureFirst) {
  const std::string run_folder = folder_.path("run");
  ASSERT_EQ(run(train(run_folder, {"--steps", "1"})).exit_code, 0);
  const Finished finished =
      run({testing::kItn, "evaluate", run_folder, "--dataset", shared_->path("data"), "--picture",
           folder_.path("none/picture.png")});
  EXPECT_EQ(finished.exit_code, 4);
  EXPECT_EQ(finished.output, "");
  EXPECT_THAT(finished.errors, HasSubstr("none/picture.png"));
  const Finished written =
      run({testing::kItn, "evaluate", run_folder, "--dataset", shared_->path("data"), "--spp", "1",
           "--picture", folder_.path("picture.png"), "--split", "train", "--examples", "2"});
  EXPECT_EQ(written.exit_code, 0) << written.errors;
  EXPECT_TRUE(fs::exists(folder_.path("picture.png")));
  EXPECT_THAT(written.output,
              AllOf(HasSubstr("train images"), HasSubstr("images/000000.exr:  sigma_t "),
                    HasSubstr(", truth ")));
}

// --- itn dataset ---

TEST_F(TrainingCommands, ADatasetIsContinuedByItsFolderAlone) {
  const std::string data = folder_.path("data");
  fs::copy(shared_->path("data"), data, fs::copy_options::recursive);
  fs::remove(data + "/images/000003.exr");
  const Finished again = run({testing::kItn, "dataset", data, "--json"});
  ASSERT_EQ(again.exit_code, 0) << again.errors;
  EXPECT_THAT(again.output, HasSubstr("\"kept\":7"));
  EXPECT_EQ(content(data + "/images/000003.exr"), content(shared_->path("data/images/000003.exr")));
  // The command that began it.
  EXPECT_THAT(run(Arguments{testing::kItn, "dataset", data, "--json"} + kDatasetFlags).output,
              HasSubstr("\"kept\":8"));
  const Finished other = run({testing::kItn, "dataset", data, "--spp", "2"});
  EXPECT_EQ(other.exit_code, 3);
  EXPECT_THAT(other.errors, HasSubstr("spp: 1 -> 2"));
}

// By the command that began it, by its folder alone, with more images; without the panoramas.
TEST_F(TrainingCommands, ADatasetUnderPanoramasIsContinued) {
  fs::create_directories(folder_.path("panoramas"));
  for (const char* name : {"a", "b", "c"}) {
    Image map{.width = 8, .height = 4, .channels = {}, .attributes = {}};
    map.channels["Y"].assign(32, 1);
    map.channels["Y"][5] = 100;
    write_exr(folder_.path("panoramas/" + std::string(name) + ".exr"), map);
  }
  folder_.write("panoramas/d.exr", "not an image");
  const std::string data = folder_.path("data");
  const Arguments begin =
      Arguments{testing::kItn, "dataset",      data, "--json",  "--preset", "studio",  "--spp",
                "1",           "--resolution", "16", "--count", "8",        "--shapes"} +
      Arguments{folder_.path("meshes")};
  const Arguments with = {"--panoramas", folder_.path("panoramas")};
  fs::create_directories(folder_.path("meshes"));
  for (const char* name : {"x", "y", "z"}) {
    folder_.write("meshes/" + std::string(name) + ".obj",
                  "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
  }
  const Finished first = run(begin + with);
  ASSERT_EQ(first.exit_code, 0) << first.errors;
  EXPECT_THAT(first.output, AllOf(HasSubstr("refused_panoramas"), HasSubstr("d.exr")));
  EXPECT_THAT(first.errors, HasSubstr("d.exr"));
  EXPECT_THAT(content(data + "/manifest.textproto"), HasSubstr("file: \"panoramas/c.map\""));
  EXPECT_THAT(run(begin + with).output, HasSubstr("\"kept\":8"));
  const Finished without = run(begin);
  EXPECT_EQ(without.exit_code, 3);
  EXPECT_THAT(without.errors, HasSubstr("panoramas"));
  const Arguments more = {testing::kItn, "dataset", data, "--json", "--count"};
  EXPECT_THAT(run(more + Arguments{"9"} + with).output, HasSubstr("\"kept\":8"));
  // What was lost comes back with its folder.
  const std::string map = content(data + "/panoramas/b.map");
  fs::remove(data + "/panoramas/b.map");
  EXPECT_THAT(run(more + Arguments{"9"} + with).output, HasSubstr("\"kept\":9"));
  EXPECT_EQ(content(data + "/panoramas/b.map"), map);
  fs::remove_all(folder_.path("panoramas"));
  fs::remove_all(folder_.path("meshes"));
  const Finished alone = run(more + Arguments{"12"});
  EXPECT_EQ(alone.exit_code, 0) << alone.errors;
  EXPECT_THAT(alone.output, HasSubstr("\"kept\":9"));
}

TEST_F(TrainingCommands, ADatasetWithAReversedRangeIsRefused) {
  const Finished finished =
      run({testing::kItn, "dataset", folder_.path("data"), "--sigma-t", "300", "30"});
  EXPECT_EQ(finished.exit_code, 3);
  EXPECT_THAT(finished.errors,
              HasSubstr("range of sigma_t is [300, 30]; its minimum must not exceed"));
  EXPECT_FALSE(fs::exists(folder_.path("data")));
}

TEST_F(TrainingCommands, ADatasetOfManyShapesIsSummarised) {
  const char* tetrahedron =
      "v 0 0 0\nv 2 0 0\nv 0 2 0\nv 0 0 2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
  fs::create_directories(folder_.path("meshes"));
  for (int i = 0; i < 120; ++i) {
    std::ofstream(folder_.path("meshes/mesh" + std::to_string(i) + ".obj")) << tetrahedron;
  }
  const Finished finished =
      run({testing::kItn, "dataset", folder_.path("data"), "--shapes", folder_.path("meshes"),
           "--count", "4", "--resolution", "16", "--spp", "1", "--validation-fraction", "0.2"});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output,
              AllOf(HasSubstr("2 training images of 66 shapes"),
                    HasSubstr("1 validation images of 24 shapes"),
                    HasSubstr("1 test images of 30 shapes"), Not(HasSubstr("mesh1"))));
}

// --- In colour ---

// A network that has learned from three colours together answers about a photograph of them.
TEST_F(TrainingCommands, LearnFromADatasetInColour) {
  const std::string config = folder_.write(
      "colour.textproto",
      "count: 8 resolution: 16 spp: 2 test_shapes: \"cube\" materials { colours {} }");
  const std::string data = folder_.path("colour"), trained = folder_.path("run");
  const Finished rendered = run({testing::kItn, "dataset", data, "--config", config});
  ASSERT_EQ(rendered.exit_code, 0) << rendered.errors;
  const Arguments train = {testing::kItn, "train",           data, "-o",      trained, "--batch",
                           "2",           "--base-channels", "4",  "--steps", "2"};
  const Finished refused = run(train);
  EXPECT_EQ(refused.exit_code, 3);
  EXPECT_THAT(refused.errors, HasSubstr("in colour, which takes the input RATIOS"));
  const Finished learned = run(train + Arguments{"--preset", "residual", "--exposure", "unknown"});
  ASSERT_EQ(learned.exit_code, 0) << learned.errors;
  const Finished evaluated = run({testing::kItn, "evaluate", trained, "--dataset", data,
                                  "--examples", "1", "--rerender", "1", "--spp", "2"});
  ASSERT_EQ(evaluated.exit_code, 0) << evaluated.errors;
  EXPECT_THAT(evaluated.output, HasSubstr(".exr B:  sigma_t"));
  const Finished predicted = run({testing::kItn, "predict", data + "/images/000000.exr", "--model",
                                  trained, "--format", "csv"});
  ASSERT_EQ(predicted.exit_code, 0) << predicted.errors;
  EXPECT_EQ(std::ranges::count(predicted.output, '\n'), 4) << predicted.output;
  // A dataset of the other kind says nothing of the model.
  const Finished exported = run({testing::kItn, "export", trained, "-o", folder_.path("m.itn"),
                                 "--dataset", shared_->path("data")});
  EXPECT_EQ(exported.exit_code, 3) << exported.errors;
  EXPECT_THAT(exported.errors, HasSubstr("in colour; those of the dataset have one"));
  const Finished gray =
      run({testing::kItn, "predict", shared_->path("data/images/000000.exr"), "--model", trained});
  EXPECT_EQ(gray.exit_code, 3);
  EXPECT_THAT(gray.errors, HasSubstr("photographs in colour; this one has one channel"));
}

}  // namespace
}  // namespace itn
