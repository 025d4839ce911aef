#include "client/image/channels.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/expect_error.h"

namespace itn {
namespace {

using testing::expect_error;
using Names = std::vector<std::string>;

Image image_with(const Names& channels) {
  Image image{.width = 1, .height = 1, .channels = {}, .attributes = {}};
  for (const std::string& name : channels) image.channels[name] = {1};
  return image;
}

TEST(RadianceChannels, AreFoundByTheNamesThatProgramsGiveThem) {
  const struct {
    Names there, wanted;
  } rows[] = {
      {{"R", "G", "B"}, {"R", "G", "B"}},
      {{"R", "G", "B", "A"}, {"R", "G", "B"}},
      {{"Y"}, {"Y"}},
      {{"L"}, {"L"}},
      {{"L", "A"}, {"L"}},
      {{"env"}, {"env"}},
      {{"Z"}, {"Z"}},
      {{"intensity", "A", "mask.Y"}, {"intensity"}},
      {{"env.R", "env.G", "env.B"}, {"env.R", "env.G", "env.B"}},
      {{"env.Y", "mask.Y"}, {"env.Y"}},
      // Blender.
      {{"ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B",
        "ViewLayer.Combined.A", "ViewLayer.Depth.Z"},
       {"ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B"}},
      {{"ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B",
        "ViewLayer.Normal.X", "ViewLayer.Normal.Y", "ViewLayer.Normal.Z", "ViewLayer.DiffDir.R",
        "ViewLayer.DiffDir.G", "ViewLayer.DiffDir.B"},
       {"ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B"}},
      // Ours.
      {{"Y", "sigma_t.Y", "albedo.Y", "mask.Y", "stderr.Y", "estimate0.Y"}, {"Y"}},
      {{"R", "G", "B", "Y"}, {"R", "G", "B"}},
  };
  for (const auto& row : rows) {
    EXPECT_EQ(radiance_channels(image_with(row.there), "a.exr"), row.wanted);
  }
}

TEST(RadianceChannels, AreThoseOfTheLayerThatIsNamed) {
  const Image image = image_with({"a.Y", "b.R", "b.G", "b.B"});
  EXPECT_EQ(radiance_channels(image, "a.exr", "b"), (Names{"b.R", "b.G", "b.B"}));
  EXPECT_EQ(radiance_channels(image, "a.exr", "a"), Names{"a.Y"});
  expect_error(ErrorKind::kInvalidInput, {"a.exr", "there is no layer c"},
               [&] { radiance_channels(image, "a.exr", "c"); });
}

TEST(RadianceChannels, AreNotGuessed) {
  expect_error(ErrorKind::kInvalidInput, {"a.exr has the channels B, R", "wanted are R, G and B"},
               [] {
                 radiance_channels(image_with({"R", "B"}), "a.exr");
               });
  expect_error(ErrorKind::kInvalidInput, {"which of the layers a, b"}, [] {
    radiance_channels(image_with({"a.Y", "b.R", "b.G", "b.B"}), "a.exr");
  });
  expect_error(ErrorKind::kInvalidInput, {"mask.Y"},
               [] { radiance_channels(image_with({"mask.Y"}), "a.exr"); });
}

TEST(MaskChannel, IsFound) {
  EXPECT_EQ(mask_channel(image_with({"mask.Y", "Y"}), "m.exr"), "mask.Y");
  EXPECT_EQ(mask_channel(image_with({"Y"}), "m.exr"), "Y");
  EXPECT_EQ(mask_channel(image_with({"R", "G", "B", "A"}), "m.exr"), "R");
  EXPECT_EQ(mask_channel(image_with({"matte"}), "m.exr"), "matte");
  expect_error(ErrorKind::kInvalidInput, {"m.exr has the channels Z, matte", "mask.Y"}, [] {
    mask_channel(image_with({"matte", "Z"}), "m.exr");
  });
}

}  // namespace
}  // namespace itn
