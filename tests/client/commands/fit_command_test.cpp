// itn fit, as a process.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <string>
#include <vector>

#include "client/dataset/panorama.h"
#include "client/image/image.h"
#include "client/json.h"
#include "client/scene/panorama_file.h"
#include "client/scene/text_proto.h"
#include "common/files/read_file.h"
#include "common/scene/material_proto.h"
#include "itn/v1/refine.pb.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using namespace testing;
using ::testing::AllOf;
using ::testing::HasSubstr;

using Arguments = std::vector<std::string>;

// A mug of 45 mm in a dark room, by the flash of a camera, which its image says nothing of.
constexpr const char* kPhotographed = R"(
object {
  mesh { builtin: "mug" normalize: true
    transforms { scale { x: 45 y: 45 z: 45 } }
    transforms { rotate { axis { x: 0.3 y: 1 z: 0.2 } angle_degrees: 140 } }
    transforms { translate { x: 3 y: -18 z: -330 } } }
  rough_dielectric { index: 1.5 roughness: 0.3 }
  smooth_angle_degrees: 30
}
lights { point { position { y: 12 } intensity: 0.35 } }
camera { origin {} target { z: -1000 } fov_degrees: 18 }
film { width: 160 height: 128 }
)";
constexpr double kSigmaT = 1.5, kAlbedo = 0.9, kG = 0.3;
// 43.27 mm / (2 tan 9 degrees) by the part of the width in the diagonal.
const double kFocalLength =
    43.2666 / (2 * std::tan(9 * 3.14159265 / 180)) * 160 / std::hypot(160, 128);

class FitCommand : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    photograph("photographed.textproto", kPhotographed, "a.exr");
    const Finished shapes = run({kItn, "shapes", "-o", folder_->path("shapes")});
    ASSERT_EQ(shapes.exit_code, 0) << shapes.errors;
  }
  static void TearDownTestSuite() { delete folder_; }

  // Writes a scene, and a render of the material in it.
  static void photograph(const std::string& file, const std::string& scene,
                         const std::string& image) {
    std::ofstream(folder_->path(file)) << scene;
    const Finished rendered =
        run({kItn, "render", folder_->path(file), "-o", folder_->path(image), "--sigma-t",
             std::to_string(kSigmaT), "--albedo", std::to_string(kAlbedo), "--g",
             std::to_string(kG), "--spp", "256"});
    ASSERT_EQ(rendered.exit_code, 0) << rendered.errors;
  }

  // Within four standard deviations, which are no more than `most` of the truth.
  static void expect_near(const v1::RefinedParameter& p, double truth, double most) {
    EXPECT_NEAR(p.value(), truth, 4 * p.standard_deviation());
    EXPECT_LT(p.standard_deviation(), most * truth);
  }

  // Radiance by direction: gray, with a window far to one side, and a lamp above.
  static void write_room(const std::string& file) {
    Image room;
    room.width = 64;
    room.height = 32;
    std::vector<float>& pixels = room.channels["Y"];
    for (int y = 0; y < room.height; ++y) {
      for (int x = 0; x < room.width; ++x) {
        const bool window = y > 8 && y < 16 && x > 40 && x < 50;
        const bool lamp = y < 4 && x < 20;
        pixels.push_back(window ? 12.0F : lamp ? 5.0F : 0.3F);
      }
    }
    write_exr(file, room);
  }

  static Arguments command(const Arguments& more, const std::string& shape = "mug") {
    Arguments arguments{kItn,
                        "fit",
                        folder_->path("a.exr"),
                        "--shape",
                        shape,
                        "--resolution",
                        "32",
                        "--luminance",
                        "--starts",
                        "2",
                        "--max-spp",
                        "2048",
                        "-o",
                        folder_->path("out")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }

  // The mug in other light.
  static std::string lit_by(const std::string& lights) {
    std::string scene = kPhotographed;
    const size_t light = scene.find("lights"), camera = scene.find("camera");
    return scene.replace(light, camera - light, lights);
  }

  // Fits a photograph of the mug, or of another shape of this size, in a folder of its own.
  static v1::FitResult fitted(const std::string& image, const std::string& output,
                              const Arguments& more, const std::string& shape = "mug",
                              const std::string& size = "45") {
    Arguments arguments = command(
        {"--object-size", size, "--focal-length", std::to_string(kFocalLength), "--json"}, shape);
    arguments.insert(arguments.end(), more.begin(), more.end());
    arguments[2] = folder_->path(image);
    *(std::ranges::find(arguments, "-o") + 1) = folder_->path(output);
    const Finished done = run(arguments);
    EXPECT_EQ(done.exit_code, 0) << done.errors;
    v1::FitResult result;
    if (done.exit_code == 0) from_json(done.output, "fit", result);
    return result;
  }

  static inline TemporaryFolder* folder_ = nullptr;
};

