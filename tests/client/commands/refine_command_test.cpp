// itn refine, as a process.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <string>
#include <vector>

#include "client/image/image.h"
#include "client/image/preview.h"
#include "client/json.h"
#include "client/refine/refine_run.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/scene_files.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using namespace testing;
using ::testing::HasSubstr;

using Arguments = std::vector<std::string>;

std::string content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// Without the times.
std::string timeless(const std::string& json) {
  return std::regex_replace(json, std::regex("\"(cpu_)?seconds\":[-+.e0-9]+"), "");
}

class RefineCommand : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new TemporaryFolder;
    std::ofstream(shared_->path("scene.textproto")) << kSceneFile;
    const Finished rendered = run({testing::kItn, "render", shared_->path("scene.textproto"), "-o",
                                   shared_->path("image.exr"), "--sigma-t", "8", "--albedo", "0.8",
                                   "--g", "0.3", "--spp", "64", "--pixels", "object"});
    ASSERT_EQ(rendered.exit_code, 0) << rendered.errors;
  }
  static void TearDownTestSuite() { delete shared_; }

  static Arguments command(const Arguments& more) {
    Arguments arguments{testing::kItn, "refine", shared_->path("image.exr"), "--scene",
                        shared_->path("scene.textproto")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }

  static TemporaryFolder* shared_;
};
TemporaryFolder* RefineCommand::shared_ = nullptr;

TEST_F(RefineCommand, GoesOnAfterItWasKilledOrHitALimit) {
  const auto into = [&](const std::string& folder, const std::string& iterations) {
    return command({"--init", "12,0.7,0.1", "--spp", "16", "--max-iterations", iterations,
                    "--max-spp", "100000", "-o", shared_->path(folder)});
  };
  ASSERT_EQ(run(into("straight", "8")).exit_code, 0);
  ASSERT_EQ(run(into("limited", "3")).exit_code, 0);
  const Finished limited = run(into("limited", "8"));
  ASSERT_EQ(limited.exit_code, 0);
  EXPECT_THAT(limited.errors, HasSubstr("limited: 3 iterations are done"));
  {
    Process process(into("killed", "8"));
    ASSERT_TRUE(eventually([&] { return fs::exists(shared_->path("killed/state.itn")); }));
    process.send(SIGKILL);
    process.wait();
  }
  const Finished continued = run(into("killed", "8"));
  ASSERT_EQ(continued.exit_code, 0) << continued.errors;
  for (const char* name : {"result.json", "trajectory.jsonl", "picture.png"}) {
    const std::string straight = timeless(content(shared_->path("straight") + "/" + name));
    EXPECT_FALSE(straight.empty());
    EXPECT_EQ(straight, timeless(content(shared_->path("limited") + "/" + name))) << name;
    EXPECT_EQ(straight, timeless(content(shared_->path("killed") + "/" + name))) << name;
  }
  const Finished other =
      run(command({"--init", "12,0.7,0.1", "--spp", "32", "-o", shared_->path("straight")}));
  EXPECT_EQ(other.exit_code, 3);
  EXPECT_THAT(other.errors, AllOf(HasSubstr("other settings"), HasSubstr("spp")));
  const Finished elsewhere = run(into("straight", "8"));
  EXPECT_EQ(elsewhere.exit_code, 0) << "finished: the answer again";
}

TEST_F(RefineCommand, SaysHowFarItCameWhenItIsInterrupted) {
  Process process(command({"--init", "12,0.7,0.1", "--spp", "16", "--max-iterations", "10000",
                           "--max-spp", "1000000", "-o", shared_->path("interrupted")}),
                  true);
  ASSERT_TRUE(eventually([&] { return fs::exists(shared_->path("interrupted/state.itn")); }));
  process.send(SIGINT);
  EXPECT_THAT(process.read_stderr(),
              AllOf(HasSubstr("interrupted; "), HasSubstr(" done, the same command continues")));
  EXPECT_EQ(process.wait(), 130);
}

TEST_F(RefineCommand, PrintsTheAnswer) {
  const Arguments arguments = {"--init",   "mean", "--max-iterations",   "2",
                               "--starts", "2",    "--unknown-exposure", "--weights",
                               "map"};
  const Finished text = run(command(arguments));
  ASSERT_EQ(text.exit_code, 0) << text.errors;
  EXPECT_THAT(text.output, AllOf(HasSubstr("sigma_t"), HasSubstr("95 % interval"),
                                 HasSubstr("image / render"), HasSubstr("--max-iterations")));
  Arguments json = arguments;
  json.insert(json.end(), {"--format", "json"});
  const Finished machine = run(command(json));
  EXPECT_THAT(machine.output,
              AllOf(HasSubstr("\"end\":\"MAX_ITERATIONS\""), HasSubstr("\"total_iterations\":4")));
}

