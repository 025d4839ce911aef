// Rendering until an image is good enough.
#include "client/render/render_rounds.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "client/render/local_renderer.h"
#include "client/render/reply_images.h"
#include "common/scene/wire_array.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using namespace testing;
using std::chrono::steady_clock;
using ::testing::FloatNear;
using ::testing::Pointwise;

TEST(RenderRounds, AreOneWithoutAnEarlierEnd) {
  const RenderGoal goal{.spp = 100, .estimates = 3};
  EXPECT_EQ(next_round(goal, {}), 100U);
  EXPECT_EQ(next_round(goal, {.spp = 100}), 0U);
}

TEST(RenderRounds, HaveASampleForEachEstimate) {
  for (const uint32_t spp : {70U, 64U, 65U, 1000U}) {
    const RenderGoal goal{.noise = 1e-4, .spp = spp, .estimates = 16};
    RenderedSoFar so_far{.noise = 1};
    while (const uint32_t round = next_round(goal, so_far)) {
      EXPECT_GE(round, 16U);
      so_far.spp += round;
      ++so_far.rounds;
      EXPECT_TRUE(so_far.spp == spp || so_far.spp % 16 == 0);
    }
    EXPECT_EQ(so_far.spp, spp);
  }
}

TEST(RenderRounds, GoOnAsLongAsTheNoiseNeeds) {
  const RenderGoal goal{.noise = 0.01, .spp = 1 << 20, .estimates = 3};
  EXPECT_EQ(next_round(goal, {}), 6U);  // divided by the estimates
  EXPECT_EQ(next_round({.noise = 0.01, .spp = 1 << 20, .estimates = 16}, {}), 16U);
  EXPECT_EQ(next_round(goal, {.spp = 300, .noise = 0.009}), 0U);
  // Four times the samples for half the noise, and 5 % more.
  EXPECT_EQ(next_round(goal, {.spp = 300, .noise = 0.02}), 900U);
  EXPECT_EQ(next_round(goal, {.spp = 300, .noise = 0.015}), 408U);
  EXPECT_EQ(next_round(goal, {.spp = 300, .noise = 0.0101}), 36U);
  EXPECT_EQ(next_round(goal, {.spp = 3000, .noise = 0.1}), 4095U);
  EXPECT_EQ(
      next_round({.noise = 0.01, .spp = 1 << 20, .estimates = 16}, {.spp = 16, .noise = 0.0101}),
      16U);  // no less than what divides
  EXPECT_EQ(next_round({.noise = 0.01, .spp = 500}, {.spp = 300, .noise = 0.02}), 200U);
  EXPECT_EQ(next_round({.noise = 0.01, .spp = 300}, {.spp = 300, .noise = 0.02}), 0U);
}

TEST(RenderRounds, GoOnAsLongAsThereIsTime) {
  const RenderGoal goal{.seconds = 100, .spp = 1 << 20};
  const auto after = [&](double seconds, double seconds_per_sample) {
    return next_round(goal,
                      {.spp = 1000, .seconds = seconds, .seconds_per_sample = seconds_per_sample});
  };
  EXPECT_EQ(next_round(goal, {}), 8U);
  EXPECT_EQ(after(10, 1e-6), 3000U);  // as many again, three times
  EXPECT_EQ(after(10, 0.1), 250U);    // a quarter of the time
  EXPECT_EQ(after(90, 0.1), 100U);
  EXPECT_EQ(after(99.99, 0.1), 0U);
  EXPECT_EQ(after(150, 0.1), 0U);
}

TEST(RenderRounds, MeasureTheNoiseOnTheObject) {
  EXPECT_DOUBLE_EQ(noise_on_object({100, 2, 4}, {50, 0.3F, 0.5F}, {0, 1, 1}),
                   std::sqrt((double{0.3F} * 0.3F + 0.25) / 2) / 3);
  EXPECT_DOUBLE_EQ(noise_on_object({2, 4}, {0.5F, 0.5F}, {0, 0}), 0.5 / 3);
  EXPECT_EQ(noise_on_object({0, 0}, {0, 0}, {1, 1}), 0);
}

RenderJob job() {
  RenderJob job;
  job.scene = serialize(cube_scene(16, 12));
  job.request = small_request(50);
  job.request.set_estimates(3);
  job.request.clear_derivatives();
  for (const char* name : {"sigma_t", "g"}) job.request.add_parameters(name);
  job.request.add_albedos(0.5);
  return job;
}

