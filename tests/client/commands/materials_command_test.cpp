// Measured media: itn materials, and itn render --material, as processes.
#include <gmock/gmock.h>

#include <gtest/gtest.h>
#include <algorithm>

#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "client/image/image.h"
#include "common/files/read_file.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/scene_files.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace testing;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(MaterialsCommand, ListsMedia) {
  const Finished done = run({kItn, "materials"});
  EXPECT_EQ(done.exit_code, 0);
  EXPECT_THAT(done.output, HasSubstr("marble"));
  EXPECT_THAT(done.output, HasSubstr("Narasimhan et al. 2006"));
}

// In 1/mm, times the scene's unit; with the index of the list, or another one.
TEST(MaterialsCommand, ListsOneMedium) {
  const Finished finished = run({testing::kItn, "materials", "marble"});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, HasSubstr("marble "));
  EXPECT_EQ(std::count(finished.output.begin(), finished.output.end(), '\n'), 2);
  EXPECT_EQ(run({testing::kItn, "materials", "marbel"}).exit_code, 3);
}

TEST(MaterialsCommand, WritesAFileForARenderer) {
  const TemporaryFolder folder;
  const std::string file = folder.path("marble.pbrt");
  const Finished done = run({kItn, "materials", "marble", "--format", "pbrt", "--roughness", "0.1",
                             "--scene-unit", "cm", "-o", file});
  EXPECT_EQ(done.exit_code, 0) << done.errors;
  const std::string text = read_file(file, "file");
  EXPECT_THAT(text, HasSubstr("from Jensen et al. 2001"));
  EXPECT_THAT(text, HasSubstr("\"rgb sigma_s\" [ 2.19 2.62 3 ]"));
  EXPECT_THAT(text, HasSubstr("\"float scale\" 10"));
  EXPECT_THAT(text, HasSubstr("\"float eta\" 1.5\n"));
  EXPECT_THAT(text, HasSubstr("\"float roughness\" 0.1\n"));
  EXPECT_THAT(run({kItn, "materials", "marble", "--format", "mitsuba", "--index", "1"}).output,
              HasSubstr("type=\"null\""));
  const Finished row = run({kItn, "materials", "marble"});
  EXPECT_THAT(row.output, HasSubstr("marble"));
  EXPECT_THAT(row.output, Not(HasSubstr("skimmilk")));
  const Finished unknown = run({kItn, "materials", "granite"});
  EXPECT_EQ(unknown.exit_code, 3);
  EXPECT_THAT(unknown.errors, HasSubstr("granite is no measured medium"));
  const Finished other = run({kItn, "materials", "marble", "--format", "mitsuba", "-o", file});
  EXPECT_EQ(other.exit_code, 2);
  EXPECT_THAT(other.errors, HasSubstr("files of --format mitsuba are named .xml; .pbrt are those"));
  EXPECT_EQ(read_file(file, "file"), text);
  EXPECT_EQ(run({kItn, "materials", "--format", "pbrt"}).exit_code, 2);
  EXPECT_EQ(run({kItn, "materials", "marble", "--format", "vray"}).exit_code, 2);
  EXPECT_THAT(run({kItn, "materials", "granite", "--format", "pbrt"}).errors,
              HasSubstr("granite is no measured medium"));
}

TEST(MaterialsCommand, TakesNumbersOfOnesOwn) {
  const std::vector<std::string> wax{kItn,       "materials", "--sigma-t", "12,14,18",
                                     "--albedo", "0.9",       "--g",       "0.3"};
  const auto with = [&](std::vector<std::string> flags) {
    flags.insert(flags.begin(), wax.begin(), wax.end());
    return run(flags);
  };
  const Finished row = with({});
  ASSERT_EQ(row.exit_code, 0) << row.errors;
  EXPECT_THAT(row.output, HasSubstr("12        14        18"));
  const Finished file = with({"--format", "pbrt", "--index", "1.45", "--roughness", "0.2"});
  ASSERT_EQ(file.exit_code, 0) << file.errors;
  EXPECT_THAT(file.output, HasSubstr("\"rgb sigma_s\" [ 10.8 12.6 16.2 ]"));
  EXPECT_THAT(file.output, HasSubstr("\"float eta\" 1.45\n"));
  EXPECT_THAT(file.output, HasSubstr("\"float roughness\" 0.2\n"));
  // Without an index there is no surface.
  EXPECT_THAT(with({"--format", "mitsuba"}).output, HasSubstr("type=\"null\""));
  EXPECT_EQ(with({"marble"}).exit_code, 2);
  EXPECT_THAT(with({"--format", "pbrt", "--roughness", "0.2"}).errors, HasSubstr("give --index"));
  EXPECT_EQ(run({kItn, "materials", "--sigma-t", "12"}).exit_code, 2);
  EXPECT_EQ(run({kItn, "materials", "--sigma-t", "12,13", "--albedo", "0.9"}).exit_code, 2);
  EXPECT_EQ(run({kItn, "materials", "--sigma-t", "12", "--albedo", "1.1"}).exit_code, 2);
}