TEST_F(FitCommand, FindsPoseAndMaterial) {
  const Finished done =
      run(command({"--object-size", "45", "--focal-length", std::to_string(kFocalLength), "--json"},
                  folder_->path("shapes/mug.ply")));
  ASSERT_EQ(done.exit_code, 0) << done.errors;
  v1::FitResult result;
  from_json(done.output, "fit", result);
  ASSERT_EQ(result.poses_size(), 1);
  const v1::FitPose& pose = result.poses(0);
  EXPECT_GT(pose.overlap(), 0.97);
  v1::Scene scene;
  parse_text_proto(read_file(pose.scene(), "scene"), "scene", scene);
  const auto& transforms = scene.object().mesh().transforms();
  EXPECT_NEAR(transforms[1].rotate().angle_degrees(), 140, 1);
  EXPECT_NEAR(transforms[2].translate().z(), -330, 0.005 * 330);
  EXPECT_FALSE(pose.ambiguous());
  ASSERT_EQ(result.results_size(), 1);
  const v1::RefineResult& material = result.results(0);
  const auto holds = [](const v1::RefinedParameter& p, double truth) {
    return p.low_95() <= truth && truth <= p.high_95();
  };
  EXPECT_TRUE(holds(material.sigma_a(), kSigmaT * (1 - kAlbedo))) << done.output;
  EXPECT_TRUE(holds(material.sigma_s_reduced(), kSigmaT * kAlbedo * (1 - kG))) << done.output;
  EXPECT_TRUE(holds(material.unknowns(0), 0.3)) << done.output;
  for (const char* file : {"scene.textproto", "photograph.exr", "pose.png", "result.json"}) {
    EXPECT_TRUE(fs::exists(folder_->path("out") + "/" + file)) << file;
  }
  EXPECT_THAT(read_file(folder_->path("out") + "/report.html", "report"),
              AllOf(HasSubstr("Where the object stands"), HasSubstr("For renderers"),
                    HasSubstr("sigma_a"), HasSubstr("g was given, not found")));
  EXPECT_EQ(material.diffuse_albedo().value(), diffuse_albedo(from_proto(material.material())));
  const Finished other =
      run(command({"--object-size", "46", "--focal-length", std::to_string(kFocalLength)},
                  folder_->path("shapes/mug.ply")));
  EXPECT_EQ(other.exit_code, 3);
  EXPECT_THAT(other.errors, HasSubstr("has a fit of other options"));
  // What it wrote is what itn refine takes, corrected or not.
  const Finished again =
      run({kItn, "refine", folder_->path("out/photograph.exr"), "--scene", pose.scene(), "--init",
           "1.5,0.9,0.3", "--exposure", "unknown", "--max-iterations", "1", "--spp", "16"});
  EXPECT_EQ(again.exit_code, 0) << again.errors;
}

// Where the object stands is not searched again once it was found.
TEST_F(FitCommand, GoesOnWhereItWasStopped) {
  // One iteration at least.
  const auto fit = [&](const std::string& time_limit) {
    Arguments arguments = command({"--object-size", "45", "--focal-length",
                                   std::to_string(kFocalLength), "--time-limit", time_limit});
    *(std::ranges::find(arguments, "-o") + 1) = folder_->path("stopped");
    return run(arguments);
  };
  ASSERT_EQ(fit("0.001").exit_code, 0);
  const auto poses = [&] { return read_file(folder_->path("stopped/poses.textproto"), "poses"); };
  const std::string before = poses();
  EXPECT_THAT(before, HasSubstr("search_seconds: "));
  const Finished done = fit("0.002");
  ASSERT_EQ(done.exit_code, 0) << done.errors;
  EXPECT_THAT(done.errors, HasSubstr("it is not searched again"));
  EXPECT_EQ(poses(), before);
}

