#include <atomic>
#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <thread>

#include <gmock/gmock.h>
#include <grpcpp/create_channel.h>
#include <torch/utils.h>
#include <unistd.h>

#include "common/learning/checkpoint.h"
#include "server/predict/predict_server.h"
#include "tests/common/learning/model_for_tests.h"
#include "tests/support/captured_log.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using grpc::StatusCode;
using ::testing::HasSubstr;

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

void write_model(const std::filesystem::path& path, const v1::Model& model) {
  v1::Checkpoint checkpoint;
  *checkpoint.mutable_model() = model;
  std::filesystem::create_directories(path.parent_path());
  write_checkpoint(path, checkpoint);
}

// A model of the same network with other weights: each number answers otherwise.
v1::Model variant(int number) {
  v1::Model model = small_model();
  const Encoder encoder = load_encoder(model);
  {
    const torch::NoGradGuard no_gradient;
    for (NamedTensor& named : all_tensors(*encoder)) named.tensor *= 1 + 0.01 * number;
  }
  store_weights(*encoder, model);
  model.set_step(static_cast<uint64_t>(number));
  return model;
}

class PredictServiceTest : public ::testing::Test {
 protected:
  PredictServiceTest() {
    torch::set_num_threads(1);
    write_model(folder_.path("small.itn"), small_model());
    serve({.models = {folder_.path("small.itn")}, .folder = {}});
  }

