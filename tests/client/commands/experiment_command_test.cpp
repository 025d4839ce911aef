// itn experiment, as a process: the smallest one from its dataset to its report.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::Each;
using namespace testing;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
using ::testing::Truly;

// Torch's sums depend on its threads in the last bits.
const std::vector<std::string> kSmoke = {testing::kItn,     "experiment", "--preset", "smoke",
                                         "--torch-threads", "1",          "-o"};

std::vector<std::string> smoke(const std::string& folder) {
  std::vector<std::string> arguments = kSmoke;
  arguments.push_back(folder);
  return arguments;
}

std::string content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// But for the row of the network that takes as many steps as there was time for.
std::string but_for_the_timed(const std::string& table) {
  std::istringstream lines(table);
  std::string kept;
  for (std::string line; std::getline(lines, line);) {
    if (line.find("time of ITN") == std::string::npos) kept += line + '\n';
  }
  return kept;
}

// But for the last columns, which are processor times.
std::string but_for_times(const std::string& table_3) {
  std::istringstream lines(table_3);
  std::string kept;
  for (std::string line; std::getline(lines, line);) {
    for (int column = 0; column < 6; ++column) line.resize(line.rfind(','));
    kept += line + '\n';
  }
  return kept;
}

std::vector<std::string> lines_of(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> lines;
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

// In each folder one that a killed process had begun to write.
std::vector<fs::path> files_begun_below(const fs::path& folder) {
  std::vector<fs::path> folders{folder}, files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_directory()) folders.push_back(entry.path());
  }
  for (const fs::path& each : folders) {
    files.push_back(each / "begun.1-1.tmp");
    std::ofstream(files.back()) << "a part";
  }
  return files;
}

constexpr const char* kTables[] = {"table_1.csv", "table_1_other_noise.csv", "gains.csv",
                                   "by_thickness.csv", "table_2.csv"};

