#include "client/render/shared_colours.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <string>
#include <vector>

#include "client/measured_media.h"
#include "client/render/render_job.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

bool pays(const std::string& medium, double mm) {
  const MeasuredMedium& measured = measured_medium(medium);
  const std::array media{measured.material(0), measured.material(1), measured.material(2)};
  return shared_paths_pay(media, mm);
}

// The costs are those that tracer_bench colours measured.
TEST(SharedPaths, PayUnlessLightScattersOftenByOtherCoefficients) {
  EXPECT_TRUE(pays("marble", 30));
  EXPECT_TRUE(pays("skin1", 30));
  EXPECT_TRUE(pays("skimmilk", 30));
  EXPECT_FALSE(pays("spectralon", 30));
  EXPECT_TRUE(pays("cream", 3));
  EXPECT_FALSE(pays("cream", 30));
}

TEST(SharedPaths, PayWhereOnlyAlbedosDiffer) {
  for (const double g : {0.0, 0.9, -0.9}) {
    const std::array media{Material{1e5, 1, g}, Material{1e5, 0.5, g}, Material{1e5, 0, g}};
    EXPECT_TRUE(shared_paths_pay(media, 1e3));
  }
}

TEST(SharedPaths, AreNamedByAllTheirMedia) {
  RenderJob job{serialize(testing::cube_scene(16, 12)), testing::small_request(50)};
  EXPECT_THAT(describe(job), ::testing::HasSubstr("sigma_t 8, albedo 0.9, g 0.3, seed 5"));
  job.request.clear_material();
  for (const double sigma_t : {8, 9, 12}) {
    v1::Material& colour = *job.request.add_colours();
    colour.set_sigma_t(sigma_t);
    colour.set_albedo(0.5);
    colour.set_g(0.2);
  }
  EXPECT_THAT(describe(job), ::testing::HasSubstr("sigma_t 8/9/12, albedo 0.5/0.5/0.5, g 0.2"));
}

TEST(SharedPaths, AreTakenApartByColour) {
  v1::RenderGradReply reply;
  reply.set_width(2);
  reply.set_height(1);
  reply.set_mask("mask");
  reply.set_standard_error("of luminance");
  for (const std::string colour : {"r", "g", "b"}) {
    reply.add_colour_standard_errors("error " + colour);
  }
  for (const std::string k : {"0", "1"}) {
    v1::Estimate& estimate = *reply.add_estimates();
    estimate.set_radiance("luminance");
    for (const std::string what : {"sigma_t", "g"}) {
      for (const std::string colour : {"r", "g", "b"}) {
        estimate.add_derivatives(what + colour + k);
      }
    }
    for (const std::string colour : {"r", "g", "b"}) estimate.add_colours(colour + k);
  }
  const v1::RenderGradReply green = reply_in_colour(reply, 1);
  EXPECT_EQ(green.width(), 2U);
  EXPECT_EQ(green.height(), 1U);
  EXPECT_EQ(green.mask(), "mask");
  EXPECT_EQ(green.standard_error(), "error g");
  ASSERT_EQ(green.estimates_size(), 2);
  EXPECT_EQ(green.estimates(1).radiance(), "g1");
  ASSERT_EQ(green.estimates(1).derivatives_size(), 2);
  EXPECT_EQ(green.estimates(1).derivatives(0), "sigma_tg1");
  EXPECT_EQ(green.estimates(1).derivatives(1), "gg1");
}

}  // namespace
}  // namespace itn