// A slab, which is a cube of three sides.
TEST_F(FitCommand, TakesSidesOfABox) {
  std::string scene = kPhotographed;
  scene.replace(scene.find("mug"), 3, "cube");
  scene.replace(scene.find("x: 45 y: 45 z: 45"), 17, "x: 45 y: 10 z: 30");
  photograph("slab.textproto", scene, "slab.exr");
  const v1::FitResult result =
      fitted("slab.exr", "slab", {"--index-error", "0", "--flash-error", "0"}, "cube", "45,10,30");
  ASSERT_EQ(result.results_size(), 1);
  EXPECT_GT(result.poses(0).overlap(), 0.97);
  EXPECT_FALSE(result.poses(0).ambiguous());
  // Shading of flat faces tells little of absorption without a card.
  expect_near(result.results(0).sigma_s_reduced(), kSigmaT * kAlbedo * (1 - kG), 0.3);
}

TEST_F(FitCommand, FindsTheTurnOfAPanorama) {
  constexpr double kTurn = 70;
  write_room(folder_->path("room.exr"));
  // The mug of the others in the light of a room. A card beside it would have that of above.
  photograph("in_room.textproto",
             lit_by("lights { environment_map { path: \"room.exr\" rotate_y_degrees: " +
                    std::to_string(180 + kTurn) + " } }\n"),
             "in_room.exr");
  Image in_room = read_exr(folder_->path("in_room.exr"));
  constexpr double kGray = 0.18;
  const v1::Pixels room = load_panorama(folder_->path("room.exr"));
  std::vector<float>& pixels = in_room.channels.at("Y");
  for (size_t y = 0; y < 16; ++y) {
    std::fill_n(pixels.begin() + static_cast<ptrdiff_t>(y) * in_room.width, 16,
                static_cast<float>(kGray * irradiance_from_above(room) / std::numbers::pi));
  }
  write_exr(folder_->path("in_room.exr"), in_room);
  const v1::FitResult result = fitted(
      "in_room.exr", "room", {"--light", folder_->path("room.exr"), "--gray-card", "0,0,16,16"});
  ASSERT_EQ(result.results_size(), 1);
  EXPECT_NEAR(result.poses(0).panorama_turn(), kTurn, 3);
  EXPECT_FALSE(result.poses(0).turn_ambiguous());
  const v1::RefineResult& material = result.results(0);
  EXPECT_NEAR(material.exposure().value(), 1, 0.1);
  expect_near(material.sigma_s_reduced(), kSigmaT * kAlbedo * (1 - kG), 0.1);
}

// The mug of the others under a clear sky, with the sun to the left and behind the camera.
TEST_F(FitCommand, FindsTheSun) {
  constexpr double kTurn = 120, kElevation = 35;
  photograph("in_sun.textproto",
             lit_by("lights { sun_sky { sun_azimuth_degrees: " + std::to_string(-kTurn) +
                    " sun_elevation_degrees: " + std::to_string(kElevation) + " } }\n"),
             "in_sun.exr");
  const v1::FitResult result = fitted("in_sun.exr", "sun", {"--light", "sun"});
  ASSERT_EQ(result.results_size(), 1);
  EXPECT_NEAR(result.poses(0).panorama_turn(), kTurn, 4);
  EXPECT_NEAR(result.poses(0).sun_elevation(), kElevation, 4);
  const v1::RefineResult& material = result.results(0);
  EXPECT_FALSE(material.misfit());
  expect_near(material.sigma_s_reduced(), kSigmaT * kAlbedo * (1 - kG), 0.2);
}

