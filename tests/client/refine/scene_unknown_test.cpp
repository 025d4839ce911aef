#include "client/refine/scene_unknown.h"

#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "common/scene/text_proto.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using namespace testing;

v1::Scene scene(const std::string& text) {
  v1::Scene result;
  parse_text_proto(text, "scene", result);
  return result;
}

const char* const kScene = R"(
object { rough_dielectric { roughness: 0.2 } }
surfaces { }
surfaces { checkerboard { even: 0.6 } }
lights { sphere { center { x: 3 y: 4 } } }
)";

TEST(SceneUnknown, StartsWhereTheSceneHasItOrByDefault) {
  std::vector<v1::Scene> scenes{scene(kScene), scene(kScene)};
  const std::vector<std::string> names = {
      "rough_dielectric.roughness",   "rough_dielectric.index",   "surface[0].reflectance",
      "surface[1].checkerboard.even", "light[0].sphere.center.x", "light[0].sphere.center.z"};
  const std::vector<SceneUnknown> unknowns = scene_unknowns(names, scenes);
  ASSERT_EQ(unknowns.size(), names.size());
  const std::array<std::array<float, 3>, 6> expected = {
      {{0.2F, 0.001F, 1}, {1.5F, 1.1F, 2.5F}, {0.5F, 0, 1}, {0.6F, 0, 1}, {3, -2, 8}, {0, -5, 5}}};
  for (size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(unknowns[i].name, names[i]);
    EXPECT_FLOAT_EQ(static_cast<float>(unknowns[i].start), expected[i][0]) << names[i];
    EXPECT_FLOAT_EQ(static_cast<float>(unknowns[i].range.low), expected[i][1]) << names[i];
    EXPECT_FLOAT_EQ(static_cast<float>(unknowns[i].range.high), expected[i][2]) << names[i];
  }
  set_unknowns(unknowns, std::array{0.3, 1.25, 0.75, 0.5, 2.5, -1.0}, scenes[0]);
  EXPECT_FLOAT_EQ(scenes[0].object().rough_dielectric().roughness(), 0.3F);
  EXPECT_FLOAT_EQ(scenes[0].object().rough_dielectric().index(), 1.25F);
  EXPECT_FLOAT_EQ(scenes[0].surfaces(0).reflectance(), 0.75F);
  EXPECT_FLOAT_EQ(scenes[0].surfaces(1).checkerboard().even(), 0.5F);
  EXPECT_FLOAT_EQ(scenes[0].lights(0).sphere().center().x(), 2.5F);
  EXPECT_FLOAT_EQ(scenes[0].lights(0).sphere().center().z(), -1);
}

TEST(SceneUnknown, SaysWhatIsWrong) {
  const auto refuse = [](const std::vector<std::string>& names,
                         const std::vector<std::string>& parts, const char* second = kScene) {
    std::vector<v1::Scene> scenes{scene(kScene), scene(second)};
    expect_error(ErrorKind::kInvalidInput, parts, [&] { scene_unknowns(names, scenes); });
  };
  refuse({"ior"}, {"ior is not a parameter", "rough_dielectric.index"});
  refuse({"albedo"}, {"albedo cannot be refined", "no number of the boundary, the surfaces"});
  refuse({"surface[2].reflectance"}, {"surface[2].reflectance", "the scene has 2 surfaces"});
  refuse({"light[1].sphere.center.x"}, {"light[1].sphere.center.x", "the scene has 1 lights"});
  refuse({"light[0].panel.center.x"}, {"scene.lights[0] has no panel"});
  refuse({"surface[0].image.scale"}, {"scene.surfaces[0] has no image"});
  refuse({"surface[1].reflectance"}, {"scene.surfaces[1] has a pattern instead"});
  refuse({"rough_dielectric.index", "rough_dielectric.index"}, {"asked for twice"});
  refuse({"rough_dielectric.index"}, {"scene.object has no rough_dielectric"}, "");
  refuse({"rough_dielectric.index"}, {"1.5 in the first scene", "1.25 in another"},
         "object { rough_dielectric { index: 1.25 } }");
}

}  // namespace
}  // namespace itn