// Instead of its material and albedo.
RenderJob job_in_colours() {
  RenderJob in_colours = job();
  v1::Scene scene = cube_scene(16, 12);
  scene.mutable_film()->set_channel(v1::Film::RGB);
  in_colours.scene = serialize(scene);
  in_colours.request.clear_material();
  in_colours.request.clear_albedos();
  for (const double sigma_t : {8, 9, 12}) {
    v1::Material& colour = *in_colours.request.add_colours();
    colour.set_sigma_t(sigma_t);
    colour.set_albedo(6 / sigma_t);
  }
  return in_colours;
}

// Against the reply to all samples at once; standard errors come from floats twice.
void expect_same(const v1::RenderGradReply& rounds, const v1::RenderGradReply& whole) {
  const auto compare = [](const std::string& a, const std::string& b, const char* what,
                          double part = 1e-6) {
    const std::vector<float> x = from_bytes<float>(a), y = from_bytes<float>(b);
    ASSERT_EQ(x.size(), y.size()) << what;
    float largest = 0;
    for (const float value : y) largest = std::max(largest, std::abs(value));
    EXPECT_THAT(x, Pointwise(FloatNear(static_cast<float>(part * largest)), y)) << what;
  };
  ASSERT_EQ(rounds.estimates_size(), whole.estimates_size());
  for (int k = 0; k < whole.estimates_size(); ++k) {
    const v1::Estimate &a = rounds.estimates(k), &b = whole.estimates(k);
    compare(a.radiance(), b.radiance(), "radiance");
    ASSERT_EQ(a.derivatives_size(), b.derivatives_size());
    for (int d = 0; d < a.derivatives_size(); ++d) {
      compare(a.derivatives(d), b.derivatives(d), "a derivative");
    }
    ASSERT_EQ(a.at_albedos_size(), b.at_albedos_size());
    for (int i = 0; i < a.at_albedos_size(); ++i) {
      compare(a.at_albedos(i), b.at_albedos(i), "another albedo");
    }
    ASSERT_EQ(a.colours_size(), b.colours_size());
    for (int c = 0; c < a.colours_size(); ++c) compare(a.colours(c), b.colours(c), "a colour");
  }
  ASSERT_EQ(rounds.colour_standard_errors_size(), whole.colour_standard_errors_size());
  for (int c = 0; c < whole.colour_standard_errors_size(); ++c) {
    compare(rounds.colour_standard_errors(c), whole.colour_standard_errors(c),
            "standard error of a colour", 1e-5);
  }
  compare(rounds.mask(), whole.mask(), "mask");
  compare(rounds.standard_error(), whole.standard_error(), "standard error", 1e-5);
  EXPECT_EQ(rounds.counters().paths(), whole.counters().paths());
  EXPECT_EQ(rounds.counters().steps(), whole.counters().steps());
}

TEST(RenderRounds, MakeTheImageOfAllSamples) {
  SceneCache cache(size_t{64} << 20);
  LocalRenderer renderer(cache, 1);
  for (RenderJob part : {job(), job_in_colours()}) {
    const v1::RenderGradReply whole = renderer.submit(part).get();
    part.request.set_spp(21);
    v1::RenderGradReply rounds = renderer.submit(part).get();
    part.request.set_spp(50 - 21);
    part.request.set_first_sample(21);
    add_samples(renderer.submit(part).get(), 50 - 21, rounds, 21);
    expect_same(rounds, whole);
  }
}

TEST(RenderRounds, EndWhenTheNoisiestImageIsGoodEnough) {
  SceneCache cache(size_t{64} << 20);
  LocalRenderer renderer(cache, 1);
  std::vector<RenderJob> jobs{job(), job()};
  jobs[1].request.mutable_material()->set_albedo(0.5);
  const auto noise = [](const v1::RenderGradReply& reply, uint32_t spp) {
    return noise_on_object(mean_radiance(reply, spp), from_bytes<float>(reply.standard_error()),
                           from_bytes<float>(reply.mask()));
  };
  const RenderGoal goal{.noise = 0.05, .spp = 1 << 20, .estimates = 3};
  uint32_t rounds = 0, begun = 1;
  const RoundsReply done =
      render_rounds(renderer, jobs, goal, steady_clock::now(),
                    [&](const RenderedSoFar& so_far, uint32_t /*round*/, double /*fraction*/) {
                      if (begun != so_far.spp) ++rounds;
                      begun = so_far.spp;
                    });
  EXPECT_GT(rounds, 1U);
  ASSERT_EQ(done.replies.size(), 2U);
  for (size_t i = 0; i < jobs.size(); ++i) {
    EXPECT_LE(noise(done.replies[i], done.spp), goal.noise);
    jobs[i].request.set_spp(done.spp);
    expect_same(done.replies[i], renderer.submit(jobs[i]).get());
  }
  EXPECT_GT(std::max(noise(done.replies[0], done.spp), noise(done.replies[1], done.spp)),
            0.8 * goal.noise);  // and hardly better
}

}  // namespace
}  // namespace itn
