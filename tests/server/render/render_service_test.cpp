// The render service behind real channels.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <grpcpp/create_channel.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <future>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <ostream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/rpc/channel.h"
#include "common/error.h"
#include "common/luminance.h"
#include "common/scene/material_proto.h"
#include "common/scene/scene_bytes.h"
#include "common/scene/wire_array.h"
#include "itn/v1/render.grpc.pb.h"
#include "server/render/render_reply.h"
#include "server/render/render_server.h"
#include "server/render/weighted_image_loss.h"
#include "server/scene_compiler/request_builder.h"
#include "tests/support/health.h"
#include "tests/support/process.h"
#include "tests/support/raw_call.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using namespace testing;
using ::testing::HasSubstr;

struct Answer {
  grpc::Status status;
  v1::RenderGradReply reply;
};

class Client {
 public:
  explicit Client(const std::shared_ptr<grpc::Channel>& channel)
      : stub_(v1::RenderService::NewStub(channel)) {}

  Answer call(const v1::RenderGradRequest& request, std::chrono::milliseconds deadline = 60s) {
    grpc::ClientContext context;
    return call(context, request, deadline);
  }

  Answer call(grpc::ClientContext& context, const v1::RenderGradRequest& request,
              std::chrono::milliseconds deadline = 60s) {
    context.set_deadline(std::chrono::system_clock::now() + deadline);
    Answer answer;
    answer.status = stub_->RenderGrad(&context, request, &answer.reply);
    return answer;
  }

  v1::Capabilities capabilities() {
    grpc::ClientContext context;
    v1::Capabilities reply;
    EXPECT_TRUE(stub_->GetCapabilities(&context, {}, &reply).ok());
    return reply;
  }

 private:
  std::unique_ptr<v1::RenderService::Stub> stub_;
};

v1::RenderGradRequest with_scene(v1::RenderGradRequest request,
                                 const v1::Scene& scene = cube_scene()) {
  request.set_scene(serialize(scene)->bytes);
  return request;
}

RenderServerOptions options_with(const std::function<void(RenderServiceOptions&)>& change) {
  RenderServerOptions options;
  options.service.threads = 1;
  change(options.service);
  return options;
}

RenderServerOptions one_thread() {
  return options_with([](RenderServiceOptions&) {});
}

std::shared_ptr<grpc::Channel> connect(const RenderServer& server) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(server.address(), grpc::InsecureChannelCredentials(), arguments);
}

void set_loss(v1::RenderGradRequest& request, const std::vector<float>& image,
              const std::vector<float>& weight) {
  request.mutable_loss()->set_image(to_bytes(image));
  request.mutable_loss()->set_weight(to_bytes(weight));
}

// ---- Answers ---------------------------------------------------------------------------------

TEST(RenderService, GivesTheSameBytesWhereverAndWithHoweverManyThreads) {
  RenderServer one(one_thread());
  auto options = options_with([](auto& o) { o.threads = 2; });
  options.listen = "127.0.0.1:0";
  RenderServer two(options);
  const auto request = with_scene(small_request());
  const Answer a = Client(one.in_process_channel()).call(request);
  const Answer b = Client(two.in_process_channel()).call(request);
  const Answer c = Client(connect(two)).call(request);
  ASSERT_TRUE(a.status.ok()) << a.status.error_message();
  EXPECT_EQ(deterministic_bytes(a.reply), deterministic_bytes(b.reply));
  EXPECT_EQ(deterministic_bytes(a.reply), deterministic_bytes(c.reply));
  EXPECT_EQ(a.reply.counters().invalid_samples(), 0U);
  EXPECT_EQ(a.reply.counters().paths(), 16U * 12 * 8);
}

TEST(RenderService, ReturnsTheImagesInTheOrderAsked) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  auto request = with_scene(small_request());
  const Answer all = client.call(request);
  ASSERT_TRUE(all.status.ok()) << all.status.error_message();
  EXPECT_EQ(all.reply.width(), 16U);
  EXPECT_EQ(all.reply.height(), 12U);
  request.clear_derivatives();
  request.add_derivatives(v1::SIGMA_S);
  request.add_derivatives(v1::G);
  const Answer two = client.call(request);
  ASSERT_TRUE(two.status.ok()) << two.status.error_message();
  for (int k = 0; k < 2; ++k) {
    EXPECT_EQ(two.reply.estimates(k).derivatives(0), all.reply.estimates(k).derivatives(4));
    EXPECT_EQ(two.reply.estimates(k).derivatives(1), all.reply.estimates(k).derivatives(2));
  }
}

TEST(RenderService, AppliesTheChainRule) {
  RenderServer server(one_thread());
  const Answer answer = Client(server.in_process_channel()).call(with_scene(small_request()));
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  const auto& estimate = answer.reply.estimates(0);
  const auto d_t = from_bytes<float>(estimate.derivatives(0)),
             d_albedo = from_bytes<float>(estimate.derivatives(1));
  const auto d_a = from_bytes<float>(estimate.derivatives(3)),
             d_s = from_bytes<float>(estimate.derivatives(4));
  const auto d_reduced = from_bytes<float>(estimate.derivatives(5));
  double total = 0;
  for (size_t i = 0; i < d_t.size(); ++i) {
    const double scale = 1e-5 * (1 + std::abs(d_t[i]) + std::abs(d_albedo[i]));
    EXPECT_NEAR(d_a[i], d_t[i] - 0.9 / 8 * d_albedo[i], scale);
    EXPECT_NEAR(d_s[i], d_t[i] + 0.1 / 8 * d_albedo[i], scale);
    EXPECT_NEAR(d_reduced[i], d_s[i] / 0.7, scale);
    total += std::abs(d_t[i]);
  }
  EXPECT_GT(total, 0);
}

// The loss that a worker answers with is that of the images that it would have sent, and its
// gradient follows the chain rule.
TEST(RenderService, AnswersWithLossAndGradient) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::RenderGradRequest request = with_scene(small_request());
  request.set_spp(32);
  request.set_estimates(4);
  request.set_pixels(v1::OBJECT_PIXELS);
  request.clear_derivatives();
  for (const v1::Parameter p : {v1::SIGMA_T, v1::ALBEDO, v1::G}) request.add_derivatives(p);
  const v1::RenderGradReply images = client.call(request).reply;
  const size_t pixels = size_t{images.width()} * images.height();
  ASSERT_GT(pixels, 0U);
  const std::vector<float> image(pixels, 5);
  const std::vector<float> mask = from_bytes<float>(images.mask());
  std::vector<float> weight(pixels);
  for (size_t p = 0; p < pixels; ++p) weight[p] = static_cast<float>(p % 3) * (mask[p] > 0 ? 1 : 0);
  std::vector<RenderEstimate> estimates;
  for (const v1::Estimate& e : images.estimates()) {
    estimates.push_back({from_bytes<float>(e.radiance()),
                         {from_bytes<float>(e.derivatives(0)), from_bytes<float>(e.derivatives(1)),
                          from_bytes<float>(e.derivatives(2))},
                         {}});
  }
  const LossWithGradient expected = weighted_image_loss(image, weight, estimates);

  set_loss(request, image, weight);
  const Answer answer = client.call(request);
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  EXPECT_DOUBLE_EQ(answer.reply.loss(), expected.value);
  ASSERT_EQ(answer.reply.loss_gradient_size(), 3);
  for (int i = 0; i < 3; ++i) {
    EXPECT_DOUBLE_EQ(answer.reply.loss_gradient(i), expected.gradient[static_cast<size_t>(i)]);
  }
  EXPECT_TRUE(answer.reply.estimates().empty());

  request.clear_derivatives();
  request.add_derivatives(v1::SIGMA_S_REDUCED);
  const Answer reduced = client.call(request);
  const auto& m = request.material();
  const double by_sigma_s =
      expected.gradient[0] + expected.gradient[1] * (1 - m.albedo()) / m.sigma_t();
  ASSERT_EQ(reduced.reply.loss_gradient_size(), 1);
  EXPECT_NEAR(reduced.reply.loss_gradient(0), by_sigma_s / (1 - m.g()),
              1e-9 * std::abs(by_sigma_s));
}

