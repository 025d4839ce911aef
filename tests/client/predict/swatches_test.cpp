#include "client/predict/swatches.h"

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "client/render_pool/render_pool.h"
#include "client/scene/text_proto.h"
#include "common/scene/material_proto.h"
#include "common/scene/scene_bytes.h"
#include "common/scene/wire_array.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

constexpr std::array<Material, 1> kMaterial{Material{30, 0.9, 0.2}};

// A cube left of the middle and above it.
v1::Scene wide_scene(uint32_t width, uint32_t height) {
  v1::Scene scene;
  parse_text_proto(
      "object { mesh { builtin: \"cube\" } } lights { constant {} } "
      "camera { origin { x: .6 z: -30 } target { x: .6 } fov_degrees: 4 }",
      "scene", scene);
  scene.mutable_film()->set_width(width);
  scene.mutable_film()->set_height(height);
  return scene;
}

PredictInput photograph_of(RenderPool& pool, int width, int height) {
  RenderJob job;
  job.scene = serialize(wide_scene(width, height));
  *job.request.mutable_material() = to_proto(kMaterial[0]);
  job.request.set_spp(64);
  job.request.set_pixels(v1::OBJECT_PIXELS);
  const v1::RenderGradReply reply = pool.submit(std::move(job)).get();
  const auto image = from_bytes<float>(reply.estimates(0).radiance());
  std::vector<float> mask;
  for (const float value : image) mask.push_back(value > 0 ? 1 : 0);
  const Photograph photograph{width, height, 1, image, mask};
  return {.name = "photograph",
          .channels = {"Y"},
          .photograph = framed(photograph),
          .capture = {},
          .width = width,
          .height = height};
}

// Pixels that are of the object in one and not in the other, as a part of the object's.
double mismatch(const std::vector<float>& mask, const std::vector<float>& rendered) {
  double wrong = 0, object = 0;
  for (size_t p = 0; p < mask.size(); ++p) {
    object += mask[p] > 0 ? 1 : 0;
    wrong += (mask[p] > 0) != (rendered[p] > 0) ? 1 : 0;
  }
  return wrong / object;
}

TEST(Rerendered, LiesWhereThePhotographsObjectDoes) {
  RenderPool pool{RenderPoolOptions()};
  for (const int width : {96, 960}) {  // as fine as the photograph, and coarser
    const PredictInput photograph = photograph_of(pool, width, width * 2 / 3);
    ASSERT_GT(photograph.photograph.square.left, 0);
    const std::vector<float> rendered =
        rerendered(pool, wide_scene(48, 32), photograph, kMaterial, 64);
    EXPECT_LT(mismatch(photograph.photograph.mask, rendered), width == 96 ? 0.01 : 0.03);
  }
}

TEST(Rerendered, RefusesAFilmOfOtherSides) {
  RenderPool pool{RenderPoolOptions()};
  const PredictInput photograph = photograph_of(pool, 48, 32);
  testing::expect_error(ErrorKind::kInvalidInput, {"32 x 32", "48 x 32"},
                        [&] { rerendered(pool, wide_scene(32, 32), photograph, kMaterial, 4); });
}

}  // namespace
}  // namespace itn
