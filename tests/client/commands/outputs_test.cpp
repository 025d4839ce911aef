// What itn writes, where, and what it says when it cannot; and that only the commands that need a
// network load LibTorch.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "client/image/image.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/scene_files.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using namespace testing;
using ::testing::HasSubstr;
using ::testing::Not;

using Arguments = std::vector<std::string>;

Arguments render(const std::string& scene, const std::string& output, const Arguments& more = {},
                 const std::string& spp = "2") {
  Arguments command = {testing::kItn, "render",   scene, "-o",    output, "--sigma-t",
                       "5",           "--albedo", "0.9", "--spp", spp};
  command.insert(command.end(), more.begin(), more.end());
  return command;
}

// With redirections, pipes and the like.
Finished shell(const std::string& command) {
  return run({"/bin/bash", "-c", "itn() { \"" + testing::kItn + "\" \"$@\"; }; " + command});
}

// --- Outputs that are no regular file ---

class Outputs : public ::testing::Test {
 protected:
  Outputs() { folder_.write("scene.textproto", kSceneFile); }

  std::string scene() const { return folder_.path("scene.textproto"); }
  std::string flags() const { return " --sigma-t 5 --albedo 0.9 --spp 2 "; }

  TemporaryFolder folder_;
};

TEST_F(Outputs, GoThroughLinks) {
  fs::create_directory(folder_.path("far"));
  fs::create_symlink("far/real.exr", folder_.path("out.exr"));
  for (int i = 0; i < 2; ++i) {  // dangling at first
    const Finished finished = run(render(scene(), folder_.path("out.exr")));
    ASSERT_EQ(finished.exit_code, 0) << finished.errors;
    EXPECT_TRUE(fs::is_symlink(folder_.path("out.exr")));
    EXPECT_EQ(read_exr(folder_.path("far/real.exr")).width, 16);
  }
}

TEST_F(Outputs, GoIntoDevicesAndLeaveThem) {
  int controller = -1, terminal = -1;
  ASSERT_EQ(::openpty(&controller, &terminal, nullptr, nullptr, nullptr), 0);
  const std::string name = ::ttyname(terminal);
  // The terminal's buffer is small, so somebody has to read.
  std::string read;
  std::thread reader([&] {
    char buffer[4096];
    for (ssize_t n = 0; (n = ::read(controller, buffer, sizeof buffer)) > 0;) {
      read.append(buffer, static_cast<size_t>(n));
    }
  });
  const Finished finished = run(render(scene(), name));
  ::close(terminal);
  reader.join();
  ::close(controller);
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_EQ(read.substr(0, 4), "\x76\x2f\x31\x01");
}

TEST_F(Outputs, GoToStandardOutputAndFifos) {
  ASSERT_EQ(::mkfifo(folder_.path("fifo").c_str(), 0600), 0);
  const Finished piped =
      shell("itn render " + scene() + flags() + "-o - > " + folder_.path("a.exr"));
  ASSERT_EQ(piped.exit_code, 0) << piped.errors;
  EXPECT_THAT(piped.errors,
              AllOf(HasSubstr("mean radiance"), HasSubstr("standard output: 16 x 12 pixels")));
  const Finished full = shell("itn render " + scene() + flags() + "-o - > /dev/full");
  EXPECT_EQ(full.exit_code, 4);
  EXPECT_THAT(full.errors, HasSubstr("cannot write standard output: No space left"));
  const Finished fifo =
      shell("cat " + folder_.path("fifo") + " > " + folder_.path("b.exr") + " & itn render " +
            scene() + flags() + "-o " + folder_.path("fifo") + " && wait");
  ASSERT_EQ(fifo.exit_code, 0) << fifo.errors;
  EXPECT_EQ(read_exr(folder_.path("a.exr")).channels, read_exr(folder_.path("b.exr")).channels);
  EXPECT_TRUE(fs::is_fifo(folder_.path("fifo")));
}

TEST_F(Outputs, ScenesComeFromStandardInput) {
  const Finished finished =
      shell("itn render -" + flags() + "-o " + folder_.path("out.exr") + " < " + scene());
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
}

// --- Found before the work ---

TEST_F(Outputs, ThatCannotBeWrittenAreFoundBeforeTheWork) {
  const struct {
    std::string flag, value, message;
    int exit_code;
  } rows[] = {
      {"-o", folder_.path("no/out.exr"), "No such file", 4},
      {"-o", folder_.path(""), "it is a folder", 4},
      {"--png", folder_.path("no/out.png"), "No such file", 4},
      {"-o", folder_.path("out.png"), "written as OpenEXR, name it .exr; --picture", 2},
      {"-o", folder_.path("out.JPG"), "written as OpenEXR", 2},
      {"-o", scene(), "name it .exr", 2},
      {"-o", folder_.path("mesh.ply"), "name it .exr", 2},
      {"--png", folder_.path("out.exr"), "written as PNG", 2},
      {"--png", folder_.path("out.jpg"), "written as PNG", 2},
      {"--png", folder_.path("out"), "a file of its own", 2},
  };
  for (const auto& row : rows) {
    // Takes days, unless what is wrong is found first.
    Arguments more = {"--film", "512x512", "--threads", "1"};
    const bool output = row.flag == "-o";
    if (!output) more.insert(more.end(), {row.flag, row.value});
    const Finished finished =
        run(render(scene(), output ? row.value : folder_.path("out"), more, "1000000"));
    EXPECT_EQ(finished.exit_code, row.exit_code) << row.value << finished.errors;
    EXPECT_THAT(finished.errors, HasSubstr(row.message));
  }
}