TEST(ExperimentCommand, KilledAndContinuedGivesTheSameTables) {
  const TemporaryFolder folder;
  const Finished whole = run(smoke(folder.path("whole")));
  ASSERT_EQ(whole.exit_code, 0) << whole.errors;
  for (const char* network : {"RN+naive", "ITN+similar+map", "RN+similar, time of ITN",
                              "constant predictor", "published: RN+naive"}) {
    EXPECT_THAT(whole.output, HasSubstr(network));
  }
  // Killed while it trains, renders and refines.
  for (const char* stage :
       {"shared start 1", "images of RN+naive", "refine from RN+naive", "train ITN+naive"}) {
    Process killed(smoke(folder.path("parts")), true);
    ASSERT_THAT(killed.read_stderr_until(stage), HasSubstr(stage));
    killed.send(SIGKILL);
    killed.wait();
  }
  const std::vector<fs::path> unfinished = files_begun_below(folder.path("parts"));
  EXPECT_GT(unfinished.size(), 5U);
  const Finished continued = run(smoke(folder.path("parts")));
  EXPECT_THAT(unfinished, Each(Truly([](const fs::path& file) { return !fs::exists(file); })));
  ASSERT_EQ(continued.exit_code, 0) << continued.errors;
  EXPECT_THAT(continued.errors, HasSubstr("train RN+naive: done before"));
  for (const char* table : kTables) {
    const std::string expected = but_for_the_timed(content(folder.path("whole") + "/" + table));
    EXPECT_GT(expected.size(), 200U) << table;
    EXPECT_EQ(but_for_the_timed(content(folder.path("parts") + "/" + table)), expected) << table;
  }
  const auto table_3 = [&](const char* run) {
    return but_for_the_timed(but_for_times(content(folder.path(run) + "/table_3.csv")));
  };
  EXPECT_THAT(table_3("whole"), HasSubstr("ITN+similar+map,no,"));
  EXPECT_EQ(table_3("parts"), table_3("whole"));
  EXPECT_THAT(content(folder.path("whole/training.csv")),
              AllOf(StartsWith("name"), HasSubstr("shared steps"), HasSubstr("\nRN+naive,")));
  const std::string page = content(folder.path("whole/report.md"));
  EXPECT_THAT(page, HasSubstr("| ITN+similar+map | "));
  for (const char* picture : {"scenes", "colours", "novel", "refinement", "training"}) {
    const std::string file = std::string("report/") + picture + ".png";
    EXPECT_THAT(page, HasSubstr("](" + file + ")"));
    EXPECT_GT(content(folder.path("whole/" + file)).size(), 500U) << file;
  }
  // Once more, all is there.
  const Finished again = run(smoke(folder.path("whole")));
  EXPECT_EQ(again.output, whole.output);
  EXPECT_THAT(again.errors, Not(HasSubstr("steps/s")));
  std::vector<std::string> status = smoke(folder.path("whole"));
  status.push_back("--status");
  EXPECT_THAT(run(status).output,
              AllOf(HasSubstr("dataset: done, 0.0"), HasSubstr("train ITN+similar+map: done, 0.0"),
                    HasSubstr("\n0.0 h left\n")));
  // Of results alone the same tables are made, with stages and without.
  const std::string results = folder.path("results");
  fs::create_directory(results);
  for (const char* kept : {"experiment.textproto", "test.textproto", "learning_rate.textproto",
                           "answers", "image_errors", "refinements", "stages"}) {
    fs::copy(folder.path("whole/") + kept, results + "/" + kept);  // no folders in folders
  }
  const Finished tables = run({testing::kItn, "experiment", "--tables", "-o", results});
  ASSERT_EQ(tables.exit_code, 0) << tables.errors;
  EXPECT_THAT(whole.output, StartsWith(tables.output));
  EXPECT_GT(tables.output.size(), 2000U);
  const Finished kept = run(smoke(results));
  EXPECT_THAT(kept.output, StartsWith(tables.output));
  EXPECT_THAT(kept.output, HasSubstr("The images are gone"));
  EXPECT_THAT(lines_of(kept.errors), Each(HasSubstr("done before")));
  // A network that is asked once more takes its dataset and its weights again.
  fs::remove(results + "/answers/itn_naive.textproto");
  const Finished without = run({testing::kItn, "experiment", "--tables", "-o", results});
  EXPECT_THAT(without.output, Not(HasSubstr("ITN+naive")));
  EXPECT_THAT(without.errors, HasSubstr("itn_naive.textproto is missing: the tables have no row"));
  const Finished again_asked = run(smoke(results));
  // Table 3 has times of refinements, which were made again.
  const std::string but_for_table_3 = tables.output.substr(0, tables.output.find("\nTable 3"));
  EXPECT_GT(but_for_table_3.size(), 2000U);
  EXPECT_THAT(again_asked.output, StartsWith(but_for_table_3));
  EXPECT_THAT(again_asked.errors,
              AllOf(HasSubstr("] dataset 60/60"), HasSubstr("train RN+naive: done before"),
                    HasSubstr("train ITN+naive 5/5"), HasSubstr("images of ITN+naive 6/6"),
                    HasSubstr("images of RN+similar: done before")));
  // What only some later stages need, and pictures one by one, are made again, too.
  for (const char* gone :
       {"image_errors/rn_similar.textproto", "images/rn_naive/colour_01.exr", "references"}) {
    EXPECT_GE(fs::remove_all(results + "/" + gone), 1U) << gone;
  }
  fs::create_directory(results + "/references");  // as a report of other images leaves it
  const Finished mended = run(smoke(results));
  EXPECT_EQ(mended.exit_code, 0) << mended.errors;
  EXPECT_THAT(mended.output, StartsWith(but_for_table_3));
  // Results that are not of the experiment are refused.
  const std::string answers = content(results + "/answers/itn_naive.textproto");
  std::ofstream(results + "/answers/itn_naive.textproto")
      << answers.substr(0, answers.find('[') + 1) << "1, " << answers.substr(answers.find('[') + 1);
  const Finished odd = run({testing::kItn, "experiment", "--tables", "-o", results});
  EXPECT_EQ(odd.exit_code, 3);
  EXPECT_THAT(odd.errors, AllOf(HasSubstr("itn_naive.textproto"), HasSubstr("sigma_t has 19"),
                                HasSubstr("there should be 18")));
  const Finished nothing =
      run({testing::kItn, "experiment", "--tables", "-o", folder.path("none")});
  EXPECT_NE(nothing.exit_code, 0);
  EXPECT_THAT(nothing.errors, HasSubstr("experiment.textproto"));
  // Another experiment does not go there.
  const std::string other = content(folder.path("whole/experiment.textproto")) + "\nseed: 7\n";
  const Finished refused =
      run({testing::kItn, "experiment", folder.write("other.textproto", other).string(), "-o",
           folder.path("whole")});
  EXPECT_EQ(refused.exit_code, 3);
  EXPECT_THAT(refused.errors, HasSubstr("another experiment"));
  EXPECT_THAT(refused.errors, HasSubstr("seed"));
}

