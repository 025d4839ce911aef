#include "client/refine/scene_unknown.h"

#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "client/scene/text_proto.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using namespace testing;

v1::Scene scene(const std::string& text) {
  v1::Scene result;
  parse_text_proto(text, "scene", result);
  return result;
}

// Around what a test says of it.
std::string scene_with(const std::string& object) {
  return "object { mesh { builtin: \"cube\" } " + object + R"( }
surfaces { rectangle { half_u { x: 1 } half_v { z: -1 } } }
surfaces {
  rectangle { half_u { x: 1 } half_v { z: -1 } }
  checkerboard { even: 0.6 edge_u { x: 1 } edge_v { z: 1 } }
}
lights { sphere { center { x: 3 y: 4 } } }
camera { origin { z: -5 } target { } }
film { width: 2 height: 2 }
)";
}
const std::string kScene = scene_with("rough_dielectric { roughness: 0.2 }");

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
}

TEST(SceneUnknown, SaysWhatIsWrong) {
  const auto refuse = [](const std::vector<std::string>& names,
                         const std::vector<std::string>& parts,
                         const std::string& second = kScene) {
    std::vector<v1::Scene> scenes{scene(kScene), scene(second)};
    expect_error(ErrorKind::kInvalidInput, parts, [&] { scene_unknowns(names, scenes); });
  };
  refuse({"ior"}, {"ior is not a parameter", "rough_dielectric.index"});
  refuse({"albedo"}, {"albedo cannot be refined", "is of the medium"});
  refuse({"surface[2].reflectance"}, {"surface[2].reflectance", "it has 2 surfaces"});
  refuse({"light[1].sphere.center.x"}, {"light[1].sphere.center.x", "it has 1 lights"});
  refuse({"light[0].panel.center.x"}, {"lights[0] is sphere"});
  refuse({"surface[0].image.scale"}, {"surfaces[0] is of one reflectance"});
  refuse({"surface[1].reflectance"}, {"surfaces[1] is checkerboard"});
  refuse({"rough_dielectric.index", "rough_dielectric.index"}, {"asked for twice"});
  refuse({"rough_dielectric.index"}, {"the boundary is index-matched"}, scene_with(""));
  refuse({"rough_dielectric.index"}, {"1.5 in the first scene", "1.25 in another"},
         scene_with("rough_dielectric { index: 1.25 }"));
}

}  // namespace
}  // namespace itn
