#include "client/training/sphere_colour.h"

#include <gtest/gtest.h>

#include <array>
#include <optional>
#include <vector>

#include "client/render_pool/render_pool.h"
#include "client/training/evaluation.h"
#include "tests/support/statistics.h"

namespace itn {
namespace {

class SphereColourTest : public ::testing::Test {
 protected:
  RenderPool pool_{RenderPoolOptions()};
};

v1::RoughDielectric gloss() {
  v1::RoughDielectric boundary;
  boundary.set_index(1.5F);
  boundary.set_roughness(0.3F);
  return boundary;
}

// Light that comes alike from all sides leaves a thing that absorbs nothing alike to all sides.
TEST_F(SphereColourTest, WhatAbsorbsNothingIsWhite) {
  const std::array<Material, 3> media{{{.sigma_t = 5, .albedo = 1, .g = 0},
                                       {.sigma_t = 20, .albedo = 1, .g = 0.5},
                                       {.sigma_t = 1, .albedo = 1, .g = -0.2}}};
  for (const std::optional<v1::RoughDielectric>& boundary :
       {std::optional<v1::RoughDielectric>(), std::optional(gloss())}) {
    std::array<std::vector<double>, 3> colours;
    for (uint64_t seed = 0; seed < 10; ++seed) {
      const std::array<double, 3> colour = sphere_colour(pool_, media, boundary, 16, seed);
      for (size_t c = 0; c < 3; ++c) colours[c].push_back(colour[c]);
    }
    for (size_t c = 0; c < 3; ++c) {
      const double mean = testing::over_batches(colours[c]).mean;
      EXPECT_NEAR(mean, 1, 0.01) << "colour " << c << (boundary ? ", glossy" : "");
    }
  }
}

TEST_F(SphereColourTest, WhatAbsorbsOneColourLacksIt) {
  const std::array<Material, 3> media{{{.sigma_t = 50, .albedo = 0.9999, .g = 0},
                                       {.sigma_t = 50, .albedo = 0.95, .g = 0},
                                       {.sigma_t = 50, .albedo = 0.3, .g = 0}}};
  const std::array<double, 3> colour = sphere_colour(pool_, media, gloss(), 64, 1);
  EXPECT_GT(colour[0], 0.9);
  EXPECT_LT(colour[1], 0.7);
  EXPECT_LT(colour[2], 0.2);
  EXPECT_GT(colour[2], 0.02);  // the gloss is white
}

TEST(ColourDifferences, AreThoseOfMostImages) {
  std::vector<std::array<double, 3>> truth(11, {0.5, 0.5, 0.5}), answers = truth;
  for (size_t i = 6; i < answers.size(); ++i) answers[i] = {0, 0, 0};
  v1::Evaluation::Row row;
  set_colour_differences(answers, truth, row);
  EXPECT_EQ(row.colour_difference(), 0);
  EXPECT_GT(row.colour_difference_of_nine_in_ten(), 50);
  v1::Evaluation::Row none;
  set_colour_differences({}, {}, none);
  EXPECT_FALSE(none.has_colour_difference());
}

}  // namespace
}  // namespace itn