// Its sums are over all pixels; those that are not rendered are 0 in the image.
TEST(RenderService, CountsPixelsThatAreNotRenderedInTheLoss) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::RenderGradRequest request = with_scene(small_request());
  request.set_pixels(v1::OBJECT_PIXELS);
  request.clear_derivatives();
  request.add_derivatives(v1::ALBEDO);
  const v1::RenderGradReply images = client.call(request).reply;
  const size_t pixels = size_t{images.width()} * images.height();
  const std::vector<float> image(pixels, 5), weight(pixels, 1);
  std::vector<RenderEstimate> estimates;
  for (const v1::Estimate& e : images.estimates()) {
    estimates.push_back(
        {from_bytes<float>(e.radiance()), {from_bytes<float>(e.derivatives(0))}, {}});
  }
  const auto dark = std::count(estimates[0].radiance.begin(), estimates[0].radiance.end(), 0.0F);
  ASSERT_GT(dark, 20);
  const LossWithGradient expected = weighted_image_loss(image, weight, estimates);
  set_loss(request, image, weight);
  const Answer answer = client.call(request);
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  EXPECT_DOUBLE_EQ(answer.reply.loss(), expected.value);
  EXPECT_DOUBLE_EQ(answer.reply.loss_gradient(0), expected.gradient[0]);
}

// With a pilot, the samples of a loss go where its weight and image say.
TEST(RenderService, PutsTheSamplesOfALossWhereItNeedsThem) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::RenderGradRequest request = with_scene(small_request());
  request.set_spp(32);
  request.set_estimates(2);
  request.set_pilot_spp(4);
  request.clear_derivatives();
  request.add_derivatives(v1::ALBEDO);
  const tracer::Scene scene(build_scene(parse_scene(request.scene()), {}));
  const size_t pixels = static_cast<size_t>(scene.width()) * static_cast<size_t>(scene.height());
  std::vector<float> image(pixels), weight(pixels);
  for (size_t p = 0; p < pixels; ++p) {
    image[p] = 1 + static_cast<float>(p % 7);
    weight[p] = static_cast<float>(p % 3);
  }
  set_loss(request, image, weight);
  const Answer answer = client.call(request);
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();

  tracer::RenderRequest asked = build_request(request, {}).asked;
  asked.sampling_weights = loss_sampling_weights(image, weight);
  const tracer::FilmSums sums = render_grad(scene, asked);
  const LossWithGradient expected = weighted_image_loss(image, weight, means(sums).estimates);
  EXPECT_DOUBLE_EQ(answer.reply.loss(), expected.value);
  EXPECT_DOUBLE_EQ(answer.reply.loss_gradient(0), expected.gradient.at(0));
}

// Derivatives in surfaces and lights come after those of the medium; so does their loss gradient.
TEST(RenderService, GivesDerivativesInTheScene) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::RenderGradRequest request = with_scene(small_request());
  request.set_estimates(2);
  request.clear_derivatives();
  request.add_derivatives(v1::SIGMA_A);
  request.add_scene_derivatives("light[0].scale");
  request.add_scene_derivatives("light[1].scale");
  const Answer images = client.call(request);
  ASSERT_TRUE(images.status.ok()) << images.status.error_message();
  ASSERT_EQ(images.reply.estimates(0).derivatives_size(), 3);
  const auto radiance = from_bytes<float>(images.reply.estimates(0).radiance());
  const auto first = from_bytes<float>(images.reply.estimates(0).derivatives(1));
  const auto second = from_bytes<float>(images.reply.estimates(0).derivatives(2));
  const size_t pixels = radiance.size();
  for (size_t p = 0; p < pixels; ++p) {  // all light comes from one or the other
    EXPECT_NEAR(first[p] + second[p], radiance[p], 1e-5F * (1 + radiance[p]));
  }

  const std::vector<float> image(pixels, 1), weight(pixels, 1);
  set_loss(request, image, weight);
  const Answer loss = client.call(request);
  ASSERT_TRUE(loss.status.ok()) << loss.status.error_message();
  const tracer::Scene scene(build_scene(parse_scene(request.scene()), {}));
  const LossWithGradient expected = weighted_image_loss(
      image, weight, means(render_grad(scene, build_request(request, {}).asked)).estimates);
  ASSERT_EQ(loss.reply.loss_gradient_size(), 3);
  EXPECT_DOUBLE_EQ(loss.reply.loss_gradient(2), expected.gradient.back());
}

// One list says all that the two others do, in any order.
TEST(RenderService, TakesParametersOfAllKindsByName) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::RenderGradRequest by_lists = small_request();
  by_lists.clear_derivatives();
  v1::RenderGradRequest by_name = by_lists;
  by_lists.add_derivatives(v1::G);
  by_lists.add_derivatives(v1::SIGMA_S_REDUCED);
  by_lists.add_scene_derivatives("light[0].scale");
  for (const char* name : {"sigma_s_reduced", "light[0].scale", "g"}) by_name.add_parameters(name);
  const Answer lists = client.call(with_scene(by_lists)), names = client.call(with_scene(by_name));
  ASSERT_TRUE(names.status.ok()) << names.status.error_message();
  const v1::Estimate &a = lists.reply.estimates(0), &b = names.reply.estimates(0);
  ASSERT_EQ(b.derivatives_size(), 3);
  EXPECT_EQ(b.derivatives(0), a.derivatives(1));
  EXPECT_EQ(b.derivatives(1), a.derivatives(2));
  EXPECT_EQ(b.derivatives(2), a.derivatives(0));

  by_name.add_parameters("g");
  EXPECT_EQ(client.call(with_scene(by_name)).status.error_message(), "parameters[3] is g again");
  by_name.set_parameters(3, "ior");
  EXPECT_THAT(
      client.call(with_scene(by_name)).status.error_message(),
      ::testing::HasSubstr("ior is not a parameter; there are sigma_t, albedo, g, sigma_a"));
}

TEST(RenderService, RefusesDerivativesThatTheSceneDoesNotHave) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  const auto message = [&](const std::string& name) {
    v1::RenderGradRequest request = with_scene(small_request());
    request.add_scene_derivatives("light[0].scale");
    request.add_scene_derivatives(name);
    const Answer answer = client.call(request);
    EXPECT_EQ(answer.status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << name;
    return answer.status.error_message();
  };
  using ::testing::HasSubstr;
  EXPECT_THAT(message("light[9].scale"), HasSubstr("no derivative in light[9].scale"));
  EXPECT_THAT(message("light[0].scale"), HasSubstr("light[0].scale again"));
  EXPECT_THAT(message("albedo"), HasSubstr("are asked for in derivatives"));
  EXPECT_THAT(message("surface.reflectance"), HasSubstr("surface[K].reflectance"));
}

// The gradient is that of the weighted sum of the images that the same request has, in the same
// order.
TEST(RenderService, AnswersWithAGradient) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::Scene scene = cube_scene();
  auto& map = *scene.add_lights()->mutable_environment_map()->mutable_pixels();
  map.set_width(4);
  map.set_height(2);
  map.set_rgb(to_bytes(std::vector<float>(3 * 8, 0.5F)));
  const auto number = static_cast<uint32_t>(scene.lights_size() - 1);
  const std::string scale = "light[" + std::to_string(number) + "].scale";
  v1::RenderGradRequest request = small_request();
  request.add_scene_derivatives(scale);
  request = with_scene(request, scene);
  const Answer images = client.call(request);
  ASSERT_TRUE(images.status.ok()) << images.status.error_message();
  const v1::Estimate& image = images.reply.estimates(1);
  std::vector<float> weights(from_bytes<float>(image.radiance()).size());
  for (size_t p = 0; p < weights.size(); ++p) weights[p] = static_cast<float>(p % 5) - 1;
  request.mutable_gradient()->set_weight(to_bytes(weights));
  const Answer answer = client.call(request);
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  const v1::Estimate& estimate = answer.reply.estimates(1);
  EXPECT_EQ(estimate.derivatives_size(), 0);
  ASSERT_EQ(estimate.gradient_size(), image.derivatives_size());
  for (int i = 0; i < estimate.gradient_size(); ++i) {
    const auto derivative = from_bytes<float>(image.derivatives(i));
    double sum = 0, size = 0;
    for (size_t p = 0; p < weights.size(); ++p) {
      sum += double{weights[p]} * double{derivative[p]};
      size += std::abs(double{weights[p]} * double{derivative[p]});
    }
    EXPECT_NEAR(estimate.gradient(i), sum, 1e-4 * size) << i;
  }
  EXPECT_TRUE(estimate.light_gradient().empty());

  request.mutable_gradient()->set_light(number);
  const Answer in_pixels = client.call(request);
  ASSERT_TRUE(in_pixels.status.ok()) << in_pixels.status.error_message();
  const v1::Estimate& with_pixels = in_pixels.reply.estimates(1);
  double by_pixels = 0;
  for (const float g : from_bytes<float>(with_pixels.light_gradient()))
    by_pixels += 0.5 * double{g};
  const double whole = with_pixels.gradient(with_pixels.gradient_size() - 1);
  EXPECT_NEAR(by_pixels, whole, 1e-3 * std::abs(whole) + 1e-6);

  const auto refusal = [&](const auto& spoil) {
    v1::RenderGradRequest bad = request;
    spoil(bad);
    return client.call(bad).status.error_message();
  };
  using ::testing::HasSubstr;
  EXPECT_THAT(refusal([](auto& r) { r.mutable_loss(); }), HasSubstr("cannot both be asked for"));
  EXPECT_THAT(refusal([](auto& r) { r.mutable_gradient()->clear_weight(); }),
              HasSubstr("gradient.weight is missing"));
  EXPECT_THAT(refusal([](auto& r) { r.mutable_gradient()->mutable_weight()->resize(8); }),
              HasSubstr("there are 2 gradient weights"));
  EXPECT_THAT(refusal([](auto& r) { r.mutable_gradient()->set_light(0); }),
              HasSubstr("lights[0] is no panorama"));
  EXPECT_THAT(refusal([](auto& r) { r.mutable_gradient()->set_normals(true); }),
              HasSubstr("no gradient in normals: the object has no rough_dielectric"));
}

