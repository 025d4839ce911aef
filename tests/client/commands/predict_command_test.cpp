// itn predict, models and export, and itn-predictor, as processes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "common/image/image.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using testing::Finished;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::Process;
using testing::run;
using testing::TemporaryFolder;

using Arguments = std::vector<std::string>;

auto count(const std::string& text, const std::string& what) {
  size_t found = 0;
  for (size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++found;
  return found;
}

// A model that all tests predict with, and the images of its dataset.
class PredictCommand : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new TemporaryFolder;
    for (const Arguments& command :
         {Arguments{ITN, "dataset", shared_->path("data"), "--count", "80", "--resolution", "16",
                    "--spp", "1", "--test-shapes", "cube"},
          Arguments{ITN, "train", shared_->path("data"), "-o", shared_->path("first"), "--batch",
                    "2", "--base-channels", "1", "--steps", "3", "--model-version", "0.9"},
          Arguments{ITN, "export", shared_->path("first"), "-o", shared_->path("small.itn"),
                    "--model-name", "small", "--model-version", "1.2"}}) {
      const Finished finished = run(command);
      ASSERT_EQ(finished.exit_code, 0) << finished.errors;
    }
  }
  static void TearDownTestSuite() { delete shared_; }

  static std::string image(int number) {
    return shared_->path("data/images/00000" + std::to_string(number) + ".exr");
  }
  static std::string model() { return shared_->path("small.itn"); }

  // A folder of models, for programs that are started from here on.
  void ship() const {
    fs::create_directories(folder_.path("models"));
    fs::copy(model(), folder_.path("models/outdoor.itn"));
    fs::copy(model(), folder_.path("models/studio.itn"));
    folder_.write("models/outdoor.md", "# Sun and sky\n\nTrained with ...\n");
    ::setenv("ITN_MODELS", folder_.path("models").c_str(), 1);
  }
  ~PredictCommand() override { ::unsetenv("ITN_MODELS"); }

  static inline TemporaryFolder* shared_ = nullptr;
  TemporaryFolder folder_;
};

// --- The model ---