TEST(MaterialsCommand, TakesWhatRefineFound) {
  const TemporaryFolder folder;
  std::vector<std::string> folders;
  for (const char* const sigma_t : {"10", "20", "40"}) {
    const auto one = folder.path(std::string("refined") + sigma_t);
    std::filesystem::create_directory(one);
    std::ofstream(one + "/result.json")
        << R"({"material": {"sigma_t": )" << sigma_t << R"(, "albedo": 0.9, "g": 0.3},
               "sigma_t": {"value": 20, "low_95": 19, "high_95": 21},
               "index": 1.4, "roughness": 0.25,
               "remarks": ["g is not told"]})";
    folders.push_back(one);
  }
  const Finished one = run({kItn, "materials", "--refined", folders[1], "--format", "pbrt"});
  ASSERT_EQ(one.exit_code, 0) << one.errors;
  EXPECT_THAT(one.output, HasSubstr("\"rgb sigma_s\" [ 18 18 18 ]"));
  EXPECT_THAT(one.output, HasSubstr("\"float eta\" 1.4\n"));
  EXPECT_THAT(one.output, HasSubstr("\"float roughness\" 0.25\n"));
  EXPECT_THAT(one.output, HasSubstr("sigma_t 20 (19 to 21)"));
  EXPECT_THAT(one.output, HasSubstr("g is not told"));
  const Finished three =
      run({kItn, "materials", "--refined", folders[0] + "," + folders[1] + "," + folders[2],
           "--format", "pbrt"});
  EXPECT_THAT(three.output, HasSubstr("\"rgb sigma_s\" [ 9 18 36 ]"));
  const std::string misfit = folder.path("misfit");
  std::filesystem::create_directory(misfit);
  std::ofstream(misfit + "/result.json")
      << R"({"material": {"sigma_t": 9, "albedo": 0.9}, "sigma_t": {"value": 9, "low_95": 8},
             "misfit": true})";
  const Finished doubtful = run({kItn, "materials", "--refined", misfit, "--format", "pbrt"});
  EXPECT_THAT(doubtful.output, AllOf(HasSubstr("a misfit"), Not(HasSubstr("95 %"))));
  std::filesystem::create_directory(folder.path("stopped"));
  std::ofstream(folder.path("stopped") + "/state.itn") << "";
  EXPECT_THAT(run({kItn, "materials", "--refined", folder.path("stopped")}).errors,
              HasSubstr("has a refinement that was stopped"));
  std::ofstream(folders[0] + "/result.json") << "{";
  const Finished broken = run({kItn, "materials", "--refined", folders[0]});
  EXPECT_EQ(broken.exit_code, 3);
  EXPECT_THAT(broken.errors, HasSubstr("result.json is no RefineResult as JSON"));
  EXPECT_EQ(run({kItn, "materials", "--refined", folder.path("none")}).exit_code, 4);
}

class RenderMaterial : public ::testing::Test {
 protected:
  Finished render(std::vector<std::string> flags) const {
    flags.insert(flags.begin(), {kItn, "render", source("client/examples/cube.textproto"), "-o",
                                 folder_.path("a.exr"), "--spp", "1", "--film", "8"});
    return run(flags);
  }
  TemporaryFolder folder_;
};

// The cube is 1 mm; a cube of 50 mm is 50 times as thick. Luminance is the channel G.
TEST_F(RenderMaterial, IsScaledToTheObject) {
  const Finished done = render({"--material", "marble", "--object-size", "50"});
  EXPECT_EQ(done.exit_code, 0) << done.errors;
  EXPECT_THAT(done.output, HasSubstr("sigma_t 131.2 / mm, albedo 0.99844, g 0"));
}