TEST(RenderService, AnswersWithAGradientInNormals) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::Scene scene = cube_scene();
  scene.mutable_object()->mutable_rough_dielectric();
  const v1::Light of_no_size = scene.lights(1);
  scene.mutable_lights()->RemoveLast();
  v1::RenderGradRequest request = with_scene(small_request(), scene);
  const Answer images = client.call(request);
  ASSERT_TRUE(images.status.ok()) << images.status.error_message();
  const auto radiance = from_bytes<float>(images.reply.estimates(0).radiance());
  request.mutable_gradient()->set_weight(to_bytes(std::vector<float>(radiance.size(), 1)));
  request.mutable_gradient()->set_normals(true);
  const Answer answer = client.call(request);
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  const auto numbers = from_bytes<float>(answer.reply.estimates(0).normal_gradient());
  ASSERT_EQ(numbers.size(), size_t{9} * 12);
  EXPECT_TRUE(std::ranges::any_of(numbers, [](float n) { return n != 0; }));

  const auto refusal = [&](const auto& spoil) {
    v1::RenderGradRequest bad = request;
    v1::Scene bad_scene = scene;
    spoil(bad, bad_scene);
    return client.call(with_scene(bad, bad_scene)).status.error_message();
  };
  using ::testing::HasSubstr;
  EXPECT_THAT(refusal([](auto& r, auto&) { r.set_tracer(v1::REFERENCE); }),
              HasSubstr("the reference tracer knows no gradient in normals"));
  EXPECT_THAT(refusal([](auto& r, auto&) { r.add_parameters("rough_dielectric.index"); }),
              HasSubstr("need a render of each"));
  EXPECT_THAT(refusal([](auto&, auto& s) { s.mutable_object()->mutable_dielectric(); }),
              HasSubstr("the object has no rough_dielectric"));
  EXPECT_THAT(refusal([&](auto&, auto& s) { *s.add_lights() = of_no_size; }),
              HasSubstr("no derivative in normals under lights[1]"));
}

// Its mean cosine is the g of the chain rule: at fixed sigma_a and phase function,
// d/d sigma_s_reduced = (d/d sigma_t + (1 - albedo) / sigma_t d/d albedo) / (1 - mean cosine).
TEST(RenderService, AppliesTheChainRuleToAPhaseFunction) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::RenderGradRequest request = small_request();
  request.mutable_material()->clear_g();
  request.mutable_phase()->mutable_two_term()->set_weight(0.5F);
  request.clear_derivatives();
  for (const auto parameter : {v1::SIGMA_T, v1::ALBEDO, v1::SIGMA_S_REDUCED}) {
    request.add_derivatives(parameter);
  }
  const Answer answer = client.call(with_scene(request));
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  const v1::Estimate& image = answer.reply.estimates(0);
  const auto by_sigma_t = from_bytes<float>(image.derivatives(0));
  const auto by_albedo = from_bytes<float>(image.derivatives(1));
  const auto by_reduced = from_bytes<float>(image.derivatives(2));
  const double sigma_t = request.material().sigma_t(), albedo = request.material().albedo();
  for (size_t p = 0; p < by_reduced.size(); ++p) {
    const double expected =
        (double{by_sigma_t[p]} + (1 - albedo) / sigma_t * double{by_albedo[p]}) / (1 - 0.25);
    EXPECT_NEAR(by_reduced[p], expected, 1e-5 * (1 + std::abs(expected)));
  }
}

TEST(RenderService, GivesSeveralAlbedosInTheOrderAsked) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::RenderGradRequest request = with_scene(small_request());
  request.add_albedos(0);
  request.add_albedos(request.material().albedo());
  const Answer answer = client.call(request);
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  ASSERT_EQ(answer.reply.estimates(0).at_albedos_size(), 2);
  EXPECT_EQ(answer.reply.estimates(0).at_albedos(1), answer.reply.estimates(0).radiance());
  EXPECT_NE(answer.reply.estimates(0).at_albedos(0), answer.reply.estimates(0).radiance());
}

v1::RenderGradRequest colours_request(v1::Film::Channel channel = v1::Film::RGB) {
  v1::Scene scene = cube_scene();
  scene.mutable_film()->set_channel(channel);
  v1::RenderGradRequest request = small_request();
  request.set_scene(scene.SerializeAsString());
  request.clear_material();
  request.clear_derivatives();
  for (const double sigma_t : {8, 12, 10}) {
    v1::Material& colour = *request.add_colours();
    colour.set_sigma_t(sigma_t);
    colour.set_albedo(1 - 2 / sigma_t);
    colour.set_g(0.3);
  }
  return request;
}

// Three images of the radiance and of each derivative, by the chain rule of each colour's material.
TEST(RenderService, GivesColoursInTheirOrder) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::RenderGradRequest request = colours_request();
  for (const char* name : {"sigma_s", "albedo", "sigma_t"}) request.add_parameters(name);
  const Answer answer = client.call(request);
  ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
  EXPECT_EQ(answer.reply.colour_standard_errors_size(), 3);
  const v1::Estimate& estimate = answer.reply.estimates(0);
  ASSERT_EQ(estimate.colours_size(), 3);
  ASSERT_EQ(estimate.derivatives_size(), 9);
  std::vector<double> luminance(from_bytes<float>(estimate.radiance()).size());
  for (int c = 0; c < 3; ++c) {
    const auto radiance = from_bytes<float>(estimate.colours(c));
    const auto derivative = [&](int d) {
      return from_bytes<float>(estimate.derivatives(3 * d + c));
    };
    const auto by_sigma_s = derivative(0), by_albedo = derivative(1), by_sigma_t = derivative(2);
    const auto [sigma_t, albedo, g] = from_proto(request.colours(c));
    for (size_t p = 0; p < radiance.size(); ++p) {
      luminance[p] += kLuminanceOfColours[static_cast<size_t>(c)] * radiance[p];
      const double expected = by_sigma_t[p] + (1 - albedo) / sigma_t * by_albedo[p];
      EXPECT_NEAR(by_sigma_s[p], expected, 1e-5 * (1 + std::abs(expected)));
    }
  }
  const auto radiance = from_bytes<float>(estimate.radiance());
  for (size_t p = 0; p < radiance.size(); ++p) {
    EXPECT_NEAR(radiance[p], luminance[p], 1e-4 * (1 + luminance[p]));
  }
}

