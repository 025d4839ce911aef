#include "client/render_pool/reply_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <string>

#include "tests/support/expect_error.h"
#include "tests/support/fake_worker.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

// The value of the third pixel.
void set(std::string& image, float value) {
  std::memcpy(image.data() + 2 * sizeof value, &value, sizeof value);
}

struct Damage {
  const char* name;
  bool loss;  // in the answer to a request for a loss, or for images
  std::function<void(v1::RenderGradReply&)> apply;
  const char* says;
};

class DamagedReply : public ::testing::TestWithParam<Damage> {};

TEST_P(DamagedReply, IsNotTaken) {
  RenderJob job;
  job.scene = serialize(testing::cube_scene(16, 12));
  job.request = testing::small_request();
  job.request.add_albedos(0.5);
  for (int c = 0; c < 3; ++c) job.request.add_colours();
  if (GetParam().loss) job.request.mutable_loss();
  v1::RenderGradReply reply;
  testing::constant_answer(job.request, reply);
  EXPECT_NO_THROW(check_reply(reply, job));
  GetParam().apply(reply);
  testing::expect_error(ErrorKind::kInternal, {"the reply cannot be right: ", GetParam().says},
                        [&] { check_reply(reply, job); });
}

const Damage kDamages[] = {
    {"Empty", false, [](auto& r) { r.Clear(); }, "width is 0 rather than 16"},
    {"OtherHeight", false, [](auto& r) { r.set_height(16); }, "height is 16 rather than 12"},
    {"TooFewEstimates", false, [](auto& r) { r.mutable_estimates()->RemoveLast(); },
     "the number of estimates is 1 rather than 2"},
    {"ShortImage", false, [](auto& r) { r.mutable_estimates(1)->mutable_radiance()->pop_back(); },
     "the size of radiance is 767 rather than 768"},
    {"NoDerivative", false,
     [](auto& r) { r.mutable_estimates(0)->mutable_derivatives()->RemoveLast(); },
     "the number of derivatives is 17"},
    {"LongDerivative", false,
     [](auto& r) { r.mutable_estimates(0)->mutable_derivatives(3)->append("xxxx"); },
     "the size of a derivative is 772"},
    {"NoAlbedo", false, [](auto& r) { r.mutable_estimates(0)->clear_at_albedos(); },
     "the number of at_albedos is 0 rather than 1"},
    {"TwoColours", false, [](auto& r) { r.mutable_estimates(1)->mutable_colours()->RemoveLast(); },
     "the number of colours is 2 rather than 3"},
    {"NegativeColour", false, [](auto& r) { set(*r.mutable_estimates(1)->mutable_colours(2), -1); },
     "radiance in a colour of pixel 2 is -1"},
    {"NoColourErrors", false, [](auto& r) { r.clear_colour_standard_errors(); },
     "the number of colour_standard_errors is 0 rather than 3"},
    {"NanColourError", false,
     [](auto& r) { set(*r.mutable_colour_standard_errors(0), static_cast<float>(kNan)); },
     "a standard error of a colour of pixel 2 is nan"},
    {"NanRadiance", false,
     [](auto& r) { set(*r.mutable_estimates(0)->mutable_radiance(), static_cast<float>(kNan)); },
     "radiance of pixel 2 is nan"},
    {"NegativeRadiance", false,
     [](auto& r) { set(*r.mutable_estimates(1)->mutable_radiance(), -1e-6F); },
     "radiance of pixel 2 is -1e-06"},
    {"InfiniteDerivative", false,
     [](auto& r) { set(*r.mutable_estimates(1)->mutable_derivatives(0), -kInfinity); },
     "a derivative of pixel 2 is -inf"},
    {"InfiniteAtAlbedo", false,
     [](auto& r) { set(*r.mutable_estimates(1)->mutable_at_albedos(0), kInfinity); },
     "radiance at an albedo of pixel 2 is inf"},
    {"NoMask", false, [](auto& r) { r.clear_mask(); }, "the size of mask is 0"},
    {"MaskBeyondOne", false, [](auto& r) { set(*r.mutable_mask(), 1.5F); },
     "mask of pixel 2 is 1.5"},
    {"NegativeError", false, [](auto& r) { set(*r.mutable_standard_error(), -1); },
     "standard_error of pixel 2 is -1"},
    {"MoreLeaksThanPaths", false, [](auto& r) { r.mutable_counters()->set_leaks(1); },
     "1 leaks of 0 paths"},
    {"NanLoss", true, [](auto& r) { r.set_loss(kNan); }, "the loss is nan"},
    {"NoGradient", true, [](auto& r) { r.clear_loss_gradient(); },
     "the number of gradients is 0 rather than 6"},
    {"InfiniteGradient", true, [](auto& r) { r.set_loss_gradient(2, HUGE_VAL); },
     "a gradient is inf"},
    {"NanSeconds", true, [](auto& r) { r.mutable_counters()->set_cpu_seconds(kNan); },
     "cpu_seconds is nan"},
};

TEST(GradientReply, HasANumberForEachDerivative) {
  RenderJob job;
  job.scene = serialize(testing::cube_scene(16, 12));
  v1::RenderGradRequest images;
  v1::RenderGradReply reply;
  testing::constant_answer(images, reply);
  job.request.add_parameters("g");
  job.request.mutable_gradient();
  const auto refused = [&](const char* says) {
    testing::expect_error(ErrorKind::kInternal, {says}, [&] { check_reply(reply, job); });
  };
  refused("the number of gradients is 0 rather than 1");
  reply.mutable_estimates(0)->add_gradient(0.5);
  EXPECT_NO_THROW(check_reply(reply, job));
  reply.mutable_estimates(0)->set_light_gradient(std::string(8, '\0'));
  refused("light_gradient has 8 bytes");
  job.request.mutable_gradient()->set_light(0);
  EXPECT_NO_THROW(check_reply(reply, job));
  reply.mutable_estimates(0)->mutable_light_gradient()->pop_back();
  refused("light_gradient has 7 bytes");
  job.request.mutable_gradient()->clear_light();
  reply.mutable_estimates(0)->clear_light_gradient();
  reply.mutable_estimates(0)->set_gradient(0, kNan);
  refused("a gradient is nan");
}

INSTANTIATE_TEST_SUITE_P(ReplyCheck, DamagedReply, ::testing::ValuesIn(kDamages),
                         [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace itn