  void serve(const ModelStoreOptions& models) {
    models_ = std::make_shared<ModelStore>(models);
    PredictServerOptions options;
    options.listen = "127.0.0.1:0";
    options.service.max_pixels = 1000;
    server_ = std::make_unique<PredictServer>(models_, options);
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

  // By the model of this name and version.
  grpc::Status predict(const std::string& model, const std::string& version,
                       v1::PredictReply& reply) {
    v1::PredictRequest request = Picture(1).request();
    request.set_model(model);
    request.set_version(version);
    return predict(request, reply);
  }

  testing::TemporaryFolder folder_;
  std::shared_ptr<ModelStore> models_;
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
      EXPECT_EQ(together.materials(c).sigma_t(), alone.materials(c).sigma_t());
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

// --- Models ---

TEST_F(PredictServiceTest, ListsItsModelsAndAnswersByNameAndVersion) {
  write_model(folder_.path("models/card.itn"), variant(1));
  folder_.write("models/card.md", "# Behind a card\n");
  write_model(folder_.path("models/sun/1.9.itn"), variant(2));
  write_model(folder_.path("models/sun/1.10.itn"), variant(3));
  serve({.models = {"first=" + folder_.path("small.itn")}, .folder = folder_.path("models")});
  grpc::ClientContext context;
  v1::ListModelsReply list;
  ASSERT_TRUE(stub_->ListModels(&context, {}, &list).ok());
  ASSERT_EQ(list.models_size(), 4);
  struct Row {
    const char *name, *version, *title;
    bool by_default;
    uint64_t step;
  };
  const Row rows[] = {{"card", "", "Behind a card", false, 1},
                      {"first", "", "", true, 0},
                      {"sun", "1.10", "", false, 3},
                      {"sun", "1.9", "", false, 2}};
  for (int i = 0; i < 4; ++i) {
    const v1::ListedModel& model = list.models(i);
    EXPECT_EQ(model.name(), rows[i].name);
    EXPECT_EQ(model.version(), rows[i].version);
    EXPECT_EQ(model.title(), rows[i].title);
    EXPECT_EQ(model.by_default(), rows[i].by_default);
    EXPECT_EQ(model.model().step(), rows[i].step);
    EXPECT_EQ(model.resolution(), 16);
    EXPECT_TRUE(model.exposure_known());
    EXPECT_FALSE(model.intervals());
    EXPECT_LT(model.sigma_t_min(), 30);
    EXPECT_GT(model.g_max(), 0.8);
    v1::PredictReply reply;
    ASSERT_TRUE(predict(rows[i].name, rows[i].version, reply).ok());
    EXPECT_EQ(reply.model_version().sha256(), model.model().sha256());
  }
  v1::PredictReply newest, by_default;
  ASSERT_TRUE(predict("sun", "", newest).ok());
  EXPECT_EQ(newest.model_version().step(), 3);
  ASSERT_TRUE(predict("", "", by_default).ok());
  EXPECT_EQ(by_default.model_version().step(), 0);
}

// The first of the models that takes a photograph's channels answers where none is named.
TEST_F(PredictServiceTest, AnswersInColourAndOfOneChannelByDefault) {
  write_model(folder_.path("colour.itn"), residual_model(32, v1::EXPOSURE_UNKNOWN, 3));
  const std::string colour = "colour=" + folder_.path("colour.itn");
  const std::string gray = "gray=" + folder_.path("small.itn");
  const auto weights = [&](const std::string& model) {
    return models_->find(model, "", 3)->version().sha256();
  };
  const auto asked = [&](int channels) {
    v1::PredictReply reply;
    const grpc::Status status = predict(Picture(channels).request(), reply);
    EXPECT_EQ(status.ok() ? "" : status.error_message(), "");
    v1::PredictBatchRequest batch;
    *batch.add_images() = Picture(channels).request();
    v1::PredictBatchReply batch_reply;
    EXPECT_TRUE(predict(batch, batch_reply).ok());
    EXPECT_EQ(batch_reply.outcomes(0).reply().model_version().sha256(),
              reply.model_version().sha256());
    EXPECT_EQ(reply.materials_size(), channels);
    return reply.model_version().sha256();
  };
  serve({.models = {colour, gray}, .folder = {}});
  EXPECT_EQ(asked(3), weights("colour"));
  EXPECT_EQ(asked(1), weights("gray"));
  EXPECT_EQ(std::ranges::count(models_->models(), true, &ServedModel::by_default), 2);
  serve({.models = {gray, colour}, .folder = {}});
  EXPECT_EQ(asked(3), weights("gray"));
  EXPECT_EQ(std::ranges::count(models_->models(), true, &ServedModel::by_default), 1);
  serve({.models = {colour}, .folder = {}});
  v1::PredictReply none;
  EXPECT_THAT(predict(Picture(1).request(), none).error_message(),
              HasSubstr("answers about photographs in colour; this one has one channel"));
}

TEST_F(PredictServiceTest, SaysWhichModelsThereAre) {
  write_model(folder_.path("models/sun/1.itn"), variant(1));
  write_model(folder_.path("models/card.itn"), variant(2));
  serve({.models = {}, .folder = folder_.path("models")});
  struct Row {
    const char *model, *version, *message;
  };
  for (const Row& row : {Row{"moon", "", "no model moon; it has card, sun"},
                         Row{"sun", "2", "no version 2 of the model sun; it has 1"},
                         Row{"card", "2", "of the model card; it has one without a version"},
                         Row{"a\nb", "", "no model a\\x0ab"},
                         Row{"", "", "no default model: name one; it has card, sun"}}) {
    v1::PredictReply reply;
    const grpc::Status status = predict(row.model, row.version, reply);
    EXPECT_EQ(status.error_code(), StatusCode::NOT_FOUND) << row.message;
    EXPECT_THAT(status.error_message(), HasSubstr(row.message));
  }
  v1::PredictBatchRequest batch;
  *batch.add_images() = Picture(1).request();
  batch.set_model("moon");
  v1::PredictBatchReply reply;
  EXPECT_EQ(predict(batch, reply).error_code(), StatusCode::NOT_FOUND);
  batch.set_model("sun");
  ASSERT_TRUE(predict(batch, reply).ok());
  EXPECT_EQ(reply.outcomes(0).reply().model_version().step(), 1);
  batch.mutable_images(0)->set_model("card");
  ASSERT_TRUE(predict(batch, reply).ok());
  EXPECT_EQ(reply.outcomes(0).code(), StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(reply.outcomes(0).message(), HasSubstr("name it once, for the batch"));
}

TEST(ModelVersions, NumbersInThemCountAsNumbers) {
  const std::vector<std::string> rising{"", "1", "1.2", "1.9", "1.10", "2", "10", "10a", "v1"};
  for (size_t i = 0; i < rising.size(); ++i) {
    for (size_t j = 0; j < rising.size(); ++j) {
      EXPECT_EQ(is_older(rising[i], rising[j]), i < j) << rising[i] << ", " << rising[j];
    }
  }
}

// Clients call all the time while the file is replaced; each answer is what one of the models says.
TEST_F(PredictServiceTest, ReplacesAModelWithoutDroppingACall) {
  constexpr int kModels = 8, kCallsOfEach = 5;
  const Picture picture(1);
  std::map<std::string, double> expected;  // by digest
  std::vector<std::string> digests;
  for (int i = 0; i < kModels; ++i) {
    const Predictor predictor(variant(i));
    digests.push_back(predictor.version().sha256());
    expected[digests.back()] = predictor.predict(picture.photograph()).front().sigma_t;
  }
  ASSERT_EQ(expected.size(), kModels);
  std::set<double> answers;
  for (const auto& [digest, sigma_t] : expected) answers.insert(sigma_t);
  ASSERT_EQ(answers.size(), kModels);
  write_model(folder_.path("small.itn"), variant(0));
  models_->refresh();

  std::atomic<int> calls = 0, failed = 0, wrong = 0;
  std::atomic<bool> done = false;
  {
    std::vector<std::jthread> clients;
    for (int i = 0; i < 3; ++i) {
      clients.emplace_back([&] {
        while (!done) {
          v1::PredictReply reply;
          const grpc::Status status = predict(picture.request(), reply);
          if (!status.ok()) {
            ++failed;
          } else if (const auto known = expected.find(reply.model_version().sha256());
                     known == expected.end() || reply.materials(0).sigma_t() != known->second) {
            ++wrong;
          }
          ++calls;
        }
      });
    }
    for (int i = 1; i < kModels; ++i) {
      const int before = calls;
      write_model(folder_.path("small.itn"), variant(i));
      models_->refresh();
      EXPECT_TRUE(testing::eventually([&] { return calls >= before + kCallsOfEach; }));
    }
    done = true;
  }
  EXPECT_EQ(failed, 0);
  EXPECT_EQ(wrong, 0);
  v1::PredictReply reply;
  ASSERT_TRUE(predict(picture.request(), reply).ok());
  EXPECT_EQ(reply.model_version().sha256(), digests.back());
}

TEST_F(PredictServiceTest, KeepsAModelWhoseFileIsDamagedOrGone) {
  const auto digest = [&] {
    v1::PredictReply reply;
    EXPECT_TRUE(predict(Picture(1).request(), reply).ok());
    return reply.model_version().sha256();
  };
  const std::string old = digest();
  const auto refreshed = [&](bool again) {
    const testing::CapturedLog log;
    models_->refresh(again);
    return log.text();
  };
  const std::string path = folder_.path("small.itn");
  folder_.write("small.itn", "ITNCKPT2 and then nothing");
  EXPECT_THAT(refreshed(false), HasSubstr("of before goes on answering"));
  EXPECT_EQ(digest(), old);
  EXPECT_EQ(refreshed(false), "");  // said once
  EXPECT_THAT(refreshed(true), HasSubstr("of before goes on answering"));
  v1::Model overflowing = variant(1);
  const float huge = 3e38F;
  for (v1::Tensor& tensor : *overflowing.mutable_weights()) {
    for (size_t at = 0; at < tensor.data().size(); at += sizeof huge) {
      tensor.mutable_data()->replace(at, sizeof huge, reinterpret_cast<const char*>(&huge),
                                     sizeof huge);
    }
  }
  write_model(path, overflowing);
  EXPECT_THAT(refreshed(false), HasSubstr("of before goes on answering"));
  EXPECT_EQ(digest(), old);
  std::filesystem::remove(path);
  EXPECT_THAT(refreshed(false), HasSubstr("of before goes on answering"));
  EXPECT_EQ(digest(), old);
  write_model(path, variant(1));
  EXPECT_THAT(refreshed(false), HasSubstr("weights"));
  EXPECT_NE(digest(), old);
}

TEST_F(PredictServiceTest, FollowsItsFolder) {
  const std::string models = folder_.path("models");
  write_model(models + "/sun/1.itn", variant(1));
  serve({.models = {}, .folder = models});
  const auto step = [&] {
    v1::PredictReply reply;
    const grpc::Status status = predict("sun", "", reply);
    return status.ok() ? static_cast<int>(reply.model_version().step()) : -1;
  };
  EXPECT_EQ(step(), 1);
  write_model(models + "/sun/2.itn", variant(2));
  models_->refresh();
  EXPECT_EQ(step(), 2);
  std::filesystem::remove(models + "/sun/2.itn");
  models_->refresh();
  EXPECT_EQ(step(), 1);
  std::filesystem::remove(models + "/sun/1.itn");
  models_->refresh();
  EXPECT_EQ(step(), -1);
}

// Not read is not empty.
TEST_F(PredictServiceTest, KeepsTheModelsOfAFolderThatCannotBeRead) {
  const std::string models = folder_.path("models"), away = folder_.path("away");
  write_model(models + "/sun/1.itn", variant(1));
  serve({.models = {}, .folder = models});
  const auto refreshed = [&] {
    const testing::CapturedLog log;
    models_->refresh();
    return log.text();
  };
  std::filesystem::rename(models, away);
  EXPECT_THAT(refreshed(), HasSubstr("go on answering"));
  EXPECT_EQ(refreshed(), "");  // said once
  v1::PredictReply reply;
  EXPECT_TRUE(predict("sun", "", reply).ok());
  std::filesystem::rename(away, models);
  EXPECT_THAT(refreshed(), ::testing::Not(HasSubstr("go on answering")));
  std::filesystem::rename(models, away);
  EXPECT_THAT(refreshed(), HasSubstr("go on answering"));  // again, after it was well
  std::filesystem::rename(away, models);
  std::filesystem::remove(models + "/sun/1.itn");
  EXPECT_THAT(refreshed(), HasSubstr("no longer served"));
}

// A subfolder that cannot be read is nobody else's loss.
TEST_F(PredictServiceTest, GoesOnBesideASubfolderThatCannotBeRead) {
  const std::string models = folder_.path("models");
  const std::string sun = models + "/sun", away = folder_.path("away");
  const std::string warning = sun + " cannot be read";
  write_model(sun + "/1.itn", variant(1));
  write_model(models + "/moon.itn", variant(2));
  std::filesystem::create_symlink("loop", models + "/loop");
  const auto log_of = [](const auto& action) {
    const testing::CapturedLog log;
    action();
    return log.text();
  };
  const auto refreshed = [&] { return log_of([&] { models_->refresh(); }); };
  const auto answers = [&](const std::string& model) {
    v1::PredictReply reply;
    return predict(model, "", reply).ok();
  };
  EXPECT_THAT(log_of([&] { serve({.models = {}, .folder = models}); }),
              HasSubstr(models + "/loop cannot be read"));
  EXPECT_TRUE(answers("sun"));
  EXPECT_EQ(refreshed(), "");  // said once
  for (int time = 0; time < 2; ++time) {
    std::filesystem::rename(sun, away);
    std::filesystem::create_symlink("sun", sun);
    std::filesystem::remove(models + "/moon.itn");
    const std::string log = refreshed();
    EXPECT_THAT(log, HasSubstr(warning));  // the second time, too
    EXPECT_THAT(log, HasSubstr("moon.itn is gone"));
    EXPECT_TRUE(answers("sun"));
    EXPECT_FALSE(answers("moon"));
    EXPECT_EQ(refreshed(), "");
    std::filesystem::remove(sun);
    std::filesystem::rename(away, sun);
    write_model(models + "/moon.itn", variant(2));
    EXPECT_THAT(refreshed(), ::testing::Not(HasSubstr("cannot be read")));
    EXPECT_TRUE(answers("sun"));
    EXPECT_TRUE(answers("moon"));
  }
}

TEST_F(PredictServiceTest, KeepsTheModelsOfASubfolderThatItMayNotRead) {
  if (geteuid() == 0) GTEST_SKIP() << "root may read everything";
  const std::string models = folder_.path("models"), sun = models + "/sun";
  write_model(sun + "/1.itn", variant(1));
  write_model(models + "/moon.itn", variant(2));
  ModelStore store({.models = {}, .folder = models});
  std::filesystem::permissions(sun, std::filesystem::perms::none);
  store.refresh();
  EXPECT_EQ(store.models().size(), 2);
  EXPECT_EQ(ModelStore({.models = {}, .folder = models}).models().size(), 1);
  std::filesystem::permissions(sun, std::filesystem::perms::owner_all);
}

TEST_F(PredictServiceTest, SaysOnceWhatIsLeftOutOfItsFolder) {
  const std::string models = folder_.path("models");
  write_model(models + "/sun.itn", variant(1));
  write_model(models + "/moon\xC3\xA9.itn", variant(1));
  const testing::CapturedLog log;
  ModelStore store({.models = {"sun=" + models + "/sun.itn"}, .folder = models});
  store.refresh();
  const std::string text = log.text();
  for (const char* warning : {"there are two", "is left out"}) {
    const size_t first = text.find(warning);
    EXPECT_NE(first, std::string::npos) << warning;
    EXPECT_EQ(text.find(warning, first + 1), std::string::npos) << text;
  }
}

// gRPC would keep what it does not know of a request, at many times its size.
TEST_F(PredictServiceTest, RefusesAListingWithUnknownFields) {
  v1::ListModelsRequest request;
  request.GetReflection()->MutableUnknownFields(&request)->AddGroup(127);
  grpc::ClientContext context;
  v1::ListModelsReply reply;
  EXPECT_EQ(stub_->ListModels(&context, request, &reply).error_code(),
            StatusCode::INVALID_ARGUMENT);
}

TEST_F(PredictServiceTest, RefusesModelsThatItCannotTellApart) {
  const std::string path = folder_.path("small.itn");
  EXPECT_THROW(ModelStore({.models = {path, path}, .folder = {}}), Error);
  EXPECT_THROW(ModelStore({.models = {"a=" + path, "a=" + path}, .folder = {}}), Error);
  EXPECT_EQ(ModelStore({.models = {"a=" + path, "b=" + path}, .folder = {}}).models().size(), 2);
  EXPECT_THROW(ModelStore({.models = {}, .folder = folder_.path("none")}), Error);
  std::filesystem::create_directories(folder_.path("empty"));
  EXPECT_THROW(ModelStore({.models = {}, .folder = folder_.path("empty")}), Error);
}

// --- Many clients ---

// What waits together goes through the network together; nobody's answer tells.
TEST_F(PredictServiceTest, AnswersDoNotDependOnWhoElseAsks) {
  write_model(folder_.path("mirrored.itn"), [] {
    v1::Model model = residual_model();
    model.set_mirrored(true);
    return model;
  }());
  serve(
      {.models = {"small=" + folder_.path("small.itn"), "mirrored=" + folder_.path("mirrored.itn")},
       .folder = {}});
  constexpr int kClients = 8, kCalls = 20;
  const auto request_of = [](int client) {
    Picture picture(client % 2 == 0 ? 1 : 3);
    for (float& pixel : picture.pixels) pixel *= 1 + 0.1F * static_cast<float>(client);
    v1::PredictRequest request = picture.request();
    request.set_model(client % 4 == 3 ? "small" : "mirrored");
    return request;
  };
  std::atomic<int> wrong = 0;
  std::vector<std::string> alone;
  for (int i = 0; i < kClients; ++i) {
    v1::PredictReply reply;
    ASSERT_TRUE(predict(request_of(i), reply).ok());
    alone.push_back(reply.SerializeAsString());
  }
  {
    std::vector<std::jthread> clients;
    for (int i = 0; i < kClients; ++i) {
      clients.emplace_back([&, i] {
        for (int call = 0; call < kCalls; ++call) {
          v1::PredictReply reply;
          if (!predict(request_of(i), reply).ok() ||
              reply.SerializeAsString() != alone[static_cast<size_t>(i)]) {
            ++wrong;
          }
        }
      });
    }
  }
  EXPECT_EQ(wrong, 0);
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