TEST(RenderService, RendersATile) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::RenderGradRequest request = with_scene(small_request());
  const Answer whole = client.call(request);
  request.mutable_tile()->set_x(5);
  request.mutable_tile()->set_y(4);
  request.mutable_tile()->set_width(3);
  request.mutable_tile()->set_height(2);
  const Answer part = client.call(request);
  ASSERT_TRUE(part.status.ok()) << part.status.error_message();
  EXPECT_EQ(part.reply.width(), 3U);
  EXPECT_EQ(part.reply.height(), 2U);
  const auto cut = [](const std::string& image) {  // of 16 x 12 float32
    return image.substr(4 * (4 * 16 + 5), 4 * 3) + image.substr(4 * (5 * 16 + 5), 4 * 3);
  };
  for (int k = 0; k < 2; ++k) {
    EXPECT_EQ(part.reply.estimates(k).radiance(), cut(whole.reply.estimates(k).radiance()));
    EXPECT_EQ(part.reply.estimates(k).derivatives(3), cut(whole.reply.estimates(k).derivatives(3)));
  }
  EXPECT_EQ(part.reply.mask(), cut(whole.reply.mask()));
  EXPECT_EQ(part.reply.standard_error(), cut(whole.reply.standard_error()));
}

TEST(RenderService, ReportsItsLimits) {
  RenderServer server(options_with([](auto& o) {
    o.threads = 3;
    o.queue_capacity = 4;
    o.limits = {100, 200, 300, 400'000};
  }));
  const v1::Capabilities c = Client(server.in_process_channel()).capabilities();
  EXPECT_EQ(c.threads(), 3U);
  EXPECT_EQ(c.queue_capacity(), 4U);
  EXPECT_EQ(c.max_pixels(), 100U);
  EXPECT_EQ(c.max_spp(), 200U);
  EXPECT_EQ(c.max_triangles(), 300U);
  EXPECT_EQ(c.max_message_bytes(), 400'000U);
  EXPECT_EQ(c.version(), ITN_VERSION);
}

// ---- Digests ---------------------------------------------------------------------------------

TEST(RenderService, SaysByDigestThatItDoesNotHoldAScene) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  const auto scene = serialize(cube_scene());
  auto by_digest = small_request();
  by_digest.set_scene_digest(scene->digest);

  const Answer unknown = client.call(by_digest);
  EXPECT_EQ(unknown.status.error_code(), grpc::FAILED_PRECONDITION);
  v1::SceneNotHeld details;
  ASSERT_TRUE(details.ParseFromString(unknown.status.error_details()));
  EXPECT_EQ(details.scene_digest(), scene->digest);

  auto with_both = by_digest;
  with_both.set_scene(scene->bytes);
  const Answer sent = client.call(with_both);
  ASSERT_TRUE(sent.status.ok()) << sent.status.error_message();
  const Answer known = client.call(by_digest);
  ASSERT_TRUE(known.status.ok()) << known.status.error_message();
  EXPECT_EQ(deterministic_bytes(sent.reply), deterministic_bytes(known.reply));
}

// ---- Values by name --------------------------------------------------------------------------

v1::Scene lamp_lit_scene() {
  v1::Scene scene = cube_scene();
  scene.clear_surfaces();
  scene.clear_lights();
  scene.mutable_object()->mutable_rough_dielectric()->set_roughness(0.3F);
  v1::Surface& ground = *scene.add_surfaces();
  ground.mutable_rectangle()->mutable_half_u()->set_x(3);
  ground.mutable_rectangle()->mutable_half_v()->set_z(-3);
  ground.set_reflectance(0.5F);
  scene.add_lights()->mutable_constant()->set_radiance(0.5F);
  v1::SphereLight& lamp = *scene.add_lights()->mutable_sphere();
  lamp.mutable_center()->set_x(1);
  lamp.mutable_center()->set_y(2);
  lamp.mutable_center()->set_z(-1);
  lamp.set_radius(0.3F);
  lamp.set_radiance(20);
  return scene;
}

void set_value(v1::RenderGradRequest& request, const std::string& name, double value) {
  v1::NamedValue& set = *request.add_values();
  set.set_name(name);
  set.set_value(value);
}

struct NamedNumber {
  const char* name;
  double value;
  std::function<void(v1::Scene&, v1::RenderGradRequest&)> edit;  // to that value
};

const NamedNumber kNumbers[] = {
    {"rough_dielectric.index", 1.3,
     [](auto& s, auto&) { s.mutable_object()->mutable_rough_dielectric()->set_index(1.3F); }},
    {"rough_dielectric.roughness", 0.45,
     [](auto& s, auto&) { s.mutable_object()->mutable_rough_dielectric()->set_roughness(0.45F); }},
    {"surface[0].reflectance", 0.8,
     [](auto& s, auto&) { s.mutable_surfaces(0)->set_reflectance(0.8F); }},
    {"light[1].sphere.center.x", -0.7,
     [](auto& s, auto&) { s.mutable_lights(1)->mutable_sphere()->mutable_center()->set_x(-0.7F); }},
    {"light[0].scale", 2,
     [](auto& s, auto&) { s.mutable_lights(0)->mutable_constant()->set_radiance(1); }},
    {"sigma_t", 31.5, [](auto&, auto& r) { r.mutable_material()->set_sigma_t(31.5); }},
    {"albedo", 0.375, [](auto&, auto& r) { r.mutable_material()->set_albedo(0.375); }},
    {"g", -0.125, [](auto&, auto& r) { r.mutable_material()->set_g(-0.125); }}};

v1::RenderGradRequest lamp_lit_request() {
  v1::RenderGradRequest request = small_request();
  request.clear_derivatives();
  for (const char* name : {"g", "rough_dielectric.roughness", "surface[0].reflectance"}) {
    request.add_parameters(name);
  }
  return request;
}

// To the bit, whether the worker has the scene, another one of its values, or nothing; one value,
// and all of them.
TEST(RenderService, RendersTheSceneOfTheValuesThatAreSet) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  const auto scene = serialize(lamp_lit_scene());
  const auto expect_as_edited = [&](const std::vector<NamedNumber>& numbers) {
    for (const v1::Tracer tracer : {v1::WAVEFRONT, v1::REFERENCE}) {
      v1::RenderGradRequest by_value = lamp_lit_request(), edited = by_value;
      v1::Scene other = lamp_lit_scene();
      for (const NamedNumber& number : numbers) {
        set_value(by_value, number.name, number.value);
        number.edit(other, edited);
      }
      by_value.set_tracer(tracer);
      edited.set_tracer(tracer);
      RenderServer fresh(one_thread());
      const Answer expected = Client(fresh.in_process_channel()).call(with_scene(edited, other));
      ASSERT_TRUE(expected.status.ok()) << expected.status.error_message();
      by_value.set_scene_digest(scene->digest);
      Answer answer = client.call(by_value);
      if (answer.status.error_code() == grpc::FAILED_PRECONDITION) {
        by_value.set_scene(scene->bytes);
        answer = client.call(by_value);
      }
      ASSERT_TRUE(answer.status.ok()) << answer.status.error_message();
      EXPECT_EQ(deterministic_bytes(answer.reply), deterministic_bytes(expected.reply))
          << numbers[0].name;
    }
  };
  const std::vector<NamedNumber> all(std::begin(kNumbers), std::end(kNumbers));
  for (const NamedNumber& number : all) expect_as_edited({number});
  expect_as_edited(all);
  // Held once, it is so for all values.
  v1::RenderGradRequest other = lamp_lit_request();
  other.set_scene_digest(scene->digest);
  set_value(other, "surface[0].reflectance", 0.25);
  EXPECT_TRUE(client.call(other).status.ok());
}

// Such a request needs no material beside it; and what a scale multiplies, a derivative in it does
// not count.
TEST(RenderService, TakesTheMediumAndTheScalesOfLightsByName) {
  RenderServer server(one_thread());
  Client client(server.in_process_channel());
  v1::RenderGradRequest request = with_scene(lamp_lit_request(), lamp_lit_scene());
  request.clear_parameters();
  request.add_parameters("light[0].scale");
  request.add_parameters("light[1].scale");
  const Answer plain = client.call(request);
  const v1::Material material = request.material();
  request.clear_material();
  set_value(request, "sigma_t", material.sigma_t());
  set_value(request, "albedo", material.albedo());
  set_value(request, "g", material.g());
  const Answer by_name = client.call(request);
  ASSERT_TRUE(by_name.status.ok()) << by_name.status.error_message();
  EXPECT_EQ(deterministic_bytes(by_name.reply), deterministic_bytes(plain.reply));
  set_value(request, "light[1].scale", 4);
  const v1::RenderGradReply reply = client.call(request).reply;
  const auto image = [&](const std::string& bytes) { return from_bytes<float>(bytes); };
  const auto radiance = image(reply.estimates(0).radiance());
  const auto first = image(reply.estimates(0).derivatives(0));
  const auto second = image(reply.estimates(0).derivatives(1));
  double sum = 0;
  for (size_t p = 0; p < radiance.size(); ++p) {
    EXPECT_NEAR(first[p] + 4 * second[p], radiance[p], 1e-5F * (1 + radiance[p]));
    sum += double{second[p]};
  }
  EXPECT_GT(sum, 0);

  v1::RenderGradRequest two_term = with_scene(lamp_lit_request(), lamp_lit_scene());
  two_term.clear_parameters();
  two_term.mutable_material()->clear_g();
  two_term.mutable_phase()->mutable_two_term()->set_g_1(0.25F);
  v1::RenderGradRequest set = two_term;
  set.mutable_phase()->mutable_two_term()->set_g_1(0.75F);
  set_value(set, "two_term.g_1", 0.25);
  EXPECT_EQ(deterministic_bytes(client.call(set).reply),
            deterministic_bytes(client.call(two_term).reply));
}

