#include <cmath>
#include <functional>

#include <gmock/gmock.h>
#include <grpcpp/create_channel.h>

#include "server/predict/predict_server.h"
#include "tests/common/learning/model_for_tests.h"

namespace itn {
namespace {

using grpc::StatusCode;
using testing::HasSubstr;

constexpr int kSize = 16;

void set_bytes(std::string& bytes, const std::vector<float>& values) {
  bytes.assign(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
}

struct Picture {
  int channels;
  std::vector<float> pixels, mask;

  explicit Picture(int channel_count) : channels(channel_count) {
    for (int i = 0; i < kSize * kSize; ++i) {
      const int x = i % kSize - 8, y = i / kSize - 8;
      mask.push_back(x * x + y * y < 30 ? 1.0F : 0.0F);
      for (int c = 0; c < channels; ++c) {
        pixels.push_back(1 + 0.1F * static_cast<float>(x) * static_cast<float>(c + 1) / 3);
      }
    }
  }
  Photograph photograph() const { return {kSize, kSize, channels, pixels, mask}; }
  v1::PredictRequest request() const {
    v1::PredictRequest result;
    result.set_width(kSize);
    result.set_height(kSize);
    result.set_channels(static_cast<uint32_t>(channels));
    set_bytes(*result.mutable_image(), pixels);
    set_bytes(*result.mutable_mask(), mask);
    return result;
  }
};

class PredictServiceTest : public testing::Test {
 protected:
  PredictServiceTest() {
    torch::set_num_threads(1);
    server_ = std::make_unique<PredictServer>(
        Predictor(small_model()),
        PredictServerOptions{
            .listen = "127.0.0.1:0", .reflection = true, .service = {.max_pixels = 1000}});
    stub_ = v1::PredictService::NewStub(
        grpc::CreateChannel(server_->address(), grpc::InsecureChannelCredentials()));
  }

  grpc::Status predict(const v1::PredictRequest& request, v1::PredictReply& reply) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
    return stub_->Predict(&context, request, &reply);
  }

  grpc::Status predict(const v1::PredictBatchRequest& request, v1::PredictBatchReply& reply) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
    return stub_->PredictBatch(&context, request, &reply);
  }