TEST(ExperimentCommand, PrintsItsPresets) {
  const TemporaryFolder folder;
  const Finished printed =
      run({testing::kItn, "experiment", "--preset", "small", "--print-config"});
  ASSERT_EQ(printed.exit_code, 0) << printed.errors;
  EXPECT_THAT(printed.output, HasSubstr("ITN+similar+map"));
  const fs::path typo = folder.write("typo.textproto", printed.output + "sead: 3\n");
  const Finished refused =
      run({testing::kItn, "experiment", typo.string(), "-o", folder.path("x")});
  EXPECT_EQ(refused.exit_code, 3);
  EXPECT_THAT(refused.errors, HasSubstr("typo.textproto:"));
  EXPECT_THAT(refused.errors, HasSubstr("sead"));
  EXPECT_FALSE(fs::exists(folder.path("x")));
}

TEST(ExperimentCommand, StatusNamesTheStages) {
  const Finished printed = run({testing::kItn, "experiment", "--preset", "smoke", "--status"});
  ASSERT_EQ(printed.exit_code, 0) << printed.errors;
  EXPECT_THAT(printed.output, HasSubstr("\ntrain ITN+similar+map\n"));
  // Another experiment in the folder where it is called has no part in it.
  const TemporaryFolder folder;
  folder.write("experiment.textproto", "seed: 7\n");
  const Finished beside =
      run({"/bin/sh", "-c",
           "cd " + folder.path().string() + " && " + std::string(testing::kItn) +
               " experiment --preset smoke --status"});
  EXPECT_EQ(beside.exit_code, 0) << beside.errors;
  EXPECT_EQ(beside.output, printed.output);
}

// Its steps are many times as dear as those of an RN, by which it would take fifty times as many.
TEST(ExperimentCommand, AnItnAsLongAsAnotherTakesAboutAsManySteps) {
  const TemporaryFolder folder;
  const std::string file =
      run({testing::kItn, "experiment", "--preset", "smoke", "--print-config"}).output;
  const std::string networks = file.substr(0, file.find("networks {")) + R"(
    networks { name: "RN" settings { loss: RN } }
    networks { name: "ITN" settings { loss: ITN spp: 512 } }
    networks { name: "ITN, as long" settings { loss: ITN spp: 512 } as_long_as: "ITN" })";
  const Finished finished =
      run({testing::kItn, "experiment", folder.write("e.textproto", networks).string(),
           "--torch-threads", "1", "-o", folder.path("run")});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  std::ifstream cost(folder.path("run/networks/itn_as_long/cost.textproto"));
  std::string name;
  int steps = 0;
  cost >> name >> steps;
  ASSERT_EQ(name, "steps:");
  EXPECT_GE(steps, 1);
  EXPECT_LE(steps, 20);  // of 5
}

// Nothing that was done before says what its steps cost.
TEST(ExperimentCommand, AnRnAsLongAsAnotherNeedsNoSharedStart) {
  const TemporaryFolder folder;
  std::string file =
      run({testing::kItn, "experiment", "--preset", "smoke", "--print-config"}).output;
  file.resize(file.find("networks {"));
  const std::string shared = "shared_steps: 30";
  ASSERT_THAT(file, HasSubstr(shared));
  file.replace(file.find(shared), shared.size(), "");
  file += R"(
    networks { name: "ITN" settings { loss: ITN spp: 64 } }
    networks { name: "RN, as long" settings { loss: RN } as_long_as: "ITN" })";
  const Finished finished =
      run({testing::kItn, "experiment", folder.write("e.textproto", file).string(),
           "--torch-threads", "1", "-o", folder.path("run")});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, HasSubstr("RN, as long"));
}

}  // namespace
}  // namespace itn