// ---- Refusals --------------------------------------------------------------------------------

struct BadRequest {
  const char* name;
  std::function<void(v1::RenderGradRequest&)> spoil;
  const char* message;  // a piece of it
  grpc::StatusCode code = grpc::INVALID_ARGUMENT;
};

void film(v1::RenderGradRequest& request, uint32_t width, uint32_t height) {
  v1::Scene scene = cube_scene();
  scene.mutable_film()->set_width(width);
  scene.mutable_film()->set_height(height);
  request.set_scene(scene.SerializeAsString());
}

void open_mesh(v1::RenderGradRequest& request) {
  v1::Scene scene = cube_scene();
  std::string& indices =
      *scene.mutable_object()->mutable_mesh()->mutable_triangles()->mutable_indices();
  indices.resize(indices.size() - 12);
  request.set_scene(scene.SerializeAsString());
}

void inside_out(v1::RenderGradRequest& request) {
  v1::Scene scene = cube_scene();
  std::string& indices =
      *scene.mutable_object()->mutable_mesh()->mutable_triangles()->mutable_indices();
  for (size_t i = 0; i < indices.size(); i += 12)
    std::swap_ranges(&indices[i], &indices[i] + 4, &indices[i] + 4);
  request.set_scene(scene.SerializeAsString());
}

// A loss over the 16 x 12 pixels of cube_scene().
void add_loss(v1::RenderGradRequest& request, float image = 1, float weight = 1) {
  set_loss(request, std::vector<float>(16 * 12, image), std::vector<float>(16 * 12, weight));
}