TEST_F(PredictCommand, SaysWhichModelAnswered) {
  const Finished table = run({ITN, "predict", image(0), "--model", model()});
  EXPECT_EQ(table.exit_code, 0) << table.errors;
  EXPECT_THAT(table.output, AllOf(HasSubstr("model: small 1.2, step 3, weights "),
                                  Not(HasSubstr("without a version")),
                                  Not(HasSubstr("does not know the images"))));
  const Finished json = run({ITN, "predict", image(0), "--model", model(), "--json"});
  EXPECT_THAT(json.output,
              AllOf(HasSubstr(R"("model":"small 1.2, step 3")"), HasSubstr(R"("version":"1.2")"),
                    HasSubstr(R"("sha256":")"), HasSubstr(R"("unfamiliarity":{"score":)"),
                    HasSubstr(R"("at_bounds":[)")));
  // Its run is called by its folder, and has the version that was given.
  const Finished of_run = run({ITN, "predict", image(0), "--model", shared_->path("first")});
  EXPECT_THAT(of_run.output, HasSubstr("model: first 0.9, step 3"));
}

TEST_F(PredictCommand, SaysThatAModelHasNoVersionAndKnowsNoImages) {
  const Finished trained =
      run({ITN, "train", shared_->path("data"), "-o", folder_.path("run"), "--batch", "2",
           "--base-channels", "1", "--steps", "1", "--init", shared_->path("first")});
  ASSERT_EQ(trained.exit_code, 0) << trained.errors;
  EXPECT_THAT(run({ITN, "predict", image(0), "--model", folder_.path("run")}).output,
              HasSubstr("model: run, step 1 (without a version)"));
  // Too few images to say what they are like.
  ASSERT_EQ(run({ITN, "dataset", folder_.path("few"), "--count", "8", "--resolution", "16", "--spp",
                 "1", "--test-shapes", "cube"})
                .exit_code,
            0);
  ASSERT_EQ(run({ITN, "train", folder_.path("few"), "-o", folder_.path("blind"), "--batch", "2",
                 "--base-channels", "1", "--steps", "1"})
                .exit_code,
            0);
  EXPECT_THAT(run({ITN, "predict", image(0), "--model", folder_.path("blind")}).output,
              HasSubstr("It does not know the images of its training"));
}

TEST_F(PredictCommand, TakesModelsByName) {
  ship();
  for (const Arguments& flags : {Arguments{}, Arguments{"--model", "studio"}}) {
    Arguments command{ITN, "predict", image(0)};
    command.insert(command.end(), flags.begin(), flags.end());
    const Finished finished = run(command);
    EXPECT_EQ(finished.exit_code, 0) << finished.errors;
    EXPECT_THAT(finished.output, HasSubstr("model: small 1.2"));
  }
  const Finished list = run({ITN, "models"});
  EXPECT_EQ(list.exit_code, 0) << list.errors;
  EXPECT_THAT(list.output, AllOf(HasSubstr("Sun and sky (default)"), HasSubstr("studio"),
                                 HasSubstr("(no card)")));
  Process predictor({ITN_PREDICTOR, "--listen", "127.0.0.1:0", "--log-level", "warning"});
  const Finished remote = run({ITN, "predict", image(0), "--predictor", predictor.read_line()});
  EXPECT_EQ(remote.exit_code, 0) << remote.errors;
  EXPECT_THAT(remote.output, HasSubstr("model: small 1.2, step 3"));
}

TEST_F(PredictCommand, SaysWhichModelIsMissing) {
  ::setenv("ITN_MODELS", folder_.path("models").c_str(), 1);
  for (const Arguments& command : {Arguments{ITN, "predict", image(0)}, Arguments{ITN_PREDICTOR}}) {
    const Finished finished = run(command);
    EXPECT_EQ(finished.exit_code, 4);
    EXPECT_THAT(finished.errors,
                AllOf(HasSubstr("outdoor, is missing"), HasSubstr("--model FILE")));
  }
  EXPECT_EQ(run({ITN, "models"}).exit_code, 4);
  ship();
  const Finished misspelt = run({ITN, "predict", image(0), "--model", "studoi"});
  EXPECT_EQ(misspelt.exit_code, 4);
  EXPECT_THAT(misspelt.errors, HasSubstr("there are outdoor, studio"));
}

// --- Many images ---

TEST_F(PredictCommand, AnswersManyImagesHereAndThereTheSame) {
  Process predictor({ITN_PREDICTOR, "--model", model(), "--listen", "127.0.0.1:0", "--threads", "1",
                     "--log-level", "warning"});
  const std::string address = predictor.read_line();
  const std::string images = shared_->path("data/images");
  const Finished here = run({ITN, "predict", images, "--model", model(), "--json"});
  const Finished there = run({ITN, "predict", images, "--predictor", address, "--json"});
  EXPECT_EQ(here.exit_code, 0) << here.errors;
  EXPECT_EQ(there.exit_code, 0) << there.errors;
  EXPECT_EQ(std::ranges::count(here.output, '\n'), 80);
  EXPECT_EQ(here.output, there.output);
  EXPECT_LT(here.output.find("000000.exr"), here.output.find("000079.exr"));
  const Finished table = run({ITN, "predict", image(1), image(2), "--predictor", address});
  EXPECT_EQ(count(table.output, "sigma_t [1/mm]"), 1);
  EXPECT_EQ(count(table.output, "model: "), 1);
  EXPECT_LT(table.output.find(image(1)), table.output.find(image(2)));
}

// Half as many are asked for until it takes them.
TEST_F(PredictCommand, AsksASmallPredictorForFewerAtATime) {
  Process predictor({ITN_PREDICTOR, "--model", model(), "--listen", "127.0.0.1:0", "--max-pixels",
                     "600", "--threads", "1", "--log-level", "warning"});
  const std::string address = predictor.read_line();
  const Finished finished =
      run({ITN, "predict", shared_->path("data/images"), "--predictor", address, "--json"});
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_EQ(count(finished.output, R"("sigma_t":)"), 80);
}

TEST_F(PredictCommand, LosesNoneOfManyForOneThatIsBad) {
  const std::string bad = folder_.write("bad.exr", "no image");
  const Arguments command{ITN, "predict", image(1), bad, image(2), "--model", model()};
  const Finished table = run(command);
  EXPECT_EQ(table.exit_code, 6);
  EXPECT_THAT(table.errors, HasSubstr("1 of 3 images could not be used"));
  EXPECT_THAT(table.output, AllOf(HasSubstr(image(1)), HasSubstr(bad), HasSubstr(image(2)),
                                  HasSubstr("is not a complete OpenEXR image")));
  Arguments with_json = command;
  with_json.emplace_back("--json");
  const Finished json = run(with_json);
  EXPECT_EQ(json.exit_code, 6);
  EXPECT_EQ(std::ranges::count(json.output, '\n'), 3);
  EXPECT_EQ(count(json.output, R"("error":"")"), 2);
}

TEST_F(PredictCommand, TakesMasksOfTheSameNamesFromAFolder) {
  fs::create_directories(folder_.path("photos"));
  fs::create_directories(folder_.path("masks"));
  for (const int i : {1, 2}) {
    Image photo = read_exr(image(i));
    Image mask = photo;
    photo.channels.erase("mask.Y");
    std::erase_if(mask.channels, [](const auto& channel) { return channel.first != "mask.Y"; });
    write_exr(folder_.path("photos/" + std::to_string(i) + ".exr"), photo);
    write_exr(folder_.path("masks/" + std::to_string(i) + ".exr"), mask);
  }
  const auto predict = [&](const std::string& mask) {
    return run({ITN, "predict", folder_.path("photos"), "--mask", folder_.path(mask), "--model",
                model(), "--json"});
  };
  const Finished finished = predict("masks");
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_EQ(count(finished.output, R"("sigma_t":)"), 2);
  const Finished one = predict("masks/1.exr");
  EXPECT_EQ(one.exit_code, 2);
  EXPECT_THAT(one.errors, HasSubstr("--mask must be a folder"));
  fs::remove(folder_.path("masks/2.exr"));
  EXPECT_EQ(predict("masks").exit_code, 4);
}

// --- What it says of an answer ---

TEST_F(PredictCommand, WarnsOfAnImageThatIsLikeNoneOfItsTraining) {
  Image photo = read_exr(image(1));
  for (float& y : photo.channels.at("Y")) y *= 1000;
  write_exr(folder_.path("bright.exr"), photo);
  const Finished finished = run({ITN, "predict", folder_.path("bright.exr"), "--model", model()});
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output,
              AllOf(HasSubstr("UNFAMILIAR"), HasSubstr("do not trust this answer (mean radiance")));
  // The best model of a run knows its images as the last one does.
  ASSERT_TRUE(fs::exists(shared_->path("first/best.itn")));
  EXPECT_THAT(
      run({ITN, "predict", folder_.path("bright.exr"), "--model", shared_->path("first/best.itn")})
          .output,
      HasSubstr("UNFAMILIAR"));
  const Finished table = run({ITN, "evaluate", model(), "--dataset", shared_->path("data")});
  EXPECT_THAT(table.output, HasSubstr("unfamiliar to the network: "));
}

TEST_F(PredictCommand, ExportsAModelWithoutItsTraining) {
  // Of a weight, a checkpoint holds two numbers more.
  const auto whole = static_cast<double>(fs::file_size(shared_->path("first/checkpoint.itn")));
  EXPECT_LT(static_cast<double>(fs::file_size(model())), 0.6 * whole);
  // Of a dataset it learns what images are like.
  const Finished finished = run({ITN, "export", model(), "-o", folder_.path("model.itn"),
                                 "--dataset", shared_->path("data")});
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, HasSubstr("small 1.2, step 3"));
  const Finished bad_name = run({ITN, "export", model(), "-o", folder_.path("model.itn"),
                                 "--model-name", std::string(101, 'x')});
  EXPECT_EQ(bad_name.exit_code, 2);
  EXPECT_THAT(bad_name.errors, HasSubstr("at most 100 printable ASCII characters"));
}

}  // namespace
}  // namespace itn
