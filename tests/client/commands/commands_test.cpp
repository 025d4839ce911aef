// itn render and probe, and itn-worker, as processes.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <numeric>
#include <string>
#include <vector>

#include "client/image/image.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/scene_files.h"

namespace itn {
namespace {

using ::testing::AllOf;
using ::testing::ContainsRegex;
using ::testing::ElementsAre;
using namespace testing;
using ::testing::HasSubstr;
using ::testing::Key;
using ::testing::StartsWith;

std::vector<std::string> render(const std::string& scene, const std::string& output,
                                const std::vector<std::string>& more = {}) {
  std::vector<std::string> command = {testing::kItn, "render",   scene, "-o",  output, "--sigma-t",
                                      "5",           "--albedo", "0.9", "--g", "0.3"};
  command.insert(command.end(), more.begin(), more.end());
  return command;
}

std::vector<std::string> worker(const std::vector<std::string>& more = {},
                                const std::string& log_level = "error") {
  std::vector<std::string> command = {testing::kItnWorker, "--listen", "127.0.0.1:0", "--log-level",
                                      log_level};
  command.insert(command.end(), more.begin(), more.end());
  return command;
}

std::string content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(RenderCommand, WritesLayersAndHeader) {
  const TemporaryFolder folder;
  const Finished finished = run(render(
      folder.write("scene.textproto", kSceneFile), folder.path("out.exr"),
      {"--spp", "9", "--seed", "3", "--estimates", "2", "--resolution", "8x6", "--derivatives",
       "g,sigma_s_reduced", "--picture", folder.path("out.png"), "--json"}));
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, HasSubstr("\"invalid_samples\":0"));
  EXPECT_EQ(content(folder.path("out.png")).substr(1, 3), "PNG");
  const Image image = read_exr(folder.path("out.exr"));
  EXPECT_EQ(image.width, 8);
  EXPECT_EQ(image.height, 6);
  EXPECT_THAT(image.channels,
              ElementsAre(Key("Y"), Key("estimate0.Y"), Key("estimate0.g.Y"),
                          Key("estimate0.sigma_s_reduced.Y"), Key("estimate1.Y"),
                          Key("estimate1.g.Y"), Key("estimate1.sigma_s_reduced.Y"), Key("g.Y"),
                          Key("mask.Y"), Key("sigma_s_reduced.Y"), Key("stderr.Y"),
                          Key("stderr.g.Y"), Key("stderr.sigma_s_reduced.Y")));
  EXPECT_EQ(image.attributes.at("itn.sigma_t"), Attribute(5.0));
  EXPECT_EQ(image.attributes.at("itn.albedo"), Attribute(0.9));
  EXPECT_EQ(image.attributes.at("itn.g"), Attribute(0.3));
  EXPECT_EQ(image.attributes.at("itn.spp"), Attribute(9));
  EXPECT_EQ(image.attributes.at("itn.seed"), Attribute("3"));
  EXPECT_EQ(image.attributes.at("itn.pilot_spp"), Attribute(0));
  EXPECT_EQ(image.attributes.at("itn.pixels"), Attribute("all"));
  EXPECT_EQ(image.attributes.at("itn.tracer"), Attribute("wavefront"));
  EXPECT_EQ(image.attributes.at("itn.paths"), Attribute(432.0));
  // Estimate 0 has 5 of the 9 samples, estimate 1 has 4.
  const auto& mean = image.channel("Y");
  for (size_t i = 0; i < mean.size(); ++i) {
    const float expected =
        (5 * image.channel("estimate0.Y")[i] + 4 * image.channel("estimate1.Y")[i]) / 9;
    EXPECT_NEAR(mean[i], expected, 1e-6F * expected);
    const float distance =
        std::abs(image.channel("estimate0.g.Y")[i] - image.channel("estimate1.g.Y")[i]);
    EXPECT_NEAR(image.channel("stderr.g.Y")[i], distance / 2, 1e-4F * distance + 1e-6F);
  }
}

TEST(RenderCommand, WritesAlphaWhereItIsAskedFor) {
  const TemporaryFolder folder;
  const std::string picture = folder.path("out.png");
  const Finished finished =
      run(render(folder.write("scene.textproto", kSceneFile), folder.path("out.exr"),
                 {"--spp", "2", "--resolution", "8x6", "--picture", picture, "--alpha"}));
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  const Image image = read_exr(folder.path("out.exr"));
  EXPECT_EQ(image.channel("A"), image.channel("mask.Y"));
  EXPECT_EQ(content(picture)[25], 6);  // the header's colour type: with alpha
}

// Until the noise is low, or the time or the samples are over; the file says how many there were,
// and is that of so many, to what floats round.
TEST(RenderCommand, EndsWhenTheImageIsGoodEnough) {
  const TemporaryFolder folder;
  const std::string scene = folder.write("scene.textproto", kSceneFile);
  const auto rendered = [&](const std::vector<std::string>& flags) {
    std::vector<std::string> all = {"--film", "16x12", "--derivatives", "albedo"};
    all.insert(all.end(), flags.begin(), flags.end());
    const Finished finished = run(render(scene, folder.path("out.exr"), all));
    EXPECT_EQ(finished.exit_code, 0) << finished.errors;
    return std::pair{read_exr(folder.path("out.exr")), finished};
  };
  for (const std::vector<std::string>& flags :
       {std::vector<std::string>{"--noise", "4%"}, std::vector<std::string>{"--time", "0.2s"},
        std::vector<std::string>{"--noise", "0.1%", "--spp", "100"}}) {
    const auto [image, finished] = rendered(flags);
    const int spp = std::get<int>(image.attributes.at("itn.spp"));
    EXPECT_GE(spp, 8);
    if (flags.size() > 2) {
      EXPECT_EQ(spp, 100);
      EXPECT_THAT(finished.errors, HasSubstr("not 0.1 %: the samples were over before"));
    }
    EXPECT_THAT(finished.output, HasSubstr(std::to_string(spp) + " samples per pixel"));
    const auto [whole, unused] = rendered({"--spp", std::to_string(spp)});
    for (const auto& [name, values] : whole.channels) {
      for (size_t i = 0; i < values.size(); ++i) {
        EXPECT_NEAR(image.channel(name)[i], values[i], 1e-5F * (1 + std::abs(values[i])))
            << name << ", pixel " << i;
      }
    }
  }
}

TEST(RenderCommand, SaysThatOneSampleTellsNoNoise) {
  const TemporaryFolder folder;
  const auto command = render(folder.write("scene.textproto", kSceneFile), folder.path("out.exr"),
                              {"--film", "16x12", "--spp", "1", "--noise", "5%"});
  const Finished finished = run(command);
  EXPECT_THAT(finished.output, HasSubstr(", noise unknown"));
  EXPECT_THAT(finished.errors, HasSubstr("the noise is unknown, not 5 %: the samples were over"));
  std::vector<std::string> with_json = command;
  with_json.emplace_back("--json");
  const Finished in_json = run(with_json);
  EXPECT_THAT(in_json.output, HasSubstr("mean_radiance_on_object"));
  EXPECT_THAT(in_json.output, Not(HasSubstr("noise_on_object")));
}

// Radiance is linear in the lights, and smooth in the reflectance of the ground.
TEST(RenderCommand, WritesDerivativesInTheScene) {
  const TemporaryFolder folder;
  const auto scene = [&](const std::string& reflectance) {
    return folder.write("scene" + reflectance + ".textproto",
                        testing::replaced(kSceneFile, "half_v { z: -20 } }",
                                          "half_v { z: -20 } } reflectance: " + reflectance));
  };
  const auto rendered = [&](const std::string& reflectance, const std::vector<std::string>& more) {
    std::vector<std::string> flags = {"--spp", "64", "--film", "8x6"};
    flags.insert(flags.end(), more.begin(), more.end());
    const Finished finished = run(render(scene(reflectance), folder.path("out.exr"), flags));
    EXPECT_EQ(finished.exit_code, 0) << finished.errors;
    return read_exr(folder.path("out.exr"));
  };
  const auto sum = [](const Image& image, const std::string& channel) {
    const auto& values = image.channel(channel);
    return std::accumulate(values.begin(), values.end(), 0.0);
  };
  const Image image =
      rendered("0.5", {"--derivatives", "light[0].scale,surface[0].reflectance,albedo"});
  EXPECT_THAT(image.channels,
              ElementsAre(Key("Y"), Key("albedo.Y"), Key("light[0].scale.Y"), Key("mask.Y"),
                          Key("stderr.Y"), Key("surface[0].reflectance.Y")));
  EXPECT_NEAR(sum(image, "light[0].scale.Y"), sum(image, "Y"), 1e-4 * sum(image, "Y"));
  const double difference =
      (sum(rendered("0.52", {}), "Y") - sum(rendered("0.48", {}), "Y")) / 0.04;
  EXPECT_GT(difference, 0);
  EXPECT_NEAR(sum(image, "surface[0].reflectance.Y"), difference, 0.05 * difference);
  // One that the scene does not have.
  const Finished absent = run(
      render(scene("0.5"), folder.path("out.exr"), {"--derivatives", "surface[1].reflectance"}));
  EXPECT_EQ(absent.exit_code, 3);
  EXPECT_THAT(absent.errors, HasSubstr("surface[1].reflectance"));
}

TEST(RenderCommand, TakesAPhaseFunction) {
  const TemporaryFolder folder;
  const std::string scene = folder.write("scene.textproto", kSceneFile);
  const auto with = [&](const std::vector<std::string>& flags) {
    std::vector<std::string> command = {
        testing::kItn, "render", scene,      "-o", folder.path("out.exr"),
        "--sigma-t",   "5",      "--albedo", "0.9"};
    command.insert(command.end(), flags.begin(), flags.end());
    return run(command);
  };
  const Finished finished = with({"--spp", "4", "--film", "8x6", "--phase", "two_term { g_1: 0.6 }",
                                  "--derivatives", "two_term.weight,albedo"});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(read_exr(folder.path("out.exr")).channels,
              ElementsAre(Key("Y"), Key("albedo.Y"), Key("mask.Y"), Key("stderr.Y"),
                          Key("two_term.weight.Y")));
  EXPECT_EQ(with({"--phase", "two_term { g_3: 0.6 }"}).exit_code, 3);
  EXPECT_EQ(with({"--phase", "two_term { }", "--g", "0.3"}).exit_code, 2);
  EXPECT_EQ(with({"--phase", "two_term { }", "--derivatives", "g"}).exit_code, 3);
}

TEST(RenderCommand, WritesTheSameFileInEveryArrangement) {
  const TemporaryFolder folder;
  Process a(worker({"--threads", "1"})), b(worker({"--threads", "2"}));
  const std::string workers = a.read_line() + "," + b.read_line();
  const std::string scene = folder.write("scene.textproto", kSceneFile);
  const std::vector<std::vector<std::string>> arrangements = {
      {"--threads", "1"}, {"--threads", "2"}, {"--workers", workers}};
  for (size_t i = 0; i < arrangements.size(); ++i) {
    std::vector<std::string> flags = arrangements[i];
    flags.insert(flags.end(), {"--derivatives", "sigma_t,albedo,g"});
    const Finished finished = run(render(scene, folder.path(std::to_string(i)), flags));
    ASSERT_EQ(finished.exit_code, 0) << finished.errors;
    EXPECT_EQ(content(folder.path(std::to_string(i))), content(folder.path("0")));
  }
}

TEST(RenderCommand, TakesTheSceneAfterItsListFlags) {
  const TemporaryFolder folder;
  const std::string scene = folder.write("scene.textproto", kSceneFile);
  const Finished finished = run({testing::kItn, "render", "--sigma-t", "5", "--albedo", "0.9",
                                 "--derivatives", "g", scene, "-o", folder.path("out.exr")});
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
}

TEST(RenderCommand, EndsByCtrlC) {
  const TemporaryFolder folder;
  Process command(render(folder.write("scene.textproto", kSceneFile), folder.path("out.exr"),
                         {"--film", "512x512", "--spp", "1000000", "--threads", "1"}),
                  true);
  // Starting takes less than a second of this.
  ASSERT_TRUE(eventually([&] { return command.cpu_seconds() > 2; }));
  command.send(SIGINT);
  EXPECT_THAT(command.read_stderr(), HasSubstr("itn: interrupted"));
  EXPECT_EQ(command.wait(), 130);
  EXPECT_FALSE(std::filesystem::exists(folder.path("out.exr")));
}

// With a goal, what is done by then.
TEST(RenderCommand, WritesWhatIsDoneByCtrlC) {
  const TemporaryFolder folder;
  Process command(render(folder.write("scene.textproto", kSceneFile), folder.path("out.exr"),
                         {"--noise", "0.01%", "--threads", "1"}),
                  true);
  EXPECT_THAT(command.read_stderr_until("left in all"), HasSubstr("noise "));
  command.send(SIGINT);
  EXPECT_THAT(command.read_stderr(), HasSubstr("samples per pixel that were done"));
  EXPECT_EQ(command.wait(), 130);
  EXPECT_EQ(read_exr(folder.path("out.exr")).width, 16);
}

TEST(RenderCommand, TakesAsManyDerivativesAsItSays) {
  const TemporaryFolder folder;
  std::string scene = kSceneFile, names = "sigma_t,albedo,g";
  for (int k = 0; k < 40; ++k) {
    scene += "surfaces { rectangle { center { y: -1 } half_u { x: 9 } half_v { z: -9 } } }\n";
  }
  const auto derivatives = [&](int count) {
    std::string list = names;
    for (int k = 0; k < count - 3; ++k) list += fmt::format(",surface[{}].reflectance", k);
    return run(render(folder.write("scene.textproto", scene), folder.path("out.exr"),
                      {"--spp", "1", "--derivatives", list}));
  };
  EXPECT_EQ(derivatives(32).exit_code, 0);
  EXPECT_THAT(derivatives(33).errors, HasSubstr("it must be in [0, 32]"));
}

// JSON is UTF-8, names of files need not be.
TEST(RenderCommand, SpellsNamesThatAreNotUtf8) {
  const TemporaryFolder folder;
  const Finished finished = run(render(folder.write("scene.textproto", kSceneFile),
                                       folder.path("b\xe9.exr"), {"--spp", "1", "--json"}));
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, HasSubstr("b\\\\xe9.exr"));
}