// If the channels have paths of their own, as for a derivative in a light, a colour image has what
// renders of the channels have, to the bit: lights and media in them.
TEST_F(RenderMaterial, InColourIsThreeChannels) {
  const auto with = [&](std::vector<std::string> flags) {
    flags.insert(flags.end(), {"--derivatives", "light[0].scale"});
    const Finished done = render(flags);
    EXPECT_EQ(done.exit_code, 0) << done.errors;
    return read_exr(folder_.path("a.exr"));
  };
  const Image colour = with({"--material", "skin1", "--color"});
  const Image same = with({"--sigma-t", "0.772,1.085,1.570", "--albedo", "0.9,0.8,0.7"});
  EXPECT_TRUE(same.has("R") && same.has("B")) << same.channel_names();
  EXPECT_FALSE(colour.has("Y"));
  std::ifstream file(source("client/examples/cube.textproto"));
  const std::string scene(std::istreambuf_iterator<char>(file), {});
  for (const auto& [name, channel] :
       {std::pair{"R", "RED"}, std::pair{"G", "GREEN"}, std::pair{"B", "BLUE"}}) {
    const std::string path = folder_.path("scene.textproto");
    const size_t film = scene.find("film {") + 6;
    std::ofstream(path) << scene.substr(0, film) << " channel: " << channel << scene.substr(film);
    const Finished done =
        run({kItn, "render", path, "-o", folder_.path("gray.exr"), "--film", "8", "--spp", "1",
             "--derivatives", "light[0].scale", "--material", "skin1"});
    ASSERT_EQ(done.exit_code, 0) << done.errors;
    const Image gray = read_exr(folder_.path("gray.exr"));
    const std::string dot = std::string(".") + name;
    EXPECT_EQ(colour.channel(name), gray.channel("Y"));
    EXPECT_EQ(colour.channel("stderr" + dot), gray.channel("stderr.Y"));
    EXPECT_EQ(colour.channel("light[0].scale" + dot), gray.channel("light[0].scale.Y"));
    EXPECT_EQ(std::get<double>(colour.attributes.at("itn.sigma_t" + dot)),
              std::get<double>(gray.attributes.at("itn.sigma_t")));
  }
}

// One render has all channels where that costs less; of a thick medium whose channels differ, or of
// several g, it does not.
TEST_F(RenderMaterial, ChannelsShareTheirPaths) {
  const auto paths_of = [&](const std::vector<std::string>& flags) {
    const Finished done = render(flags);
    EXPECT_EQ(done.exit_code, 0) << done.errors;
    const Image image = read_exr(folder_.path("a.exr"));
    for (const char* name : {"R", "G", "B", "stderr.G", "sigma_a.B", "mask.Y"}) {
      EXPECT_TRUE(image.has(name)) << name << " of " << image.channel_names();
    }
    return std::get<double>(image.attributes.at("itn.paths"));
  };
  const auto in_colour = [](std::vector<std::string> flags) {
    flags.insert(flags.end(), {"--color", "--derivatives", "sigma_a"});
    return flags;
  };
  EXPECT_EQ(paths_of(in_colour({"--material", "skin1"})), 64);
  EXPECT_EQ(paths_of(in_colour({"--material", "cream", "--object-size", "100"})), 3 * 64);
  EXPECT_EQ(paths_of(in_colour({"--material", "espresso"})), 3 * 64);
}

// The scene may name the medium; flags go before it.
TEST_F(RenderMaterial, IsThatOfTheScene) {
  const auto rendered = [&](const std::string& medium, const std::vector<std::string>& flags) {
    const std::string scene = folder_.write(
        "scene.textproto",
        replaced(read_file(source("client/examples/cube.textproto"), "scene"),
                 "builtin: \"cube\" }", "builtin: \"cube\" } medium { " + medium + " }"));
    std::vector<std::string> command = {kItn,    "render", scene,    "-o", folder_.path("a.exr"),
                                        "--spp", "1",      "--film", "8"};
    command.insert(command.end(), flags.begin(), flags.end());
    return run(command);
  };
  const std::string marble = "name: \"marble\" object_size: 50";
  EXPECT_THAT(rendered(marble, {}).output, HasSubstr("sigma_t 131.2 / mm, albedo 0.99844, g 0"));
  EXPECT_THAT(rendered(marble, {"--sigma-t", "3", "--albedo", "0.5"}).output,
              HasSubstr("sigma_t 3 / mm, albedo 0.5, g 0"));
  EXPECT_THAT(rendered("name: \"granite\"", {}).errors, HasSubstr("granite is no measured medium"));
  EXPECT_THAT(rendered("name: \"marble\" object_size: -1", {}).errors,
              HasSubstr("object.medium.object_size is -1; it must be in [0, 1e+06]"));
}