TEST_F(Outputs, AnImageIsNotPouredIntoATerminal) {
  int controller = -1, terminal = -1;
  ASSERT_EQ(::openpty(&controller, &terminal, nullptr, nullptr, nullptr), 0);
  const Finished finished =
      shell("itn render " + scene() + flags() + "-o - > " + ::ttyname(terminal));
  ::close(terminal);
  ::close(controller);
  EXPECT_EQ(finished.exit_code, 4);
  EXPECT_THAT(finished.errors, HasSubstr("is a terminal"));
}

TEST_F(Outputs, OfOtherCommandsAreFoundBeforeTheWorkToo) {
  folder_.write("file", "");
  const struct {
    Arguments command;
    const char* message;
  } rows[] = {
      {{testing::kItn, "dataset", folder_.path("file/data"), "--count", "100000"},
       "file is not a folder"},
      {{testing::kItn, "train", folder_.path("data"), "-o", folder_.path("file/run")},
       "file is not a folder"},
      {{testing::kItn, "evaluate", folder_.path("run"), "--dataset", folder_.path("data"),
        "--picture", folder_.path("no/picture.png")},
       "no/picture.png: No such file"},
  };
  for (const auto& row : rows) {
    const Finished finished = run(row.command);
    EXPECT_EQ(finished.exit_code, 4) << finished.errors;
    EXPECT_THAT(finished.errors, HasSubstr(row.message));
  }
}

TEST_F(Outputs, ATableIsNotLostWithItsPicture) {
  // Full, as /dev/full; a node of its own, as the machine needs that one.
  const std::string full = folder_.path("full");
  if (::mknod(full.c_str(), S_IFCHR | 0600, makedev(1, 7)) != 0) {
    GTEST_SKIP() << "device nodes cannot be created here";
  }
  const std::string data = folder_.path("data"), model = folder_.path("run");
  for (const Arguments& command : {Arguments{testing::kItn, "dataset", data, "--count", "8",
                                             "--resolution", "16", "--spp", "1"},
                                   Arguments{testing::kItn, "train", data, "-o", model, "--steps",
                                             "1", "--batch", "2", "--base-channels", "1"}}) {
    const Finished finished = run(command);
    ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  }
  const Finished finished = run({testing::kItn, "evaluate", model, "--dataset", data, "--spp", "1",
                                 "--picture", full, "--picture-items", "1"});
  EXPECT_EQ(finished.exit_code, 4);
  EXPECT_THAT(finished.errors, HasSubstr("full: No space left"));
  EXPECT_THAT(finished.output, HasSubstr("constant predictor"));
  EXPECT_TRUE(fs::is_character_file(full));
}

// --- stdout ---

TEST_F(Outputs, AResultThatCannotBePrintedIsAnError) {
  for (const std::string& command :
       {std::string("shapes"), std::string("--version"),
        "render " + scene() + flags() + "--json -o " + folder_.path("out.exr")}) {
    const Finished full = shell("itn " + command + " > /dev/full");
    EXPECT_EQ(full.exit_code, 4) << command;
    EXPECT_THAT(full.errors, HasSubstr("the result to standard output: ")) << command;
    const Finished closed = shell("itn " + command + " >&-");
    EXPECT_EQ(closed.exit_code, 4) << command;
  }
}

TEST_F(Outputs, NamesOfStrangersDoNotSteerTheTerminal) {
  const Finished finished = run(render(folder_.path("\x1b[2J.textproto"), folder_.path("out.exr")));
  EXPECT_EQ(finished.exit_code, 4);
  EXPECT_THAT(finished.errors, HasSubstr("\\x1b[2J.textproto"));
  EXPECT_THAT(finished.errors, Not(HasSubstr("\x1b")));
}

TEST_F(Outputs, QuietShowsNoProgress) {
  EXPECT_THAT(run(render(scene(), folder_.path("out.exr"))).errors, HasSubstr("rendering"));
  for (const char* flag : {"-q", "--quiet"}) {
    const Finished finished = run(render(scene(), folder_.path("out.exr"), {flag}));
    EXPECT_EQ(finished.exit_code, 0);
    EXPECT_EQ(finished.errors, "");
    EXPECT_THAT(finished.output, HasSubstr("mean radiance"));
  }
}