const BadRequest kBadRequests[] = {
    {"NoScene", [](auto& r) { r.clear_scene(); }, "scene or scene_digest is missing"},
    {"ShortDigest", [](auto& r) { r.set_scene_digest("abc"); },
     "scene_digest has 3 bytes; a SHA-256 has 32"},
    {"WrongDigest", [](auto& r) { r.set_scene_digest(std::string(32, 'x')); },
     "scene_digest is not the SHA-256 of scene"},
    {"NotAScene", [](auto& r) { r.set_scene("\xff\xff"); }, "not a serialized itn.v1.Scene"},
    {"EmptyishScene", [](auto& r) { r.set_scene(std::string("\x1a\x00", 2)); },
     "scene.object is missing"},
    {"NoMaterial", [](auto& r) { r.clear_material(); }, "material is missing"},
    {"SigmaTZero", [](auto& r) { r.mutable_material()->set_sigma_t(0); }, "material.sigma_t is 0"},
    {"SigmaTNan", [](auto& r) { r.mutable_material()->set_sigma_t(std::nan("")); },
     "material.sigma_t is nan"},
    {"SigmaTHuge", [](auto& r) { r.mutable_material()->set_sigma_t(2e6); }, "material.sigma_t is"},
    {"Albedo", [](auto& r) { r.mutable_material()->set_albedo(1.2); },
     "material.albedo is 1.2; it must be in [0, 1]"},
    {"G", [](auto& r) { r.mutable_material()->set_g(1); },
     "material.g is 1; it must be in [-0.99, 0.99]"},
    {"NoSpp", [](auto& r) { r.clear_spp(); }, "spp is 0; it must be in [1, 1048576]"},
    {"HugeSpp", [](auto& r) { r.set_spp(1U << 21); }, "spp is 2097152"},
    {"SppLimit", [](auto& r) { r.set_spp(1001); }, "spp is 1001; this worker accepts at most 1000",
     grpc::RESOURCE_EXHAUSTED},
    {"EmptyTile", [](auto& r) { r.mutable_tile(); }, "tile is 0 x 0 pixels at (0, 0)"},
    {"TileBeyondTheFilm",
     [](auto& r) {
       r.mutable_tile()->set_x(4294967295U);
       r.mutable_tile()->set_width(2);
       r.mutable_tile()->set_height(1);
     },
     "tile is 2 x 1 pixels at (4294967295, 0)"},
    {"UnspecifiedDerivative", [](auto& r) { r.add_derivatives(v1::PARAMETER_UNSPECIFIED); },
     "derivatives[6] is 0"},
    {"UnknownDerivative", [](auto& r) { r.add_derivatives(v1::Parameter(40)); },
     "derivatives[6] is 40"},
    {"RepeatedDerivative", [](auto& r) { r.add_derivatives(v1::G); }, "derivatives[6] is G again"},
    {"TooManyEstimates", [](auto& r) { r.set_estimates(17); }, "estimates is 17"},
    {"MoreEstimatesThanSamples", [](auto& r) { r.set_estimates(9); },
     "estimates is 9; it must be in [1, 8]"},
    {"LossOfOneEstimate",
     [](auto& r) {
       r.set_estimates(1);
       add_loss(r);
     },
     "a loss needs at least 2"},
    {"LossOfATile",
     [](auto& r) {
       r.mutable_tile();
       add_loss(r);
     },
     "loss and tile"},
    {"LossOfAnotherSize",
     [](auto& r) {
       add_loss(r);
       r.mutable_loss()->mutable_weight()->resize(8);
     },
     "loss.weight has 8 bytes"},
    {"LossNotFinite", [](auto& r) { add_loss(r, std::nanf("")); }, "loss.image: value 0 is nan"},
    {"LossNegativeWeight", [](auto& r) { add_loss(r, 1, -1); }, "loss.weight: value 0 is -1"},
    {"LossOfBlack", [](auto& r) { add_loss(r, 0); }, "black"},
    {"AlbedoAboveTheMaterials", [](auto& r) { r.add_albedos(0.999); }, "albedos[0] is 0.999"},
    {"TooManyAlbedos",
     [](auto& r) {
       for (int i = 0; i < 17; ++i) r.add_albedos(0.1);
     },
     "number of albedos is 17"},
    {"MaterialBesideColours",
     [](auto& r) {
       r = colours_request();
       r.mutable_material()->set_sigma_t(8);
     },
     "material is there beside colours"},
    {"TwoColours",
     [](auto& r) {
       r = colours_request();
       r.mutable_colours()->RemoveLast();
     },
     "the number of colours is 2; it must be 0 or 3"},
    {"ColourWithoutExtinction",
     [](auto& r) {
       r = colours_request();
       r.mutable_colours(1)->clear_sigma_t();
     },
     "colours[1].sigma_t is 0"},
    {"ColoursOfSeveralG",
     [](auto& r) {
       r = colours_request();
       r.mutable_colours(2)->set_g(0);
     },
     "colours[2].g is 0; it must be that of colours[0], 0.3"},
    {"ColoursOfOneChannel", [](auto& r) { r = colours_request(v1::Film::RED); },
     "colours and a film whose channel is RGB need one another"},
    {"ColourlessRgb",
     [](auto& r) {
       r = colours_request();
       *r.mutable_material() = r.colours(0);
       r.clear_colours();
     },
     "colours and a film whose channel is RGB need one another"},
    {"ColoursByLights",
     [](auto& r) {
       r = colours_request();
       r.add_parameters("light[0].scale");
     },
     "no derivative in light[0].scale of colours"},
    {"LossOfColours",
     [](auto& r) {
       r = colours_request();
       add_loss(r);
       r.set_estimates(2);
     },
     "loss and colours"},
    {"SamplesTooLate",
     [](auto& r) {
       r.set_spp(2);
       r.set_first_sample((1 << 20) - 1);
     },
     "first_sample is 1048575; with spp, 2, it must be at most 1048576"},
    {"FirstSampleBetweenEstimates",
     [](auto& r) {
       r.set_estimates(2);
       r.set_first_sample(3);
     },
     "first_sample is 3; it must be a multiple of estimates, 2"},
    {"LongPilot", [](auto& r) { r.set_pilot_spp(65); }, "pilot_spp is 65"},
    {"UnknownPixels", [](auto& r) { r.set_pixels(v1::RenderedPixels(9)); },
     "pixels has the unknown"},
    {"UnknownTracer", [](auto& r) { r.set_tracer(v1::Tracer(9)); }, "tracer has the unknown"},
    {"ReferenceWithPilot",
     [](auto& r) {
       r.set_tracer(v1::REFERENCE);
       r.set_pilot_spp(4);
     },
     "neither albedos, colours nor pilot_spp"},
    {"BillionPixels", [](auto& r) { film(r, 40000, 25000); }, "is 1000000000; this worker accepts",
     grpc::RESOURCE_EXHAUSTED},
    {"LargeReply", [](auto& r) { film(r, 200, 200); }, "ask for fewer pixels",
     grpc::RESOURCE_EXHAUSTED},
    {"NameThatSteersATerminal",
     [](auto& r) {
       v1::Scene scene = cube_scene();
       scene.mutable_object()->mutable_mesh()->set_builtin("cu\n\x1b[31m" +
                                                           std::string(100'000, 'b'));
       r.set_scene(scene.SerializeAsString());
     },
     R"(no built-in shape "cu\x0a\x1b[31mbbb)"},
    {"ValueOfNoName", [](auto& r) { r.add_values(); }, " is not a parameter; there are"},
    {"ValueOfACoordinate", [](auto& r) { set_value(r, "sigma_a", 1); },
     "values[0].name is sigma_a; of the medium, sigma_t, albedo and g can be set"},
    {"ValueTwice",
     [](auto& r) {
       set_value(r, "g", 0);
       set_value(r, "g", 0);
     },
     "values[1].name is g again"},
    {"ValueNan", [](auto& r) { set_value(r, "g", std::nan("")); }, "nan"},
    {"ValueOutOfItsRange", [](auto& r) { set_value(r, "light[0].scale", 0); },
     "light[0].scale is 0; it must be in [1e-06, 1e+06]"},
    {"ValueOfWhatIsNotThere", [](auto& r) { set_value(r, "rough_dielectric.index", 1.4); },
     "rough_dielectric.index is not in the scene: the boundary is index-matched"},
    {"ValueOfNoLight", [](auto& r) { set_value(r, "light[7].scale", 1); },
     "light[7].scale is not in the scene: it has"},
    {"ValueOfAnotherPhase", [](auto& r) { set_value(r, "two_term.weight", 0.5); },
     "two_term.weight is no number of the phase function"},
    {"ValueOfTheMediumBesideColours",
     [](auto& r) {
       r = colours_request();
       set_value(r, "albedo", 0.5);
     },
     "values[0].name is albedo; the medium is that of the colours"},
    {"OpenMesh", open_mesh, "open"},
    {"InsideOut", inside_out, "inside out"},
};

void PrintTo(const BadRequest& row, std::ostream* out) {
  *out << row.name;
}

class RefusedRequest : public ::testing::TestWithParam<BadRequest> {};

TEST_P(RefusedRequest, QuicklyWithAMessage) {
  static RenderServer server(options_with([](auto& o) {
    o.limits.max_spp = 1000;
    o.limits.max_message_bytes = 1'000'000;
  }));
  auto request = with_scene(small_request());
  GetParam().spoil(request);
  const double start = testing::own_cpu_seconds();
  const Answer answer = Client(server.in_process_channel()).call(request);
  EXPECT_EQ(answer.status.error_code(), GetParam().code) << answer.status.error_message();
  EXPECT_THAT(answer.status.error_message(), HasSubstr(GetParam().message));
  EXPECT_LT(testing::own_cpu_seconds() - start, 1) << "processor time, in s";
}

INSTANTIATE_TEST_SUITE_P(Table, RefusedRequest, ::testing::ValuesIn(kBadRequests),
                         [](const auto& row) { return row.param.name; });

TEST(RenderService, RefusesMessagesThatAreTooLarge) {
  auto options = options_with([](auto& o) { o.limits.max_message_bytes = 100'000; });
  options.listen = "127.0.0.1:0";
  RenderServer server(options);
  auto request = with_scene(small_request());
  request.mutable_scene()->append(200'000, ' ');
  EXPECT_EQ(Client(connect(server)).call(request).status.error_code(), grpc::RESOURCE_EXHAUSTED);
}

TEST(RenderService, SaysWhatIsWrongWithBytesThatAreNoMessage) {
  RenderServer server(one_thread());
  for (const char* method : {"RenderGrad", "GetCapabilities"}) {
    const grpc::Status status =
        testing::call_with_bytes(server.in_process_channel(),
                                 std::string("/itn.v1.RenderService/") + method,
                                 "\x0a\xff\xff\xff\xff")
            .status;
    EXPECT_EQ(status.error_code(), grpc::INVALID_ARGUMENT) << method;
    EXPECT_THAT(status.error_message(), ::testing::AnyOf(HasSubstr("not a serialized itn.v1."),
                                                         HasSubstr("unknown number")));
  }
}

TEST(RenderService, RefusesCompressedRequests) {
  auto options = one_thread();
  options.listen = "127.0.0.1:0";
  RenderServer server(options);
  grpc::ClientContext context;
  context.set_compression_algorithm(GRPC_COMPRESS_GZIP);
  auto request = with_scene(small_request());
  request.mutable_scene()->append(100'000, ' ');
  const grpc::Status status = Client(connect(server)).call(context, request).status;
  EXPECT_EQ(status.error_code(), grpc::UNIMPLEMENTED) << status.error_message();
}

TEST(RenderService, RefusesWhatItsMemoryDoesNotHold) {
  RenderServer server(options_with([](auto& o) { o.memory_bytes = uint64_t{300} << 20; }));
  Client client(server.in_process_channel());
  auto request = with_scene(small_request());
  film(request, 2000, 2000);
  const Answer large = client.call(request);
  EXPECT_EQ(large.status.error_code(), grpc::RESOURCE_EXHAUSTED);
  EXPECT_THAT(large.status.error_message(), HasSubstr("--max-memory-mb"));
  EXPECT_TRUE(client.call(with_scene(small_request())).status.ok());
}

// A scene of many triangles in many places: a ground of built-in shapes.
v1::Scene large_scene() {
  v1::Scene scene = cube_scene();
  for (int i = 0; i < 8; ++i) {
    v1::Mesh& mesh = *scene.add_surfaces()->mutable_mesh();
    mesh.set_builtin("sphere");
    mesh.add_transforms()->mutable_translate()->set_x(static_cast<float>(10 + 2 * i));
  }
  return scene;
}

// What the scene takes compiled, and the most that it takes on the way there.
uint64_t memory_of(const v1::Scene& scene) {
  return tracer::Scene(build_scene(scene, {})).memory();
}
uint64_t memory_to_build(const v1::Scene& scene) {
  return 3 * scene.ByteSizeLong() + tracer::estimated_memory(build_scene(scene, {}));
}

// With so many pixels that its sums take about so many bytes.
v1::RenderGradRequest request_of(uint64_t bytes, v1::Scene scene) {
  v1::RenderGradRequest request = small_request(1);
  request.clear_derivatives();
  request.set_estimates(1);
  const uint64_t by_pixel = film_memory(1, request, build_request(with_scene(request), {}).asked);
  scene.mutable_film()->set_width(static_cast<uint32_t>(bytes / by_pixel / 64));
  scene.mutable_film()->set_height(64);
  return with_scene(request, scene);
}

// What the cache has no room for is taken from the memory for requests: while a render uses a scene
// of that kind, another finds less, and it has it back when that render has ended.
TEST(RenderService, CountsTheSceneThatIsRendered) {
  const uint64_t scene_bytes = memory_of(large_scene()),
                 build_bytes = memory_to_build(large_scene());
  RenderServer server(options_with([&](auto& o) {
    o.renders = 2;
    o.cache_bytes = 0;
    o.memory_bytes = build_bytes + (uint64_t{1} << 20);
  }));
  Client client(server.in_process_channel());
  const uint64_t rest = build_bytes + (uint64_t{1} << 20) - scene_bytes;
  const auto request = request_of(rest + scene_bytes / 2, cube_scene());
  EXPECT_TRUE(client.call(request).status.ok());  // alone

  grpc::ClientContext context;
  auto endless = std::async(std::launch::async, [&] {
    return client.call(context, with_scene(endless_request(), large_scene())).status;
  });
  const auto is_refused = [&] {
    const grpc::Status status = client.call(request).status;
    v1::Busy busy;
    return status.error_code() == grpc::UNAVAILABLE &&
           busy.ParseFromString(status.error_details()) && busy.retry_after_seconds() > 0 &&
           status.error_message().find("MiB of memory for requests are taken") != std::string::npos;
  };
  auto named = small_request();
  named.set_scene_digest(sha256(serialize(large_scene())->bytes));
  ASSERT_TRUE(testing::eventually([&] { return client.call(named).status.ok(); }));  // it is built
  EXPECT_TRUE(is_refused());
  context.TryCancel();
  EXPECT_EQ(endless.get().error_code(), grpc::CANCELLED);
  EXPECT_TRUE(testing::eventually([&] { return client.call(request).status.ok(); }));
}

// To come again would not help.
TEST(RenderService, RefusesAFilmThatNeverFitsBesideItsScene) {
  const uint64_t memory = memory_to_build(large_scene()) + (uint64_t{1} << 20);
  RenderServer server(options_with([&](auto& o) {
    o.cache_bytes = 0;
    o.memory_bytes = memory;
  }));
  Client client(server.in_process_channel());
  const uint64_t scene_bytes = memory_of(large_scene());
  const Answer answer = client.call(request_of(memory - scene_bytes / 2, large_scene()));
  EXPECT_EQ(answer.status.error_code(), grpc::RESOURCE_EXHAUSTED);
  EXPECT_THAT(answer.status.error_message(), HasSubstr("--max-memory-mb"));
  EXPECT_TRUE(client.call(request_of(memory - 2 * scene_bytes, cube_scene())).status.ok());
}

// ---- Time --------------------------------------------------------------------------------------

// A cube with a cavity, behind a boundary, under a sun of some size.
v1::Scene thick_shell(const std::string& boundary) {
  v1::Scene scene = cube_scene();
  *scene.mutable_object() = testing::parse_text<v1::Object>(boundary);
  scene.mutable_lights(1)->mutable_directional()->set_angular_radius_degrees(1);
  const v1::Triangles cube = testing::cube();
  auto positions = from_bytes<Vec3f>(cube.positions());
  auto indices = from_bytes<uint32_t>(cube.indices());
  const size_t corners = positions.size(), sides = indices.size();
  for (size_t i = 0; i < corners; ++i) {
    const Vec3f middle = {0, 0.5F, 0};
    positions.push_back(middle + (positions[i] - middle) * 0.9F);
  }
  for (size_t i = 0; i < sides; i += 3) {  // the other way round
    for (const size_t k : {0U, 2U, 1U}) {
      indices.push_back(indices[i + k] + static_cast<uint32_t>(corners));
    }
  }
  v1::Triangles& triangles = *scene.mutable_object()->mutable_mesh()->mutable_triangles();
  triangles.set_positions(to_bytes(positions));
  triangles.set_indices(to_bytes(indices));
  return scene;
}

TEST(RenderService, StopsARenderThatTakesTooLong) {
  RenderServer server(options_with([](auto& o) {
    o.max_seconds = 0.3;
    o.limits.max_spp = 1U << 20;
  }));
  Client client(server.in_process_channel());
  for (const char* boundary : {"boundary: INDEX_MATCHED", "dielectric { index: 2.5 }",
                               "rough_dielectric { index: 2.5 roughness: 0.001 }"}) {
    SCOPED_TRACE(boundary);
    const v1::Scene scene = thick_shell(boundary);
    // To make the scene may take as long by itself.
    ASSERT_TRUE(testing::eventually(
        [&] { return client.call(with_scene(small_request(), scene)).status.ok(); }));
    auto request = with_scene(endless_request(), scene);
    request.set_spp(1000);  // by its number of paths, it might end in time
    request.mutable_material()->set_sigma_t(1e6);
    request.mutable_material()->set_albedo(1);
    const Answer answer = client.call(request);
    EXPECT_EQ(answer.status.error_code(), grpc::RESOURCE_EXHAUSTED);
    EXPECT_THAT(answer.status.error_message(), HasSubstr("rendering 1000 samples per pixel"));
    EXPECT_THAT(answer.status.error_message(), HasSubstr("--max-seconds"));
  }
  EXPECT_TRUE(
      testing::eventually([&] { return client.call(with_scene(small_request())).status.ok(); }));
}

TEST(RenderService, RefusesAtOnceWhatCannotEndInTime) {
  RenderServer server(options_with([](auto& o) { o.max_seconds = 1; }));
  const Answer answer = Client(server.in_process_channel()).call(with_scene(endless_request()));
  EXPECT_EQ(answer.status.error_code(), grpc::RESOURCE_EXHAUSTED);
  EXPECT_THAT(answer.status.error_message(), HasSubstr("take more than 2 s"));
}

// ---- Stopping ----------------------------------------------------------------------------------

// A server whose only thread is busy for days.
class BusyServer {
 public:
  explicit BusyServer(size_t queue_capacity, const std::string& listen = "")
      : server_(options(queue_capacity, listen)), client_(channel()) {
    busy_ = std::async(std::launch::async, [this] {
      return client_.call(context_, with_scene(endless_request())).status;
    });
    EXPECT_TRUE(testing::eventually([this] { return server_.running() == 1; }));
  }
  ~BusyServer() {
    context_.TryCancel();
    if (busy_.valid()) busy_.wait();
  }

  RenderServer& server() { return server_; }
  Client& client() { return client_; }
  grpc::ClientContext& context() { return context_; }
  grpc::Status end() { return busy_.get(); }

 private:
  static RenderServerOptions options(size_t queue_capacity, const std::string& listen) {
    auto options = options_with([&](auto& o) { o.queue_capacity = queue_capacity; });
    options.listen = listen;
    return options;
  }
  std::shared_ptr<grpc::Channel> channel() {
    return server_.address().empty() ? server_.in_process_channel() : connect(server_);
  }

  RenderServer server_;
  Client client_;
  grpc::ClientContext context_;
  std::future<grpc::Status> busy_;
};

TEST(RenderService, AnswersUnavailableWhenItsQueueIsFull) {
  BusyServer busy(0);
  const Answer answer = busy.client().call(with_scene(small_request()));
  EXPECT_EQ(answer.status.error_code(), grpc::UNAVAILABLE);
  EXPECT_THAT(answer.status.error_message(), HasSubstr("busy: 1 run, 0 wait"));
  v1::Busy details;
  ASSERT_TRUE(details.ParseFromString(answer.status.error_details()));
  EXPECT_GT(details.retry_after_seconds(), 0);
}

// Whether its only thread, which was busy for days, is free.
bool serves_again(Client& client) {
  return testing::eventually([&] { return client.call(with_scene(small_request())).status.ok(); });
}

class Stops : public ::testing::TestWithParam<const char*> {};

TEST_P(Stops, ARenderThatIsCancelled) {
  BusyServer busy(0, GetParam());
  busy.context().TryCancel();
  EXPECT_EQ(busy.end().error_code(), grpc::CANCELLED);
  EXPECT_TRUE(serves_again(busy.client()));
}

TEST_P(Stops, ARenderWhoseDeadlinePasses) {
  auto options = options_with([](auto& o) { o.queue_capacity = 0; });
  options.listen = GetParam();
  RenderServer server(options);
  Client client(server.address().empty() ? server.in_process_channel() : connect(server));
  EXPECT_EQ(client.call(with_scene(endless_request()), 200ms).status.error_code(),
            grpc::DEADLINE_EXCEEDED);
  EXPECT_TRUE(serves_again(client));
}

TEST_P(Stops, ARenderThatWaits) {
  BusyServer busy(1, GetParam());
  EXPECT_EQ(busy.client().call(with_scene(endless_request()), 200ms).status.error_code(),
            grpc::DEADLINE_EXCEEDED);
  // Its place is free: this one waits, too, instead of being turned away.
  EXPECT_TRUE(testing::eventually([&] {
    return busy.client().call(with_scene(endless_request()), 200ms).status.error_code() ==
           grpc::DEADLINE_EXCEEDED;
  }));
}

TEST(RenderService, CountsItsCallsWhileItIsBusy) {
  RenderServer server(options_with([](auto& o) { o.queue_capacity = 1; }));
  Client client(server.in_process_channel());
  EXPECT_TRUE(server.metrics().methods.empty());
  EXPECT_TRUE(client.call(with_scene(small_request())).status.ok());
  // An answered call has its thread for a moment more, in which the next would wait.
  ASSERT_TRUE(testing::eventually([&] { return server.metrics().running == 0; }));
  grpc::ClientContext first, second;
  auto running = std::async(
      std::launch::async, [&] { return client.call(first, with_scene(endless_request())).status; });
  ASSERT_TRUE(testing::eventually([&] { return server.metrics().running == 1; }));
  auto waiting = std::async(std::launch::async, [&] {
    return client.call(second, with_scene(endless_request())).status;
  });
  ASSERT_TRUE(testing::eventually([&] { return server.metrics().waiting == 1; }));
  EXPECT_EQ(client.call(with_scene(small_request())).status.error_code(), grpc::UNAVAILABLE);
  const ServerMetrics busy = server.metrics();
  EXPECT_EQ(busy.service, "itn.v1.RenderService");
  EXPECT_EQ(busy.max_running, 1U);
  EXPECT_EQ(busy.max_waiting, 1U);
  EXPECT_GT(busy.scene_bytes, 0U);
  EXPECT_GT(busy.resident_bytes, 1U << 20);
  first.TryCancel();
  second.TryCancel();
  running.wait();
  waiting.wait();
  const ServerMetrics after = server.metrics();
  ASSERT_EQ(after.methods.size(), 1U);
  const CallCounts::Method& method = after.methods.at("RenderGrad");
  EXPECT_EQ(method.answers.at(grpc::StatusCode::OK), 1U);
  EXPECT_EQ(method.answers.at(grpc::StatusCode::UNAVAILABLE), 1U);
  EXPECT_GT(method.units, 0);
}

TEST(RenderService, CountsItsScenesAndItsConnections) {
  auto options = options_with([](auto&) {});
  options.listen = "127.0.0.1:0";
  RenderServer server(options);
  EXPECT_EQ(server.metrics().connections, 0U);
  EXPECT_EQ(server.metrics().max_connections, 1024U);
  {
    const Connector connector;
    Client one(connector.connect_to(server.address())), two(connector.connect_to(server.address()));
    EXPECT_TRUE(one.call(with_scene(small_request())).status.ok());
    EXPECT_TRUE(two.call(with_scene(small_request())).status.ok());
    auto named = small_request();
    named.set_scene_digest(sha256(serialize(cube_scene())->bytes));
    EXPECT_TRUE(two.call(named).status.ok());
    EXPECT_EQ(server.metrics().connections, 2U);
    EXPECT_EQ(server.metrics().scene_misses, 1U);
    EXPECT_EQ(server.metrics().scene_hits, 2U);
  }
  EXPECT_TRUE(testing::eventually([&] { return server.metrics().connections == 0; }));
}

// A cache that is too small for a scene keeps it for those who wait for it.
TEST(RenderService, KeepsTheSceneOfARequestThatWaits) {
  auto options = options_with([](auto& o) {
    o.cache_bytes = 0;
    o.queue_capacity = 1;
  });
  RenderServer server(options);
  Client client(server.in_process_channel());
  grpc::ClientContext context;
  auto first = std::async(std::launch::async, [&] {
    return client.call(context, with_scene(endless_request())).status;
  });
  auto named = small_request();
  named.set_scene_digest(sha256(serialize(cube_scene())->bytes));
  auto second = std::async(std::launch::async, [&] {
    Answer answer;
    EXPECT_TRUE(testing::eventually([&] {  // once the scene is built
      answer = client.call(named, 10min);
      return answer.status.error_code() != grpc::FAILED_PRECONDITION;
    }));
    return answer.status;
  });
  // Who waits has found its scene. Asked of the server itself: a request that asked would take the
  // only place for a moment, and the one that should wait there would be turned away.
  ASSERT_TRUE(testing::eventually([&] { return server.running() == 1 && server.waiting() == 1; }));
  context.TryCancel();
  EXPECT_EQ(first.get().error_code(), grpc::CANCELLED);
  const grpc::Status status = second.get();
  EXPECT_TRUE(status.ok()) << status.error_message();
  EXPECT_TRUE(testing::eventually([&] {  // and for nobody else
    return client.call(named).status.error_code() == grpc::FAILED_PRECONDITION;
  }));
}

INSTANTIATE_TEST_SUITE_P(Transport, Stops, ::testing::Values("", "127.0.0.1:0"),
                         [](const auto& row) { return *row.param ? "Remote" : "Embedded"; });

TEST(RenderService, ServerThatGoesAwayCancelsWhatRuns) {
  auto server = std::make_unique<RenderServer>(one_thread());
  Client client(server->in_process_channel());
  auto busy = std::async(std::launch::async,
                         [&] { return client.call(with_scene(endless_request())).status; });
  ASSERT_TRUE(testing::eventually([&] { return server->running() == 1; }));
  server.reset();
  EXPECT_FALSE(busy.get().ok());
}

// ---- Health ------------------------------------------------------------------------------------

TEST(RenderServer, TellsItsHealth) {
  auto options = one_thread();
  options.listen = "127.0.0.1:0";
  RenderServer server(options);
  for (const char* service : {"", "itn.v1.RenderService"}) {
    const auto [status, serving] = health(connect(server), service);
    EXPECT_TRUE(status.ok()) << status.error_message();
    EXPECT_EQ(serving, 1U) << service;
  }
  EXPECT_EQ(health(connect(server), "no.such.Service").first.error_code(), grpc::NOT_FOUND);
}

TEST(RenderServer, DoesNotShareAPort) {
  auto options = one_thread();
  options.listen = "127.0.0.1:0";
  RenderServer server(options);
  options.listen = server.address();
  EXPECT_THROW(RenderServer{options}, Error);
}

TEST(RenderServer, DrainsWhatItHasAccepted) {
  auto options = one_thread();
  options.listen = "127.0.0.1:0";
  RenderServer server(options);
  Client client(connect(server));
  auto accepted =
      std::async(std::launch::async, [&] { return client.call(with_scene(small_request(4000))); });
  ASSERT_TRUE(testing::eventually([&] { return server.running() == 1; }));
  server.drain(10min);
  EXPECT_TRUE(accepted.get().status.ok());
  EXPECT_EQ(client.call(with_scene(small_request())).status.error_code(), grpc::UNAVAILABLE);
}

// Calls that come while a worker stops are told to go elsewhere. Only who cancels is cancelled.
TEST(RenderServer, CancelsNobodyWhenItStops) {
  auto options = options_with([](auto& o) { o.queue_capacity = 64; });
  options.listen = "127.0.0.1:0";
  auto server = std::make_unique<RenderServer>(options);
  std::atomic<int> successes_of_all = 0;
  std::mutex mutex;
  std::map<grpc::StatusCode, int> statuses;
  {
    std::vector<std::jthread> clients;
    for (int i = 0; i < 8; ++i) {
      clients.emplace_back([&, channel = connect(*server)] {
        Client client(channel);
        for (int failures = 0; failures < 20;) {
          const grpc::StatusCode code =
              client.call(with_scene(small_request())).status.error_code();
          if (code == grpc::OK) {
            ++successes_of_all;
          } else {
            ++failures;
          }
          const std::lock_guard lock(mutex);
          ++statuses[code];
        }
      });
    }
    while (successes_of_all < 100) std::this_thread::yield();
    server->drain(10min);
    server.reset();
  }
  EXPECT_GE(statuses[grpc::OK], 50);
  EXPECT_GE(statuses[grpc::UNAVAILABLE], 8 * 20);
  for (const auto& [code, number] : statuses) {
    EXPECT_TRUE(code == grpc::OK || code == grpc::UNAVAILABLE) << number << " times " << code;
  }
}

TEST(RenderServer, AnswersUnavailableWhatIsNotDoneInTimeWhenItStops) {
  BusyServer busy(1, "127.0.0.1:0");
  busy.server().drain(0.1s);
  const grpc::Status status = busy.end();
  EXPECT_EQ(status.error_code(), grpc::UNAVAILABLE);
  EXPECT_THAT(status.error_message(), HasSubstr("stopping"));
}

// Health of the service is whether it takes work, that of the server whether it is there.
}  // namespace
}  // namespace itn