// Or say its numbers; and other objects have media of their own, in each channel another.
TEST_F(RenderMaterial, OtherObjectsHaveTheirOwn) {
  const std::string example =
      replaced(read_file(source("client/examples/three.textproto"), "scene"),
               "width: 480 height: 270", "width: 24 height: 14");
  const auto rendered = [&](const std::string& scene, const std::vector<std::string>& flags) {
    std::vector<std::string> command = {
        kItn,    "render", folder_.write("scene.textproto", scene), "-o", folder_.path("a.exr"),
        "--spp", "4"};
    command.insert(command.end(), flags.begin(), flags.end());
    return run(command);
  };
  const auto changed = [&](const std::string& from, const std::string& to) {
    return replaced(example, from, to);
  };
  // The ratio is that of the thing of skim milk, which is seen to the right.
  const auto red_over_blue = [&](const std::string& scene) {
    const Finished done = rendered(scene, {"--color"});
    EXPECT_EQ(done.exit_code, 0) << done.errors;
    const Image image = read_exr(folder_.path("a.exr"));
    double red = 0, blue = 0;
    for (size_t pixel = 0; pixel < image.channel("R").size(); ++pixel) {
      if (pixel % 24 < 16 || image.channel("mask.Y")[pixel] < 0.9F) continue;
      red += double{image.channel("R")[pixel]};
      blue += double{image.channel("B")[pixel]};
    }
    return red / blue;
  };
  const double milk = red_over_blue(example);
  const double ketchup = red_over_blue(changed("\"skimmilk\" object_size: 40", "\"ketchup\""));
  EXPECT_GT(ketchup, 1.5 * milk);

  const Finished numbers = rendered(changed("medium { name: \"marble\" object_size: 60 }",
                                            "material { sigma_t: 7 albedo: 0.25 }"),
                                    {});
  EXPECT_THAT(numbers.output, HasSubstr("sigma_t 7 / mm, albedo 0.25, g 0")) << numbers.errors;
  const std::string three =
      "material { sigma_t: 7 albedo: 0.2 } material { sigma_t: 8 albedo: 0.3 g: 0.5 } "
      "material { sigma_t: 9 albedo: 0.4 }";
  const Finished in_colour =
      rendered(changed("medium { name: \"marble\" object_size: 60 }", three), {"--color"});
  EXPECT_THAT(in_colour.output, HasSubstr("R: sigma_t 7 / mm, albedo 0.2, g 0"))
      << in_colour.errors;
  EXPECT_THAT(in_colour.output, HasSubstr("G: sigma_t 8 / mm, albedo 0.3, g 0.5"));
  EXPECT_THAT(in_colour.output, HasSubstr("B: sigma_t 9 / mm, albedo 0.4, g 0"));
  EXPECT_THAT(rendered(changed("\"skimmilk\"", "\"granite\""), {}).errors,
              HasSubstr("granite is no measured medium"));
  EXPECT_THAT(rendered(changed("medium { name: \"skimmilk\" object_size: 40 }", ""), {}).errors,
              HasSubstr("scene.other_objects[0].material is missing"));
  EXPECT_THAT(rendered(changed("sigma_t: 45", "sigma_t: -45"), {}).errors,
              HasSubstr("scene.other_objects[1].material.sigma_t is -45"));
  EXPECT_THAT(rendered(changed("  material { sigma_t: 45 albedo: 0.98 g: 0.3 }\n", ""), {}).errors,
              HasSubstr("scene.other_objects[1] has 2 materials; it must have one, or 3"));
  EXPECT_THAT(rendered(changed("material { sigma_t: 55",
                               "medium { name: \"marble\" } material { sigma_t: 55"),
                       {})
                  .errors,
              HasSubstr("scene.other_objects[1] has a medium and a material"));
  EXPECT_THAT(rendered(changed("rough_dielectric { index: 1.6 roughness: 0.3 }", ""), {}).errors,
              HasSubstr("other_objects[1] is index-matched and the object rough_dielectric"));
  EXPECT_THAT(rendered(changed("x: 0.85 z: -0.15", "x: 0.3"), {}).errors,
              HasSubstr("object with other_objects"));
}

TEST_F(RenderMaterial, RefusesWhatDoesNotFit) {
  EXPECT_EQ(render({}).exit_code, 2);
  EXPECT_THAT(render({"--sigma-t", "3"}).errors, HasSubstr("--sigma-t and --albedo are required"));
  EXPECT_EQ(render({"--material", "marble", "--albedo", "0.5"}).exit_code, 2);
  EXPECT_EQ(render({"--sigma-t", "1", "--albedo", "0.5", "--object-size", "5"}).exit_code, 2);
  EXPECT_THAT(render({"--sigma-t", "1,2", "--albedo", "0.5"}).errors,
              HasSubstr("--sigma-t: 2 numbers; it takes one, or those of R, G and B"));
  EXPECT_THAT(render({"--sigma-t", "1", "--albedo", "0.5,2,0.5"}).errors,
              HasSubstr("--albedo: 2 is not a number in [0, 1]"));
  EXPECT_THAT(render({"--material", "granite"}).errors, HasSubstr("granite is no measured medium"));
}

}  // namespace
}  // namespace itn