TEST(ProbeCommand, TellsWhetherAWorkerServes) {
  Process process(worker());
  const std::string address = process.read_line();
  for (const char* service : {"", "itn.v1.RenderService"}) {
    const Finished finished = run({testing::kItn, "probe", address, "--service", service});
    EXPECT_EQ(finished.exit_code, 0) << finished.errors;
    EXPECT_EQ(finished.output, "SERVING\n");
  }
  EXPECT_EQ(run({testing::kItn, "probe", address, "--service", "no.such.Service"}).exit_code, 5);
  const Finished several = run({testing::kItn, "probe", address + "," + address});
  EXPECT_EQ(several.exit_code, 2);
  EXPECT_THAT(several.errors, HasSubstr("takes one HOST:PORT"));
  process.send(SIGTERM);
  EXPECT_EQ(process.wait(), 0);
  EXPECT_EQ(run({testing::kItn, "probe", address}).exit_code, 5);
}

TEST(Worker, WritesItsMetrics) {
  const TemporaryFolder folder;
  Process process(worker({"--metrics-file", folder.path("itn.prom")}, "info"), true);
  const std::string address = process.read_line();
  ASSERT_EQ(run(render(folder.write("scene.textproto", kSceneFile), folder.path("out.exr"),
                       {"--film", "8x6", "--spp", "4", "--workers", address}))
                .exit_code,
            0);
  process.send(SIGTERM);
  EXPECT_THAT(process.read_stderr(), HasSubstr(": OK, waited "));
  EXPECT_EQ(process.wait(), 0);
  EXPECT_THAT(
      content(folder.path("itn.prom")),
      HasSubstr("itn_calls_total{server=\"" + address + "\",method=\"RenderGrad\",status=\"OK\"}"));
}