  std::unique_ptr<PredictServer> server_;
  std::unique_ptr<v1::PredictService::Stub> stub_;
};

TEST_F(PredictServiceTest, AnswersAsThePredictorDoesGrayAndColour) {
  Predictor predictor(small_model());
  for (const int channels : {1, 3}) {
    const Picture picture(channels);
    const std::vector<Material> expected = predictor.predict(picture.photograph());
    v1::PredictReply reply;
    const grpc::Status status = predict(picture.request(), reply);
    ASSERT_TRUE(status.ok()) << status.error_message();
    ASSERT_EQ(reply.materials_size(), channels);
    for (int c = 0; c < channels; ++c) {
      const Material& material = expected[static_cast<size_t>(c)];
      EXPECT_EQ(reply.materials(c).sigma_t(), material.sigma_t);
      EXPECT_EQ(reply.materials(c).albedo(), material.albedo);
      EXPECT_EQ(reply.materials(c).g(), material.g);
    }
    EXPECT_EQ(reply.model(), "test, step 0");
    EXPECT_EQ(reply.model_version().sha256(), predictor.version().sha256());
    EXPECT_EQ(reply.caveats_size(), channels);
  }
}

TEST_F(PredictServiceTest, KnowsWhatIsKnownOfAPhotographBesides) {
  v1::PredictRequest request = Picture(1).request();
  v1::PredictReply relative, per_mm;
  ASSERT_TRUE(predict(request, relative).ok());
  request.mutable_capture()->set_object_size(8);
  request.mutable_capture()->set_exposure(1);
  request.mutable_capture()->set_clipped(0.25);
  ASSERT_TRUE(predict(request, per_mm).ok());
  EXPECT_EQ(per_mm.materials(0).sigma_t(), relative.materials(0).sigma_t() / 8);
  ASSERT_EQ(relative.caveats(0).warnings_size(), 2);
  EXPECT_EQ(relative.caveats(0).warnings(0).kind(), v1::Warning::EXPOSURE_UNKNOWN);
  EXPECT_EQ(relative.caveats(0).warnings(1).kind(), v1::Warning::SIZE_UNKNOWN);
  ASSERT_EQ(per_mm.caveats(0).warnings_size(), 1);
  EXPECT_EQ(per_mm.caveats(0).warnings(0).kind(), v1::Warning::CLIPPED);
}

TEST_F(PredictServiceTest, TakesNoChannelsForOne) {
  v1::PredictRequest request = Picture(1).request();
  request.clear_channels();
  v1::PredictReply reply;
  EXPECT_TRUE(predict(request, reply).ok());
  EXPECT_EQ(reply.materials_size(), 1);
}

TEST_F(PredictServiceTest, SaysWhatIsWrong) {
  struct Row {
    StatusCode code;
    const char* message;
    std::function<void(v1::PredictRequest&)> spoil;
  };
  const auto set_pixel = [](std::string& bytes, float value) {
    bytes.replace(0, sizeof value, reinterpret_cast<const char*>(&value), sizeof value);
  };
  const Row rows[] = {
      {StatusCode::INVALID_ARGUMENT, "width is 0", [](auto& r) { r.clear_width(); }},
      {StatusCode::INVALID_ARGUMENT, "height is 100000", [](auto& r) { r.set_height(100000); }},
      {StatusCode::INVALID_ARGUMENT, "channels is 2", [](auto& r) { r.set_channels(2); }},
      {StatusCode::INVALID_ARGUMENT, "image has 0 bytes", [](auto& r) { r.clear_image(); }},
      {StatusCode::INVALID_ARGUMENT, "mask has 0 bytes", [](auto& r) { r.clear_mask(); }},
      {StatusCode::INVALID_ARGUMENT, "image is nan at pixel (0, 0)",
       [&](auto& r) { set_pixel(*r.mutable_image(), NAN); }},
      {StatusCode::INVALID_ARGUMENT, "image is -1",
       [&](auto& r) { set_pixel(*r.mutable_image(), -1); }},
      {StatusCode::INVALID_ARGUMENT, "mask is 2",
       [&](auto& r) { set_pixel(*r.mutable_mask(), 2); }},
      {StatusCode::INVALID_ARGUMENT, "mask is empty",
       [](auto& r) { *r.mutable_mask() = std::string(r.mask().size(), '\0'); }},
      {StatusCode::INVALID_ARGUMENT, "capture.object_size is -1",
       [](auto& r) { r.mutable_capture()->set_object_size(-1); }},
      {StatusCode::INVALID_ARGUMENT, "a white card does not tell",
       [](auto& r) { r.mutable_capture()->add_white(1); }},
      {StatusCode::RESOURCE_EXHAUSTED, "accepts 1000", [](auto& r) { r.set_height(64); }},
  };
  for (const Row& row : rows) {
    v1::PredictRequest request = Picture(1).request();
    row.spoil(request);
    v1::PredictReply reply;
    const grpc::Status status = predict(request, reply);
    EXPECT_EQ(status.error_code(), row.code) << row.message;
    EXPECT_THAT(status.error_message(), HasSubstr(row.message));
  }
}

// --- Batches ---

TEST_F(PredictServiceTest, AnswersABatchImageByImage) {
  v1::PredictBatchRequest request;
  *request.add_images() = Picture(1).request();
  *request.add_images() = Picture(3).request();
  request.add_images();  // nothing
  *request.add_images() = Picture(1).request();
  request.mutable_images(3)->mutable_mask()->resize(8);
  v1::PredictBatchReply reply;
  const grpc::Status status = predict(request, reply);
  ASSERT_TRUE(status.ok()) << status.error_message();
  ASSERT_EQ(reply.outcomes_size(), 4);
  for (int i = 0; i < 2; ++i) {
    v1::PredictReply alone;
    ASSERT_TRUE(predict(request.images(i), alone).ok());
    const v1::PredictReply& together = reply.outcomes(i).reply();
    EXPECT_EQ(reply.outcomes(i).code(), StatusCode::OK);
    EXPECT_EQ(together.model_version().sha256(), alone.model_version().sha256());
    ASSERT_EQ(together.materials_size(), alone.materials_size());
    for (int c = 0; c < alone.materials_size(); ++c) {
      EXPECT_NEAR(together.materials(c).sigma_t(), alone.materials(c).sigma_t(), 1e-3);
    }
  }
  for (int i = 2; i < 4; ++i) {  // as it would have been by itself
    v1::PredictReply none;
    const grpc::Status alone = predict(request.images(i), none);
    EXPECT_FALSE(reply.outcomes(i).has_reply());
    EXPECT_EQ(reply.outcomes(i).code(), alone.error_code());
    EXPECT_EQ(reply.outcomes(i).message(), alone.error_message());
  }
}

TEST_F(PredictServiceTest, AnswersABatchOfNothing) {
  v1::PredictBatchReply reply;
  EXPECT_TRUE(predict(v1::PredictBatchRequest(), reply).ok());
  EXPECT_EQ(reply.outcomes_size(), 0);
}

TEST_F(PredictServiceTest, LimitsABatchAsAnImage) {
  v1::PredictBatchRequest request;
  v1::PredictBatchReply reply;
  for (int i = 0; i < 3; ++i) *request.add_images() = Picture(1).request();
  EXPECT_TRUE(predict(request, reply).ok());  // 768 pixels
  *request.add_images() = Picture(1).request();
  const grpc::Status pixels = predict(request, reply);
  EXPECT_EQ(pixels.error_code(), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_THAT(pixels.error_message(), HasSubstr("the 4 images have 1024 pixels together"));
  // One that is too large by itself leaves the limit's message to it.
  v1::PredictBatchRequest large;
  *large.add_images() = Picture(1).request();
  large.mutable_images(0)->set_height(64);
  ASSERT_TRUE(predict(large, reply).ok());
  EXPECT_EQ(reply.outcomes(0).code(), StatusCode::RESOURCE_EXHAUSTED);
  v1::PredictBatchRequest many;
  for (int i = 0; i <= kMaxBatchImages; ++i) many.add_images();
  const grpc::Status count = predict(many, reply);
  EXPECT_EQ(count.error_code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(count.error_message(), HasSubstr("request.images has more than 1024 elements"));
}

// The deadline is the client's; what is not done by then stops.
TEST_F(PredictServiceTest, ABatchThatIsLateIsCancelled) {
  v1::PredictBatchRequest request;
  for (int i = 0; i < 3; ++i) *request.add_images() = Picture(1).request();
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() - std::chrono::seconds(1));
  v1::PredictBatchReply reply;
  EXPECT_EQ(stub_->PredictBatch(&context, request, &reply).error_code(),
            StatusCode::DEADLINE_EXCEEDED);
  EXPECT_TRUE(predict(request, reply).ok());  // and holds up nobody
}

TEST_F(PredictServiceTest, AnswersNothingAfterItHasDrained) {
  server_->drain(std::chrono::seconds(30));
  v1::PredictReply reply;
  EXPECT_EQ(predict(Picture(1).request(), reply).error_code(), StatusCode::UNAVAILABLE);
  v1::PredictBatchReply batch;
  EXPECT_EQ(predict(v1::PredictBatchRequest(), batch).error_code(), StatusCode::UNAVAILABLE);
}

}  // namespace
}  // namespace itn