// What a photograph's file says of itself counts, and what it does not say is asked for.
TEST_F(RefineCommand, ReadsPhotographsAsPredictDoes) {
  const Image image = read_exr(shared_->path("image.exr"));
  const std::vector<float>& radiance = image.channel("Y");
  const float most = *std::max_element(radiance.begin(), radiance.end());
  std::vector<unsigned char> rgb, mask, inverted;
  for (size_t p = 0; p < radiance.size(); ++p) {
    const bool seen = image.channel("mask.Y")[p] > 0.5F;
    rgb.insert(rgb.end(), 3, to_srgb_byte(radiance[p] / (0.8F * most)));
    mask.insert(mask.end(), 3, seen ? 255 : 0);
    inverted.insert(inverted.end(), 3, seen ? 0 : 255);
  }
  write_png(shared_->path("photo.png"), image.width, image.height, rgb);
  write_png(shared_->path("mask.png"), image.width, image.height, mask);
  write_png(shared_->path("inverted.png"), image.width, image.height, inverted);
  const auto refine = [&](const std::string& photograph, Arguments more) {
    Arguments arguments{testing::kItn,
                        "refine",
                        shared_->path(photograph),
                        "--scene",
                        shared_->path("scene.textproto"),
                        "--init",
                        "8,0.8,0.3",
                        "--max-iterations",
                        "1",
                        "--spp",
                        "16"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run(arguments);
  };
  const Finished encoded = refine("photo.png", {"--mask", shared_->path("mask.png")});
  EXPECT_EQ(encoded.exit_code, 0) << encoded.errors;
  EXPECT_THAT(encoded.errors, AllOf(HasSubstr("at the top of what the file can hold"),
                                    HasSubstr("--exposure unknown finds it")));
  EXPECT_THAT(encoded.output, HasSubstr("too few of its pixels count to see whether"));
  const Finished wrong = refine("photo.png", {"--mask", shared_->path("inverted.png")});
  EXPECT_EQ(wrong.exit_code, 3);
  EXPECT_THAT(wrong.errors, HasSubstr("is the mask inverted"));
  Image coloured = image;
  coloured.channels = {{"R", radiance}, {"G", radiance}, {"B", radiance}};
  for (float& value : coloured.channels["B"]) value *= 0.5F;
  write_exr(shared_->path("coloured.exr"), coloured);
  EXPECT_THAT(refine("coloured.exr", {}).errors, HasSubstr("one material for all of them"));
}

// By a film of RGB: a material for each, of one g and one exposure, in a folder for each.
TEST_F(RefineCommand, FindsColoursTogether) {
  Image image = read_exr(shared_->path("image.exr"));
  const std::vector<float> radiance = image.channel("Y");
  image.channels.erase("Y");
  for (const char* name : {"R", "G", "B"}) image.channels[name] = radiance;
  for (float& value : image.channels["B"]) value *= 0.7F;
  write_exr(shared_->path("colours.exr"), image);
  std::ofstream(shared_->path("colours.textproto"))
      << replaced(kSceneFile, "width: 16", "channel: RGB width: 16");
  const auto refine = [&](const Arguments& more) {
    Arguments arguments{testing::kItn,
                        "refine",
                        shared_->path("colours.exr"),
                        "--scene",
                        shared_->path("colours.textproto"),
                        "--init",
                        "8,0.8,0.3",
                        "--max-iterations",
                        "2",
                        "--exposure",
                        "unknown",
                        "--known-within",
                        "exposure=0.05"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run(arguments);
  };
  const Finished text = refine({"-o", shared_->path("in_colours")});
  ASSERT_EQ(text.exit_code, 0) << text.errors;
  EXPECT_THAT(text.output,
              AllOf(HasSubstr("R "), HasSubstr("B "), HasSubstr("\ng  "), HasSubstr("sigma_a")));
  const Finished machine = refine({"--json"});
  ASSERT_EQ(machine.exit_code, 0) << machine.errors;
  v1::FitResult all;
  from_json(machine.output, "refine", all);
  ASSERT_EQ(all.results_size(), 3);
  EXPECT_LT(all.results(2).material().albedo(), all.results(0).material().albedo());
  for (int c = 0; c < 3; ++c) {
    v1::RefineResult one;
    from_json(content(shared_->path("in_colours") + "/" + kRgb.at(c) + "/result.json"), "result",
              one);
    EXPECT_EQ(one.material().sigma_t(), all.results(c).material().sigma_t());
    EXPECT_EQ(one.material().g(), all.results(0).material().g());
    EXPECT_EQ(one.exposure().value(), all.results(0).exposure().value());
    const double deviation =
        std::log(one.exposure().high_95() / one.exposure().low_95()) / (2 * 1.96);
    EXPECT_LT(deviation, 0.06);  // 0.05 is known, and the interval holds the answer, too
  }
  const Finished materials = run(
      {testing::kItn, "materials", "--refined", shared_->path("in_colours"), "--format", "pbrt"});
  EXPECT_EQ(materials.exit_code, 0) << materials.errors;
  EXPECT_THAT(materials.output, HasSubstr("in_colours/B"));
}

TEST_F(RefineCommand, SaysWhatIsWrong) {
  const auto refuse = [&](const Arguments& arguments, int code,
                          const std::vector<std::string>& parts) {
    const Finished finished = run(arguments);
    EXPECT_EQ(finished.exit_code, code) << finished.errors;
    for (const std::string& part : parts) EXPECT_THAT(finished.errors, HasSubstr(part));
  };
  refuse(command({"--init", "8,0.8"}), 2, {"--init", "SIGMA_T,ALBEDO,G"});
  refuse(command({"--init", "8,1.8,0"}), 2, {"--init", "albedo in [0, 1]"});
  refuse(command({"--init", "mean", "--spp", "64", "--max-spp", "32"}), 2, {"--spp 64"});
  refuse(command({"--init", "mean", "--spp", "1"}), 2, {"--spp", "[4, "});
  refuse(command({"--init", "mean", "--method", "newton"}), 2, {"gauss-newton, adam"});
  refuse(command({"--init", "mean", "--unknown", "surface[7].reflectance"}), 3,
         {"surface[7].reflectance cannot be refined", "surfaces"});
  refuse(command({"--init", "mean", "--unknown", "rough_dielectric.index"}), 3,
         {"rough_dielectric.index cannot be refined", "the boundary is index-matched"});
  refuse(command({"--scene", shared_->path("scene.textproto")}), 2, {"1 images and 2 scenes"});
  fs::copy_file(shared_->path("image.exr"), shared_->path("copy.exr"));
  refuse({testing::kItn, "refine", shared_->path("image.exr"), shared_->path("copy.exr"), "--scene",
          shared_->path("scene.textproto"), "--init", "mean"},
         3, {"image.exr", "copy.exr are the same photograph"});
  std::ofstream(shared_->path("other.textproto")) << replaced(kSceneFile, "width: 16", "width: 20");
  refuse({testing::kItn, "refine", shared_->path("image.exr"), "--scene",
          shared_->path("other.textproto")},
         3, {"16 x 12", "20 x 12"});
  // The whole frame, in the scene of a part of it.
  std::ofstream(shared_->path("cropped.textproto")) << replaced(
      replaced(kSceneFile, "width: 16 height: 12", "width: 8 height: 6"), "fov_degrees: 22",
      "fov_degrees: 22 crop { left: 0.25 top: 0.25 right: 0.75 bottom: 0.75 }");
  refuse({testing::kItn, "refine", shared_->path("image.exr"), "--scene",
          shared_->path("cropped.textproto")},
         3, {"its scene shows a part of the frame", "8 x 6 pixels"});
  std::ofstream(shared_->path("rgb.textproto"))
      << replaced(kSceneFile, "width: 16", "channel: RGB width: 16");
  refuse({testing::kItn, "refine", shared_->path("image.exr"), "--scene",
          shared_->path("rgb.textproto")},
         3, {"image.exr has no colours, and the film of its scene is RGB"});
  refuse({testing::kItn, "refine", shared_->path("image.exr"), shared_->path("image.exr"),
          "--scene", shared_->path("scene.textproto"), "--scene", shared_->path("rgb.textproto")},
         3, {"rgb.textproto: film.channel must be the same in both"});
  refuse(command({"--init", "mean", "--known-within", "exposure"}), 2,
         {"--known-within exposure: it is NAME=NUMBER"});
  refuse(command({"--init", "mean", "--known-within", "exposure=0.1"}), 3,
         {"known_within names exposure, which is not found"});
  refuse({testing::kItn, "refine", shared_->path("none.exr"), "--scene",
          shared_->path("scene.textproto")},
         4, {"none.exr"});
  Image dark = read_exr(shared_->path("image.exr"));
  dark.channels["mask.Y"].assign(dark.channels["mask.Y"].size(), 0);
  write_exr(shared_->path("dark.exr"), dark);
  refuse({testing::kItn, "refine", shared_->path("dark.exr"), "--scene",
          shared_->path("scene.textproto"), "--init", "mean"},
         3, {"dark.exr", "no pixel on the object"});
  dark.channels.erase("mask.Y");
  write_exr(shared_->path("maskless.exr"), dark);
  refuse({testing::kItn, "refine", shared_->path("maskless.exr"), "--scene",
          shared_->path("scene.textproto")},
         3, {"no network could say where to start", "mask.Y", "--init mean"});
}

}  // namespace
}  // namespace itn