TEST(Worker, LogsCallsAsJsonForMachines) {
  Process process(worker({"--log-format", "json"}, "info"), true);
  const std::string address = process.read_line();
  const TemporaryFolder folder;
  EXPECT_EQ(run(render(folder.write("scene.textproto", kSceneFile), folder.path("out.exr"),
                       {"--film", "8x6", "--spp", "1", "--workers", address}))
                .exit_code,
            0);
  process.send(SIGTERM);
  EXPECT_THAT(process.read_stderr(),
              ContainsRegex("\"method\":\"RenderGrad\",\"request\":\"[0-9a-f]{16}\","
                            "\"client\":\"ipv4:127.0.0.1:[0-9]+\",\"status\":\"OK\","
                            "\"queue_ms\":[-+.e0-9]+,\"work_ms\":[-+.e0-9]+,\"paths\":48\\}\n"));
  EXPECT_EQ(process.wait(), 0);
}

TEST(Worker, FindsAtOnceThatItsMetricsCannotBeWritten) {
  const Finished finished = run(worker({"--metrics-file", "/nowhere/itn.prom"}));
  EXPECT_EQ(finished.exit_code, 4);
  EXPECT_THAT(finished.errors, HasSubstr("/nowhere/itn.prom"));
}

TEST(PredictCommand, SaysThatAWorkerIsNoPredictor) {
  const TemporaryFolder folder;
  Image image;
  image.width = image.height = 4;
  image.channels["Y"] = image.channels["mask.Y"] = std::vector<float>(16, 1);
  write_exr(folder.path("image.exr"), image);
  Process process(worker());
  const std::string address = process.read_line();
  const Finished finished =
      run({testing::kItn, "predict", folder.path("image.exr"), "--predictor", address});
  EXPECT_EQ(finished.exit_code, 5);
  EXPECT_THAT(finished.errors, HasSubstr(address + " is not a predictor"));
}