// One from nearer, of another side: by the same flash, which is brighter there.
TEST_F(FitCommand, SeveralPhotographsTellMore) {
  std::string scene = kPhotographed;
  scene.replace(scene.find("angle_degrees: 140"), 18, "angle_degrees: 60");
  scene.replace(scene.find("z: -330"), 7, "z: -290");
  photograph("nearer.textproto", scene, "b.exr");
  const v1::FitResult result = fitted("a.exr", "both", {folder_->path("b.exr")});
  ASSERT_EQ(result.poses_size(), 2);
  for (const int i : {0, 1}) {
    v1::Scene found;
    parse_text_proto(read_file(result.poses(i).scene(), "scene"), "scene", found);
    EXPECT_NEAR(found.object().mesh().transforms(2).translate().z(), i == 0 ? -330 : -290, 2);
    // The flash is the same.
    EXPECT_NEAR(found.lights(0).sphere().radiance(), 1 / std::pow(2 / result.poses(0).range(), 2),
                0.05 * 330 * 330 / 4);
  }
  const v1::RefineResult& found = result.results(0);
  expect_near(found.sigma_a(), kSigmaT * (1 - kAlbedo), 0.2);
  expect_near(found.sigma_s_reduced(), kSigmaT * kAlbedo * (1 - kG), 0.2);
}

// A photograph of sixteen times the pixels of the film, by a scale that is not known.
TEST_F(FitCommand, TakesASceneThatIsGiven) {
  std::string scene = kPhotographed;
  scene.replace(scene.find("width: 160 height: 128"), 22, "width: 40 height: 32");
  std::ofstream(folder_->path("given.textproto")) << scene;
  Image brighter = read_exr(folder_->path("a.exr"));
  constexpr float kScale = 3;
  for (float& value : brighter.channels.at("Y")) value *= kScale;
  write_exr(folder_->path("brighter.exr"), brighter);
  const Finished done = run({kItn, "fit", folder_->path("brighter.exr"), "--scene",
                             folder_->path("given.textproto"), "--shape-error", "0", "--starts",
                             "2", "--max-spp", "2048", "--json", "-o", folder_->path("given")});
  ASSERT_EQ(done.exit_code, 0) << done.errors;
  EXPECT_THAT(done.errors, HasSubstr("the index of refraction stays that of the scene"));
  v1::FitResult result;
  from_json(done.output, "fit", result);
  EXPECT_TRUE(result.poses().empty());
  ASSERT_EQ(result.results_size(), 1);
  const v1::RefineResult& found = result.results(0);
  expect_near(found.sigma_a(), kSigmaT * (1 - kAlbedo), 0.2);
  expect_near(found.sigma_s_reduced(), kSigmaT * kAlbedo * (1 - kG), 0.2);
  expect_near(found.unknowns(0), 0.3, 0.1);
  expect_near(found.exposure(), kScale, 0.15);
  EXPECT_TRUE(fs::exists(folder_->path("given/report.html")));
}

TEST_F(FitCommand, MakesAPanoramaOfAMirrorBall) {
  // In a room of the same radiance all around.
  Image ball;
  ball.width = 100;
  ball.height = 80;
  std::vector<float>&pixels = ball.channels["Y"], &mask = ball.channels["mask.Y"];
  for (int y = 0; y < ball.height; ++y) {
    for (int x = 0; x < ball.width; ++x) {
      const bool on = std::hypot(x + 0.5 - 45, y + 0.5 - 42) < 30;
      pixels.push_back(on ? 2.0F : 0.1F);
      mask.push_back(on ? 1.0F : 0.0F);
    }
  }
  const std::string image = folder_->path("ball.exr"), room = folder_->path("light.exr");
  write_exr(image, ball);
  const Arguments light{kItn,  "light",         image, "--focal-length",
                        "50",  "--camera-down", "20",  "--ball-reflectance",
                        "0.5", "--rows",        "32",  "-o",
                        room};
  const Finished done = run(light);
  ASSERT_EQ(done.exit_code, 0) << done.errors;
  const v1::Pixels panorama = load_panorama(room);
  EXPECT_EQ(panorama.width(), 64U);
  EXPECT_EQ(panorama.height(), 32U);
  EXPECT_NEAR(irradiance_from_above(panorama) / std::numbers::pi, 2 / 0.5, 0.05);

  std::ranges::fill(mask, 1.0F);
  std::fill_n(mask.begin(), 3 * ball.width, 0.0F);
  std::fill_n(mask.end() - 3 * ball.width, 3 * ball.width, 0.0F);
  write_exr(image, ball);
  EXPECT_THAT(run(light).errors, HasSubstr("the ball is cut off by the frame"));
  for (int y = 0; y < ball.height; ++y) {
    for (const int x : {0, 1, 98, 99}) mask[static_cast<size_t>(100 * y + x)] = 0;
  }
  write_exr(image, ball);
  EXPECT_THAT(run(light).errors, HasSubstr("the mask shows no ball"));
}