// The server in the process is quiet, too, which stops with renders under way.
TEST_F(Outputs, QuietLogsNothingWhenInterrupted) {
  Arguments command = render(scene(), folder_.path("out.exr"),
                             {"-q", "--film", "512x512", "--threads", "1"}, "1000000");
  testing::Process process(command, true);
  ASSERT_TRUE(testing::eventually([&] { return process.cpu_seconds() > 2; }));
  process.send(SIGTERM);
  EXPECT_EQ(process.read_stderr(), "itn: interrupted\n");
  EXPECT_EQ(process.wait(), 130);
}

TEST_F(Outputs, SayThatTheCameraDoesNotSeeTheObject) {
  const struct {
    const char *from, *to, *message;
  } rows[] = {
      {"target { y: 0.5 }", "target { y: 9 }", "does not see the object: it is in no pixel"},
      {"mesh { builtin: \"cube\" }",
       "mesh { builtin: \"cube\" transforms { scale { x: 2e-4 y: 2e-4 z: 2e-4 } } }", "see"},
      {"fov_degrees: 22 }\nfilm { width: 16 height: 12 }",
       "fov_degrees: 170 }\nfilm { width: 256 height: 192 }", "hardly sees the object"},
  };
  for (const auto& row : rows) {
    const auto file = folder_.write("other.textproto", replaced(kSceneFile, row.from, row.to));
    const Finished finished = run(render(file, folder_.path("out.exr")));
    EXPECT_EQ(finished.exit_code, 0) << finished.errors;
    EXPECT_THAT(finished.errors, HasSubstr(row.message)) << row.to;
  }
  EXPECT_THAT(run(render(scene(), folder_.path("out.exr"))).errors, Not(HasSubstr("the camera")));
}

// --- Two programs ---

TEST(Programs, OnlyTheLearningOneLoadsLibTorch) {
  EXPECT_THAT(run({"/usr/bin/ldd", testing::kItn}).output, Not(HasSubstr("torch")));
  EXPECT_THAT(run({"/usr/bin/ldd", testing::kItnLearn}).output, HasSubstr("torch"));
}

TEST(Programs, ItnRunsTheLearningOneBesideIt) {
  const TemporaryFolder folder;
  // Through a link, as package managers make them.
  fs::create_symlink(testing::kItn, folder.path("itn"));
  const Finished linked = run({folder.path("itn"), "train", "--print-config"});
  EXPECT_EQ(linked.exit_code, 0) << linked.errors;
  EXPECT_THAT(linked.output, HasSubstr("architecture"));
  // The programs lie as installed on a machine that has both, and on one that has not.
  fs::remove(folder.path("itn"));
  fs::copy_file(testing::kItn, folder.path("itn"));
  const Finished alone = run({folder.path("itn"), "train", "data", "-o", "run"});
  EXPECT_EQ(alone.exit_code, 4);
  EXPECT_THAT(alone.errors, HasSubstr("itn-learn: No such file or directory"));
  EXPECT_EQ(run({folder.path("itn"), "shapes"}).exit_code, 0);
  fs::copy_file(testing::kItnLearn, folder.path("itn-learn"));
  EXPECT_EQ(run({folder.path("itn"), "train", "--print-config"}).exit_code, 0);
}

TEST(Programs, HelpAndMistakesNeedNoLearningOne) {
  const TemporaryFolder folder;
  fs::copy_file(testing::kItn, folder.path("itn"));
  const Finished help = run({folder.path("itn"), "train", "--help"});
  EXPECT_EQ(help.exit_code, 0) << help.errors;
  EXPECT_THAT(help.output, HasSubstr("--checkpoint-every"));
  const Finished mistaken = run({folder.path("itn"), "predict", "a.jpg", "--maks", "b.png"});
  EXPECT_EQ(mistaken.exit_code, 2);
  EXPECT_THAT(mistaken.errors, HasSubstr("did you mean --mask?"));
  const Finished completion = run({folder.path("itn"), "completion", "bash"});
  EXPECT_EQ(completion.exit_code, 0) << completion.errors;
  EXPECT_THAT(completion.output, HasSubstr("--gray-card"));
}

TEST(Programs, CompleteThemselvesInBash) {
  const auto completed = [](const std::string& words, int word) {
    return shell("source <(itn completion bash) && COMP_WORDS=(" + words +
                 ") COMP_CWORD=" + std::to_string(word) + " && _itn; echo \"${COMPREPLY[@]}\"")
        .output;
  };
  EXPECT_EQ(completed("itn ren", 1), "render\n");
  EXPECT_EQ(completed("itn render s --sigma", 3), "--sigma-t\n");
  EXPECT_EQ(completed("itn evaluate --pic", 2), "--picture --picture-items\n");
  EXPECT_EQ(completed("itn render sce", 2), "\n");  // a file
}

}  // namespace
}  // namespace itn