TEST(ModelsCommand, SaysThatAWorkerIsNoPredictor) {
  Process process(worker());
  const std::string address = process.read_line();
  const Finished finished = run({testing::kItn, "models", "--predictor", address});
  EXPECT_EQ(finished.exit_code, 5);
  EXPECT_THAT(finished.errors, HasSubstr(address + " is not a predictor; itn-predictor is one"));
}

TEST(Worker, DrainsOnSigterm) {
  const TemporaryFolder folder;
  Process process(worker({"--threads", "1"}, "debug"), true);
  const std::string address = process.read_line();
  // One tile, of a second or so.
  Process command(render(folder.write("scene.textproto", kSceneFile), folder.path("out.exr"),
                         {"--film", "16x16", "--spp", "4000", "--workers", address}),
                  true);
  EXPECT_THAT(process.read_stderr_until("rendering"), HasSubstr("rendering"));
  process.send(SIGTERM);
  EXPECT_THAT(process.read_stderr_until("rendered"), HasSubstr("stopping"));
  EXPECT_EQ(process.wait(), 0);
  command.read_stderr();
  EXPECT_EQ(command.wait(), 0);
}

TEST(Worker, StopsAtOnceOnASecondSignal) {
  const TemporaryFolder folder;
  Process process(worker({"--threads", "1"}, "debug"), true);
  const std::string address = process.read_line();
  // Takes days.
  Process command(render(folder.write("scene.textproto", kSceneFile), folder.path("out.exr"),
                         {"--film", "512x512", "--spp", "1000000", "--workers", address}),
                  true);
  EXPECT_THAT(process.read_stderr_until("rendering"), HasSubstr("rendering"));
  process.send(SIGTERM);
  EXPECT_THAT(process.read_stderr_until("stopping"), HasSubstr("stopping"));
  // One that comes soon after the first counts as the same.
  EXPECT_TRUE(eventually([&] {
    process.send(SIGTERM);
    return process.has_ended();
  }));
  EXPECT_EQ(process.wait(), 130);
}

TEST(Programs, SayInTheirHelpWhatMayBeGiven) {
  EXPECT_THAT(
      run({testing::kItn, "render", "--help"}).output,
      AllOf(HasSubstr("--spp UINT:in [1, 1048576]=64"), HasSubstr("--albedo FLOAT:in [0, 1]"),
            HasSubstr("--g FLOAT:in [-0.99, 0.99]=0")));
  EXPECT_THAT(run({testing::kItn, "dataset", "--help"}).output,
              AllOf(HasSubstr("--sigma-t MIN MAX:in [1e-06, 1000000]"),
                    HasSubstr("log-uniform; default 30 276"),
                    HasSubstr("uniform; default 0.39 0.95"), HasSubstr("uniform; default 0 0.8")));
  EXPECT_THAT(run({testing::kItnWorker, "--help"}).output, HasSubstr("in MiB, 256 at least"));
}

TEST(Programs, TellTheirVersion) {
  EXPECT_EQ(run({testing::kItn, "--version"}).output, "itn " ITN_VERSION "\n");
  EXPECT_EQ(run({testing::kItnWorker, "--version"}).output, "itn-worker " ITN_VERSION "\n");
}

}  // namespace
}  // namespace itn