TEST_F(FitCommand, SaysWhatIsWrong) {
  const auto refuse = [&](const Arguments& arguments, int exit_code, const std::string& message) {
    const Finished done = run(arguments);
    EXPECT_EQ(done.exit_code, exit_code) << done.errors;
    EXPECT_THAT(done.errors, HasSubstr(message));
  };
  const std::string focal = std::to_string(kFocalLength);
  fs::remove_all(folder_->path("out"));
  refuse(command({"--object-size", "45"}), 3, "--focal-length");
  refuse(command({"--focal-length", focal}), 2, "--object-size is required");
  refuse({kItn, "fit", folder_->path("a.exr"), "-o", folder_->path("out")}, 2,
         "say either --shape");
  const std::string scene = folder_->path("photographed.textproto");
  refuse({kItn, "fit", folder_->path("a.exr"), folder_->path("a.exr"), folder_->path("a.exr"),
          "--scene", scene, "--scene", scene, "-o", folder_->path("out")},
         2, "3 images and 2 scenes");
  std::string no_film = kPhotographed;
  no_film.erase(no_film.find("film"));
  std::ofstream(folder_->path("no_film.textproto")) << no_film;
  refuse({kItn, "fit", folder_->path("a.exr"), "--scene", folder_->path("no_film.textproto"), "-o",
          folder_->path("out")},
         3, "the film of its scene 0 x 0");
  refuse(command({"--object-size", "45"}, "figur"), 2, "itn shapes lists");
  refuse(command({"--object-size", "45", "--focal-length", focal}, "knot"), 3,
         "wherever the shape stands, its silhouette and the mask overlap by");
  refuse(command({"--object-size", "45", "--focal-length", focal}, "absent.stl"), 4, "absent.stl");
  refuse(command({"--object-size", "45", "--focal-length", focal, "--light", "absent.hdr"}), 4,
         "absent.hdr");
  refuse({kItn, "fit", "--object-size", "45", folder_->path("a.exr"), "--shape", "mug", "-o",
          folder_->path("out")},
         3, "--focal-length");
  refuse(command({"--object-size", "45", "--focal-length", focal, "--init", "1,2"}), 2,
         "--init: 1,2");
  refuse(command({"--object-size", "45,20", "--focal-length", focal}), 2,
         "--object-size has 2 numbers");
  refuse(command({"--object-size", "45000", "--focal-length", focal}), 3, "is --object-size right");
  Arguments two = command({"--object-size", "45", "--focal-length", focal});
  two.insert(two.begin() + 3, folder_->path("absent.jpg"));
  refuse(two, 4, "absent.jpg");
  refuse(command({"--object-size", "45", "--focal-length", focal, "--light", "sun", "--gray-card",
                  "0,0,16,16"}),
         2, "--gray-card is for a flash or a panorama");
  refuse(command({"--object-size", "45", "--focal-length", focal, "--sun-elevation", "30"}), 2,
         "--light sun");
  refuse(command({"--object-size", "45", "--focal-length", focal, "--camera-down", "1,2", "--light",
                  "sun"}),
         2, "2 numbers for 1 photographs");
  refuse(command({"--object-size", "45", "--focal-length", focal, "--camera-down", "10"}), 2,
         "say --light");
  refuse({kItn, "fit", folder_->path("a.exr"), "--shape", "mug", "--object-size", "45",
          "--g-of-each-colour", "-o", folder_->path("out")},
         2, "say --g-error");
  for (const auto& [flag, value] : {std::pair{"--index", "1.3"}, {"--camera-down", "10"}}) {
    refuse({kItn, "fit", folder_->path("a.exr"), "--scene", scene, flag, value, "-o",
            folder_->path("out")},
           2, "the scene of --scene says them");
  }
}

}  // namespace
}  // namespace itn
