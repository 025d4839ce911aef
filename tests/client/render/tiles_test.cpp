#include "client/render/tiles.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "common/scene/wire_array.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

v1::Tile tile(uint32_t x, uint32_t y, uint32_t width, uint32_t height) {
  v1::Tile tile;
  tile.set_x(x);
  tile.set_y(y);
  tile.set_width(width);
  tile.set_height(height);
  return tile;
}

TEST(Tiles, CoverEveryPixelOnce) {
  for (const v1::Tile& whole : {tile(0, 0, 1, 1), tile(0, 0, 512, 512), tile(3, 5, 701, 33)}) {
    for (const uint32_t spp : {1U, 64U, 1U << 20}) {
      std::vector<int> seen(size_t{whole.width()} * whole.height());
      for (const v1::Tile& t : tiles_of(whole, spp)) {
        for (uint32_t y = t.y(); y < t.y() + t.height(); ++y) {
          for (uint32_t x = t.x(); x < t.x() + t.width(); ++x) {
            ++seen.at(size_t{y - whole.y()} * whole.width() + x - whole.x());
          }
        }
      }
      EXPECT_EQ(std::ranges::count(seen, 1), static_cast<ptrdiff_t>(seen.size()));
    }
  }
}

TEST(Tiles, AreAsLargeAsTheirWork) {
  EXPECT_EQ(tiles_of(tile(0, 0, 64, 64), 64).size(), 1U);
  EXPECT_EQ(tiles_of(tile(0, 0, 512, 512), 64).size(), 64U);
  EXPECT_EQ(tiles_of(tile(0, 0, 512, 512), 64, 4).size(), 16U);
  EXPECT_EQ(tiles_of(tile(0, 0, 64, 64), 1 << 20).size(), 16U);  // not less than 16 x 16 pixels
}

TEST(Tiles, OfATileLieInIt) {
  RenderJob job;
  job.scene = serialize(testing::cube_scene(16, 12));
  EXPECT_EQ(pixels_of(job).width(), 16U);
  EXPECT_EQ(pixels_of(job).height(), 12U);
  *job.request.mutable_tile() = tile(2, 3, 4, 5);
  EXPECT_EQ(pixels_of(job).x(), 2U);
  EXPECT_EQ(pixels_of(job).height(), 5U);
}

// An answer whose images count up from `first`.
v1::RenderGradReply answer(const v1::Tile& tile, float first) {
  std::vector<float> values(size_t{tile.width()} * tile.height());
  const auto image = [&](float offset) {
    std::ranges::generate(values, [value = first + offset]() mutable { return value++; });
    return to_bytes(values);
  };
  v1::RenderGradReply reply;
  for (int k = 0; k < 2; ++k) {
    v1::Estimate& estimate = *reply.add_estimates();
    estimate.set_radiance(image(100));
    estimate.add_derivatives(image(200));
    estimate.add_derivatives(image(300));
    estimate.add_at_albedos(image(400));
    estimate.add_colours(image(700));
  }
  reply.set_mask(image(500));
  reply.set_standard_error(image(600));
  reply.add_colour_standard_errors(image(800));
  reply.mutable_counters()->set_paths(10);
  reply.mutable_counters()->set_leaks(1);
  return reply;
}

TEST(Tiles, HaveGradientsThatAreAddedUp) {
  TiledReply whole(tile(0, 0, 4, 2));
  for (const uint32_t x : {0U, 2U}) {
    v1::RenderGradReply part = answer(tile(x, 0, 2, 2), 0);
    v1::Estimate& estimate = *part.mutable_estimates(0);
    estimate.add_gradient(x + 1.5);
    estimate.add_gradient(-1);
    estimate.set_light_gradient(to_bytes(std::vector<float>{1, 2.5F, 3}));
    whole.add(tile(x, 0, 2, 2), part);
  }
  const v1::RenderGradReply sum = whole.take();
  EXPECT_EQ(sum.estimates(0).gradient(0), 5);
  EXPECT_EQ(sum.estimates(0).gradient(1), -2);
  EXPECT_EQ(from_bytes<float>(sum.estimates(0).light_gradient()), (std::vector<float>{2, 5, 6}));
  EXPECT_EQ(sum.estimates(0).normal_gradient(), "");
}

TEST(Tiles, ArePutTogether) {
  const v1::Tile whole = tile(10, 20, 3, 2), left = tile(10, 20, 2, 2), right = tile(12, 20, 1, 2);
  TiledReply tiled(whole);
  tiled.add(right, answer(right, 50));
  tiled.add(left, answer(left, 0));
  const v1::RenderGradReply reply = tiled.take();
  EXPECT_EQ(reply.width(), 3U);
  EXPECT_EQ(reply.height(), 2U);
  const auto expected = [](float offset) {
    return to_bytes(
        std::vector<float>{offset, offset + 1, offset + 50, offset + 2, offset + 3, offset + 51});
  };
  ASSERT_EQ(reply.estimates_size(), 2);
  for (const v1::Estimate& estimate : reply.estimates()) {
    EXPECT_EQ(estimate.radiance(), expected(100));
    ASSERT_EQ(estimate.derivatives_size(), 2);
    EXPECT_EQ(estimate.derivatives(0), expected(200));
    EXPECT_EQ(estimate.derivatives(1), expected(300));
    ASSERT_EQ(estimate.at_albedos_size(), 1);
    EXPECT_EQ(estimate.at_albedos(0), expected(400));
    ASSERT_EQ(estimate.colours_size(), 1);
    EXPECT_EQ(estimate.colours(0), expected(700));
  }
  EXPECT_EQ(reply.mask(), expected(500));
  EXPECT_EQ(reply.standard_error(), expected(600));
  ASSERT_EQ(reply.colour_standard_errors_size(), 1);
  EXPECT_EQ(reply.colour_standard_errors(0), expected(800));
  EXPECT_EQ(reply.counters().paths(), 20U);
  EXPECT_EQ(reply.counters().leaks(), 2U);
}

}  // namespace
}  // namespace itn
