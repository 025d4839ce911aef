// itn predict, models and export, and itn-predictor, as processes.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "client/image/image.h"
#include "client/image/preview.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using namespace testing;
using ::testing::HasSubstr;
using ::testing::Not;

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
         {Arguments{testing::kItn, "dataset", shared_->path("data"), "--count", "80",
                    "--resolution", "16", "--spp", "1", "--test-shapes", "cube"},
          Arguments{testing::kItn, "train", shared_->path("data"), "-o", shared_->path("first"),
                    "--batch", "2", "--base-channels", "1", "--steps", "3", "--model-version",
                    "0.9"},
          Arguments{testing::kItn, "export", shared_->path("first"), "-o",
                    shared_->path("small.itn"), "--model-name", "small", "--model-version",
                    "1.2"}}) {
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
    for (const char* const name : {"any", "card", "real", "studio"}) {
      fs::copy(model(), folder_.path(fmt::format("models/{}.itn", name)));
    }
    folder_.write("models/any.md", "# Sun and sky\n\nTrained with ...\n");
    ::setenv("ITN_MODELS", folder_.path("models").c_str(), 1);
  }
  ~PredictCommand() override { ::unsetenv("ITN_MODELS"); }

  static inline TemporaryFolder* shared_ = nullptr;
  TemporaryFolder folder_;
};

// --- The model ---

TEST_F(PredictCommand, SaysWhichModelAnswered) {
  const Finished table = run({testing::kItn, "predict", image(0), "--model", model()});
  EXPECT_EQ(table.exit_code, 0) << table.errors;
  EXPECT_THAT(table.output, AllOf(HasSubstr("model: small 1.2, step 3, weights "),
                                  Not(HasSubstr("without a version")),
                                  Not(HasSubstr("does not know the images"))));
  const Finished json = run({testing::kItn, "predict", image(0), "--model", model(), "--json"});
  EXPECT_THAT(json.output,
              AllOf(HasSubstr(R"("model":"small 1.2, step 3")"), HasSubstr(R"("version":"1.2")"),
                    HasSubstr(R"("sha256":")"), HasSubstr(R"("outlier":{"score":)"),
                    HasSubstr(R"("at_bounds":[)")));
  // Its run is called by its folder, and has the version that was given.
  const Finished of_run =
      run({testing::kItn, "predict", image(0), "--model", shared_->path("first")});
  EXPECT_THAT(of_run.output, HasSubstr("model: first 0.9, step 3"));
}

TEST_F(PredictCommand, SaysThatAModelHasNoVersionAndKnowsNoImages) {
  const Finished trained =
      run({testing::kItn, "train", shared_->path("data"), "-o", folder_.path("run"), "--batch", "2",
           "--base-channels", "1", "--steps", "1", "--init", shared_->path("first")});
  ASSERT_EQ(trained.exit_code, 0) << trained.errors;
  EXPECT_THAT(run({testing::kItn, "predict", image(0), "--model", folder_.path("run")}).output,
              HasSubstr("model: run, step 1 (without a version)"));
  // Too few images to say what they are like.
  ASSERT_EQ(run({testing::kItn, "dataset", folder_.path("few"), "--count", "8", "--resolution",
                 "16", "--spp", "1", "--test-shapes", "cube"})
                .exit_code,
            0);
  ASSERT_EQ(run({testing::kItn, "train", folder_.path("few"), "-o", folder_.path("blind"),
                 "--batch", "2", "--base-channels", "1", "--steps", "1"})
                .exit_code,
            0);
  EXPECT_THAT(run({testing::kItn, "predict", image(0), "--model", folder_.path("blind")}).output,
              HasSubstr("It does not know the images of its training"));
}

TEST_F(PredictCommand, TakesModelsByName) {
  ship();
  for (const Arguments& flags : {Arguments{}, Arguments{"--model", "studio"}}) {
    Arguments command{testing::kItn, "predict", image(0)};
    command.insert(command.end(), flags.begin(), flags.end());
    const Finished finished = run(command);
    EXPECT_EQ(finished.exit_code, 0) << finished.errors;
    EXPECT_THAT(finished.output, HasSubstr("model: small 1.2"));
  }
  const Finished list = run({testing::kItn, "models"});
  EXPECT_EQ(list.exit_code, 0) << list.errors;
  EXPECT_THAT(list.output, AllOf(HasSubstr("Sun and sky (default for photographs of one channel)"),
                                 HasSubstr("studio"), HasSubstr("(no card)")));
  Process predictor({testing::kItnPredictor, "--listen", "127.0.0.1:0", "--log-level", "warning"});
  const Finished remote =
      run({testing::kItn, "predict", image(0), "--predictor", predictor.read_line()});
  EXPECT_EQ(remote.exit_code, 0) << remote.errors;
  EXPECT_THAT(remote.output, HasSubstr("model: small 1.2, step 3"));
}

TEST_F(PredictCommand, AsksAPredictorForOneOfItsModels) {
  ship();
  const std::string own = folder_.path("own.itn");
  const auto export_version = [&](const std::string& version) {
    const Finished finished = run(
        {testing::kItn, "export", shared_->path("first"), "-o", own, "--model-version", version});
    ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  };
  export_version("7");
  Process predictor({testing::kItnPredictor, "--model", "any", "--model", "mine=" + own, "--listen",
                     "127.0.0.1:0", "--reload-seconds", "0"},
                    true);
  const std::string address = predictor.read_line();
  const auto ask = [&](const Arguments& flags) {
    Arguments command{testing::kItn, "predict", image(0), "--predictor", address};
    command.insert(command.end(), flags.begin(), flags.end());
    return run(command);
  };
  EXPECT_THAT(ask({}).output, HasSubstr("model: small 1.2, step 3"));
  EXPECT_THAT(ask({"--model", "mine", "--model-version", "7"}).output,
              HasSubstr("model: first 7, step 3"));
  const Finished unknown = ask({"--model", "theirs"});
  EXPECT_EQ(unknown.exit_code, 3);
  EXPECT_THAT(unknown.errors, HasSubstr("no model theirs; it has any, mine"));
  const std::string request = unknown.errors.substr(unknown.errors.find("(request ") + 9, 16);
  const std::string line = "Predict " + request + " of ipv4:";
  EXPECT_THAT(predictor.read_stderr_until(line), HasSubstr(line));
  const Finished list = run({testing::kItn, "models", "--predictor", address});
  EXPECT_EQ(list.exit_code, 0) << list.errors;
  EXPECT_THAT(list.output, AllOf(HasSubstr("Sun and sky (default)"), HasSubstr("mine  7  step 3")));
  export_version("8");
  predictor.send(SIGHUP);
  EXPECT_THAT(predictor.read_stderr_until("model mine 8"), HasSubstr("model mine 8"));
  EXPECT_THAT(ask({"--model", "mine"}).output, HasSubstr("model: first 8, step 3"));
}

TEST_F(PredictCommand, SaysWhichModelIsMissing) {
  ::setenv("ITN_MODELS", folder_.path("models").c_str(), 1);
  for (const Arguments& command :
       {Arguments{testing::kItn, "predict", image(0)}, Arguments{testing::kItnPredictor}}) {
    const Finished finished = run(command);
    EXPECT_EQ(finished.exit_code, 4);
    const char* const missing =
        command[0] == testing::kItn ? "any, is missing" : "real, is missing";
    EXPECT_THAT(finished.errors, AllOf(HasSubstr(missing), HasSubstr("--model FILE")));
  }
  EXPECT_EQ(run({testing::kItn, "models"}).exit_code, 4);
  ship();
  const Finished misspelt = run({testing::kItn, "predict", image(0), "--model", "studoi"});
  EXPECT_EQ(misspelt.exit_code, 4);
  EXPECT_THAT(misspelt.errors, HasSubstr("there are any, card, real, studio"));
}

// --- Many images ---

TEST_F(PredictCommand, AnswersManyImagesHereAndThereTheSame) {
  Process predictor({testing::kItnPredictor, "--model", model(), "--listen", "127.0.0.1:0",
                     "--threads", "1", "--log-level", "warning"});
  const std::string address = predictor.read_line();
  const std::string images = shared_->path("data/images");
  const Finished here = run({testing::kItn, "predict", images, "--model", model(), "--json"});
  const Finished existing =
      run({testing::kItn, "predict", images, "--predictor", address, "--json"});
  EXPECT_EQ(here.exit_code, 0) << here.errors;
  EXPECT_EQ(existing.exit_code, 0) << existing.errors;
  EXPECT_EQ(std::ranges::count(here.output, '\n'), 80);
  EXPECT_EQ(here.output, existing.output);
  EXPECT_LT(here.output.find("000000.exr"), here.output.find("000079.exr"));
  const Finished table =
      run({testing::kItn, "predict", image(1), image(2), "--predictor", address});
  EXPECT_EQ(count(table.output, "sigma_t [1/mm]"), 1);
  EXPECT_EQ(count(table.output, "model: "), 1);
  EXPECT_LT(table.output.find(image(1)), table.output.find(image(2)));
}

// Half as many are asked for until it takes them.
TEST_F(PredictCommand, AsksASmallPredictorForFewerAtATime) {
  Process predictor({testing::kItnPredictor, "--model", model(), "--listen", "127.0.0.1:0",
                     "--max-pixels", "600", "--threads", "1", "--log-level", "warning"});
  const std::string address = predictor.read_line();
  const Finished finished = run(
      {testing::kItn, "predict", shared_->path("data/images"), "--predictor", address, "--json"});
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_EQ(count(finished.output, R"("sigma_t":)"), 80);
}

TEST_F(PredictCommand, LosesNoneOfManyForOneThatIsBad) {
  const std::string bad = folder_.write("bad.exr", "no image");
  const Arguments command{testing::kItn, "predict", image(1), bad, image(2), "--model", model()};
  const Finished table = run(command);
  EXPECT_EQ(table.exit_code, 3);
  EXPECT_THAT(table.errors, HasSubstr("1 of 3 images could not be used"));
  EXPECT_THAT(table.output, AllOf(HasSubstr(image(1)), HasSubstr(bad), HasSubstr(image(2)),
                                  HasSubstr("bad.exr is text; a photograph is")));
  Arguments with_json = command;
  with_json.emplace_back("--json");
  const Finished json = run(with_json);
  EXPECT_EQ(json.exit_code, 3);
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
    return run({testing::kItn, "predict", folder_.path("photos"), "--mask", folder_.path(mask),
                "--model", model(), "--json"});
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

// --- Photographs ---

// The number of <float name="scale" value="..."/>, by which Mitsuba multiplies the coefficients.
double mitsuba_scale(const std::string& xml) {
  const std::string before = "name=\"scale\" value=\"";
  const size_t at = xml.find(before);
  return at == std::string::npos ? 0 : std::stod(xml.substr(at + before.size()));
}

// A render as a photograph: 8 bits, through the curve of sRGB, wider than high; and its mask.
class PhotographCommand : public PredictCommand {
 protected:
  PhotographCommand() {
    const Image render = read_exr(image(1));
    const std::vector<float>& y = render.channel("Y");
    const std::vector<float>& mask = render.channel("mask.Y");
    const float white = *std::ranges::max_element(y);
    const int side = render.width;
    std::vector<unsigned char> photo, mask_pixels;
    for (int row = 0; row < side; ++row) {
      for (int column = 0; column < kWidth; ++column) {
        const size_t p = static_cast<size_t>(row * side + std::min(column, side - 1));
        const bool inside = column < side;
        photo.insert(photo.end(), 3, to_srgb_byte(inside ? 0.9F * y[p] / white : 0.2F));
        mask_pixels.insert(mask_pixels.end(), 3, inside && mask[p] > 0.5F ? 255 : 0);
      }
    }
    write_png(photo_, kWidth, side, photo);
    write_png(mask_, kWidth, side, mask_pixels);
  }

  Finished predict(const Arguments& more) const {
    Arguments command{testing::kItn, "predict", photo_, "--mask", mask_, "--model", model()};
    command.insert(command.end(), more.begin(), more.end());
    return run(command);
  }

  static constexpr int kWidth = 24;
  std::string photo_ = folder_.path("photo.png"), mask_ = folder_.path("mask.png");
};

// A photograph of one channel, or of a thing without gloss, has another default model than one in
// colour, here and by a predictor; so has one whose scale of radiance is known, here.
TEST_F(PhotographCommand, ChoosesAModelByWhatIsKnownOfThePhotograph) {
  ship();
  const std::string data = folder_.path("colours"), trained = folder_.path("trained");
  const std::string config = folder_.write(
      "colours.textproto", "count: 12 resolution: 16 spp: 1 materials { colours {} }");
  const std::string real = folder_.path("models/real.itn");
  const std::string card_model = folder_.path("models/card.itn");
  for (const std::string& file : {real, card_model}) fs::remove(file);
  for (const Arguments& command :
       {Arguments{testing::kItn, "dataset", data, "--config", config, "--test-shapes", "cube"},
        Arguments{testing::kItn, "train", data, "-o", trained, "--preset", "real", "--batch", "2",
                  "--base-channels", "4", "--resolution", "16", "--steps", "2"},
        Arguments{testing::kItn, "export", trained, "-o", real, "--model-name", "real"},
        Arguments{testing::kItn, "export", trained, "-o", card_model, "--model-name", "card"}}) {
    const Finished finished = run(command);
    ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  }
  const std::string colour = folder_.path("photographs/colour.exr");
  fs::create_directories(folder_.path("photographs"));
  fs::copy(data + "/images/000000.exr", colour);
  fs::copy(image(0), folder_.path("photographs/gray.exr"));
  Process predictor({testing::kItnPredictor, "--listen", "127.0.0.1:0", "--log-level", "warning"});
  const std::string address = predictor.read_line();
  const auto csv = [&](const std::string& images, const Arguments& flags) {
    Arguments command{testing::kItn, "predict", images, "--format", "csv"};
    command.insert(command.end(), flags.begin(), flags.end());
    const Finished finished = run(command);
    EXPECT_EQ(finished.exit_code, 0) << finished.errors;
    return finished.output;
  };
  EXPECT_THAT(csv(image(0), {}), AllOf(HasSubstr("small 1.2"), Not(HasSubstr("real"))));
  EXPECT_EQ(count(csv(colour, {}), "real, step 2"), 3);
  EXPECT_EQ(count(csv(colour, {"--matt"}), "small 1.2"), 3);
  EXPECT_EQ(count(csv(colour, {"--model", "studio"}), "small 1.2"), 3);
  const std::string both = csv(folder_.path("photographs"), {});
  EXPECT_EQ(count(both, "real, step 2"), 3);
  EXPECT_EQ(count(both, "small 1.2"), 1);
  EXPECT_EQ(csv(folder_.path("photographs"), {"--predictor", address}), both);
  const Finished mixed =
      run({testing::kItn, "predict", folder_.path("photographs"), "--one-material"});
  EXPECT_EQ(mixed.exit_code, 3);
  EXPECT_THAT(mixed.errors, HasSubstr("photographs of one material have the same"));
  EXPECT_EQ(count(csv(colour, {"--exposure", "2"}), "card, step 2"), 3);
  EXPECT_EQ(count(csv(colour, {"--exposure", "2", "--matt"}), "small 1.2"), 3);
  // What was encoded by a curve that nobody knows has no scale.
  Arguments card{"--mask", mask_, "--gray-card", "17,2,6,6"};
  EXPECT_EQ(count(csv(photo_, card), "real, step 2"), 3);
  Arguments command{testing::kItn, "predict", photo_};
  command.insert(command.end(), card.begin(), card.end());
  EXPECT_THAT(run(command).errors,
              HasSubstr("the model real makes nothing of how bright the light "
                        "is by --gray-card, only of its colour; if the curve"));
  card.insert(card.end(), {"--encoding", "srgb"});
  EXPECT_EQ(count(csv(photo_, card), "card, step 2"), 3);
  EXPECT_EQ(run({testing::kItn, "predict", colour, "--matt", "--predictor", address}).exit_code, 2);
}

TEST_F(PhotographCommand, AreReadAndWarnedAbout) {
  const Finished finished = predict({});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, AllOf(HasSubstr("\nR  "), HasSubstr("\nG  "), HasSubstr("\nB  "),
                                     HasSubstr("size unknown"), HasSubstr("exposure unknown"),
                                     HasSubstr("encoded for a screen")));
  EXPECT_EQ(count(finished.output, "size unknown"), 1) << "what holds for all channels, once";
  const Finished known = predict({"--object-size", "40"});
  EXPECT_THAT(known.output, AllOf(Not(HasSubstr("size unknown")), HasSubstr("exposure unknown")));
  const Finished without_mask = run({testing::kItn, "predict", photo_, "--model", model()});
  EXPECT_EQ(without_mask.exit_code, 3);
  EXPECT_THAT(without_mask.errors, AllOf(HasSubstr("--mask"), HasSubstr("--background auto")));
}

TEST_F(PhotographCommand, AnswersHereAndThereTheSame) {
  Process predictor({testing::kItnPredictor, "--model", model(), "--listen", "127.0.0.1:0",
                     "--threads", "1", "--log-level", "warning"});
  const Arguments known{"--object-size", "40", "--json"};
  Arguments existing{testing::kItn,        "predict", photo_, "--mask", mask_, "--predictor",
                     predictor.read_line()};
  existing.insert(existing.end(), known.begin(), known.end());
  const Finished here = predict(known);
  EXPECT_EQ(here.output, run(existing).output);
  EXPECT_THAT(here.output, AllOf(HasSubstr(R"("object_size":40)"), HasSubstr(R"("ENCODED")")));
}

TEST_F(PhotographCommand, AreWrittenAsMaterialsOfRenderers) {
  const Finished printed = predict({"--format", "mitsuba", "--object-size", "40"});
  ASSERT_EQ(printed.exit_code, 0) << printed.errors;
  EXPECT_THAT(printed.output, AllOf(HasSubstr("<medium"), HasSubstr("sigma_t"), HasSubstr("40 mm"),
                                    HasSubstr("small 1.2"),
                                    HasSubstr("DO NOT TRUST THIS: R: The photograph is an outlier"),
                                    HasSubstr("ncoded for a screen")));
  EXPECT_THAT(printed.errors, HasSubstr("encoded for a screen"));
  const std::string file = folder_.path("wax.mtlx");
  ASSERT_EQ(predict({"--format", "openpbr", "-o", file, "--material-name", "wax"}).exit_code, 0);
  EXPECT_TRUE(fs::exists(file));
  // In metres the same numbers are a thousand times as large.
  const Finished metres =
      predict({"--format", "mitsuba", "--object-size", "40", "--scene-unit", "m"});
  EXPECT_NEAR(mitsuba_scale(metres.output), 1000 * mitsuba_scale(printed.output),
              1e-5 * mitsuba_scale(metres.output));
  EXPECT_EQ(predict({"--format", "renderman"}).exit_code, 2);
  EXPECT_EQ(predict({"-o", file}).exit_code, 2);
  const Finished several =
      run({testing::kItn, "predict", image(1), image(2), "--model", model(), "--format", "pbrt"});
  EXPECT_EQ(several.exit_code, 2);
  EXPECT_THAT(several.errors, HasSubstr("-o must be a folder"));
  ASSERT_EQ(run({testing::kItn, "predict", image(1), image(2), "--model", model(), "--format",
                 "pbrt", "-o", folder_.path("")})
                .exit_code,
            0);
  EXPECT_TRUE(fs::exists(folder_.path("000001.pbrt")));
  EXPECT_TRUE(fs::exists(folder_.path("000002.pbrt")));
}

TEST_F(PhotographCommand, OfTheSameNameAreNotWrittenOverEachOther) {
  fs::create_directories(folder_.path("other"));
  fs::create_directories(folder_.path("materials"));
  const std::string other = folder_.path("other/photo.exr");
  fs::copy(image(2), other);
  const Finished finished =
      run({testing::kItn, "predict", image(1), image(2), other, photo_, "--model", model(),
           "--format", "pbrt", "-o", folder_.path("materials")});
  EXPECT_EQ(finished.exit_code, 2);
  EXPECT_THAT(finished.errors, AllOf(HasSubstr("would both be written to"), HasSubstr(other)));
  // A folder is as good as a file for one image.
  EXPECT_EQ(predict({"--format", "pbrt", "-o", folder_.path("materials")}).exit_code, 0);
  EXPECT_TRUE(fs::exists(folder_.path("materials/photo.pbrt")));
  EXPECT_EQ(predict({"--format", "pbrt", "-o", folder_.path("none/photo.pbrt")}).exit_code, 4);
}

// Each alone, where only one of a group can be asked about, as where all are in one call.
TEST_F(PhotographCommand, ThatThePredictorRefusesLoseNoOthers) {
  fs::create_directories(folder_.path("photos"));
  Image dazzling = read_exr(image(1));
  for (float& y : dazzling.channels.at("Y")) y = 1e30F;
  write_exr(folder_.path("photos/a.exr"), dazzling);
  fs::copy(image(2), folder_.path("photos/b.exr"));
  Process predictor({testing::kItnPredictor, "--model", model(), "--listen", "127.0.0.1:0",
                     "--threads", "1", "--log-level", "warning"});
  const std::string address = predictor.read_line();
  const auto outputs = [&](const Arguments& images) {
    Arguments here{testing::kItn, "predict", "--exposure", "1e12", "--format", "csv"};
    here.insert(here.end(), images.begin(), images.end());
    Arguments existing = here;
    here.insert(here.end(), {"--model", model()});
    existing.insert(existing.end(), {"--predictor", address});
    const Finished by_itself = run(here), by_predictor = run(existing);
    EXPECT_EQ(by_itself.output, by_predictor.output);
    EXPECT_EQ(by_itself.exit_code, 3);
    EXPECT_EQ(by_predictor.exit_code, 3);
    return by_itself.output;
  };
  const std::string all = outputs({folder_.path("photos")});
  EXPECT_EQ(count(all, "\n"), 3);
  EXPECT_THAT(all, AllOf(HasSubstr("too bright to be computed with"), HasSubstr("b.exr,Y,"),
                         HasSubstr(folder_.path("photos/a.exr") + ": ")));
  const std::string bad = folder_.write("bad.exr", "no image");
  EXPECT_EQ(count(outputs({folder_.path("photos/a.exr"), bad}), "\n"), 3);
}

TEST_F(PhotographCommand, AreListedAsCommaSeparatedValues) {
  const std::string bad = folder_.write("bad, \"worse\".png", "no image");
  const Finished finished = run(
      {testing::kItn, "predict", image(1), bad, image(2), "--model", model(), "--format", "csv"});
  EXPECT_NE(finished.exit_code, 0);
  const std::string columns = finished.output.substr(0, finished.output.find('\n'));
  EXPECT_EQ(count(columns, ","), 21);
  EXPECT_EQ(std::ranges::count(finished.output, '\n'), 4);
  EXPECT_THAT(finished.output, HasSubstr("bad, \"\"worse\"\".png\",,,,,"));
}

TEST_F(PhotographCommand, SayWhatTheDefaultModelMakesNothingOf) {
  const std::string any = folder_.path("any.itn");
  ASSERT_EQ(run({testing::kItn, "export", shared_->path("first"), "-o", any, "--model-name", "any"})
                .exit_code,
            0);
  const Finished finished =
      run({testing::kItn, "predict", image(1), "--model", any, "--exposure", "2"});
  EXPECT_EQ(finished.exit_code, 0);
  EXPECT_THAT(finished.errors,
              HasSubstr("the model any makes nothing of --radiance-scale; card does"));
  EXPECT_EQ(run({testing::kItn, "predict", image(1), "--model", model(), "--exposure", "2"}).errors,
            "");
}

TEST_F(PhotographCommand, SayWhatIsWrongWithAGrayCard) {
  const auto errors = [&](const std::string& card) {
    const Finished finished = predict({"--gray-card", card});
    EXPECT_NE(finished.exit_code, 0);
    return finished.errors;
  };
  EXPECT_THAT(errors("1,2,3"), HasSubstr("X,Y,W,H"));
  EXPECT_THAT(errors("1,2,0,4"), HasSubstr("X,Y,W,H"));
  EXPECT_THAT(errors("20,0,5,5"), HasSubstr("is not inside of its 24 x 16 pixels"));
  EXPECT_THAT(errors("0,0,16,16"), HasSubstr("overlaps the object"));
  EXPECT_THAT(errors("18,2,4,4"), HasSubstr("a white card does not tell"));
  EXPECT_EQ(predict({"--gray-card", "18,2,4,4", "--exposure", "1"}).exit_code, 2);
}

// --- What it says of an answer ---

TEST_F(PredictCommand, WarnsOfAnImageThatIsLikeNoneOfItsTraining) {
  Image photo = read_exr(image(1));
  for (float& y : photo.channels.at("Y")) y *= 1000;
  write_exr(folder_.path("bright.exr"), photo);
  const Finished finished =
      run({testing::kItn, "predict", folder_.path("bright.exr"), "--model", model()});
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output,
              AllOf(HasSubstr("OUTLIER"), HasSubstr("do not trust this answer (mean radiance")));
  // The best model of a run knows its images as the last one does.
  ASSERT_TRUE(fs::exists(shared_->path("first/best.itn")));
  EXPECT_THAT(run({testing::kItn, "predict", folder_.path("bright.exr"), "--model",
                   shared_->path("first/best.itn")})
                  .output,
              HasSubstr("OUTLIER"));
  const Finished table =
      run({testing::kItn, "evaluate", model(), "--dataset", shared_->path("data")});
  EXPECT_THAT(table.output, HasSubstr("outliers: "));
}

TEST_F(PredictCommand, ExportsAModelWithoutItsTraining) {
  // A checkpoint holds two numbers more of each weight.
  const auto whole = static_cast<double>(fs::file_size(shared_->path("first/checkpoint.itn")));
  EXPECT_LT(static_cast<double>(fs::file_size(model())), 0.6 * whole);
  // It learns from a dataset what images are like.
  const Finished finished = run({testing::kItn, "export", model(), "-o", folder_.path("model.itn"),
                                 "--dataset", shared_->path("data")});
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, HasSubstr("small 1.2, step 3"));
  const Finished bad_name = run({testing::kItn, "export", model(), "-o", folder_.path("model.itn"),
                                 "--model-name", std::string(101, 'x')});
  EXPECT_EQ(bad_name.exit_code, 2);
  EXPECT_THAT(bad_name.errors, HasSubstr("at most 100 printable ASCII characters"));
}

// --- For people ---

// Width and height, as the head of a PNG file says.
std::pair<int, int> size_of_png(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::array<unsigned char, 24> head{};
  file.read(reinterpret_cast<char*>(head.data()), head.size());
  const auto number = [&](size_t i) { return 256 * head[i + 2] + head[i + 3]; };
  return {number(16), number(20)};
}

std::string text_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

class PredictForPeople : public PhotographCommand {
 protected:
  std::string picture_ = folder_.path("picture.png"), report_ = folder_.path("report.html");
};

TEST_F(PredictForPeople, DrawsWhatItSawAndWritesAPage) {
  const Finished finished = predict({"--object-size", "40", "--picture", picture_, "--report",
                                     report_, "--material-name", "wax", "--spp", "4"});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_THAT(finished.output, HasSubstr("model: small 1.2"));
  const auto [width, height] = size_of_png(picture_);
  EXPECT_GE(height, 256);
  EXPECT_EQ(width, 3 * height + 2 * 8);
  EXPECT_THAT(text_of(report_),
              AllOf(HasSubstr("<!doctype html>"), HasSubstr("photo.png"), HasSubstr("small 1.2"),
                    HasSubstr("40 mm"), HasSubstr("Encoded for a screen"), HasSubstr("<svg"),
                    HasSubstr("wax")));
  EXPECT_EQ(count(text_of(report_), "data:image/png"), 3 + 4) << "panels, and swatches";
}

TEST_F(PredictForPeople, RendersTheSceneWithTheAnswer) {
  const auto scene = [&](const std::string& film) {
    return folder_
        .write("scene.textproto",
               "object { mesh { builtin: \"cube\" } } lights { constant {} } camera { "
               "origin { y: .5 z: -30 } target { y: .5 } fov_degrees: 2.9 } film { " +
                   film + " }")
        .string();
  };
  const std::string photo = folder_.path("render.exr");
  ASSERT_EQ(run({testing::kItn, "render", scene("width: 32 height: 32"), "-o", photo, "--sigma-t",
                 "50", "--albedo", "0.9", "--spp", "4", "--pixels", "object"})
                .exit_code,
            0);
  const auto with_scene = [&](const std::string& film) {
    return run({testing::kItn, "predict", photo, "--model", model(), "--picture", picture_,
                "--report", report_, "--spp", "4", "--scene", scene(film)});
  };
  const Finished finished = with_scene("width: 64 height: 64");  // is made as small
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_EQ(size_of_png(picture_), (std::pair{5 * 256 + 4 * 8, 256}));
  EXPECT_EQ(count(text_of(report_), "data:image/png"), 3 + 3 + 4) << "beside the photograph, too";
  EXPECT_THAT(finished.errors, HasSubstr("rendering 5/5 pictures"));
  const Finished wide = with_scene("width: 64 height: 32");
  EXPECT_EQ(wide.exit_code, 3);
  EXPECT_THAT(wide.errors, AllOf(HasSubstr("64 x 32"), HasSubstr("the photograph 32 x 32")));
}

TEST_F(PredictForPeople, TakesOneImageOrOneMaterial) {
  // Only models that answer distributions can combine what they say of several images.
  const Finished trained =
      run({testing::kItn, "train", shared_->path("data"), "-o", folder_.path("residual"),
           "--preset", "residual", "--batch", "2", "--base-channels", "4", "--steps", "2"});
  ASSERT_EQ(trained.exit_code, 0) << trained.errors;
  const auto of_two = [&](const Arguments& more) {
    Arguments command{testing::kItn, "predict", image(1),
                      image(2),      "--model", folder_.path("residual")};
    command.insert(command.end(), more.begin(), more.end());
    return run(command);
  };
  const Finished two = of_two({"--picture", picture_});
  EXPECT_EQ(two.exit_code, 2);
  EXPECT_THAT(two.errors, HasSubstr("--one-material"));
  EXPECT_EQ(of_two({"--report", report_}).exit_code, 2);
  EXPECT_FALSE(fs::exists(picture_) || fs::exists(report_));
  const Finished together =
      of_two({"--one-material", "--picture", picture_, "--report", report_, "--spp", "4"});
  ASSERT_EQ(together.exit_code, 0) << together.errors;
  EXPECT_EQ(size_of_png(picture_), (std::pair{3 * 256 + 2 * 8, 2 * 256 + 8}));
  EXPECT_THAT(text_of(report_), AllOf(HasSubstr("from 2 photographs"), HasSubstr("000001.exr"),
                                      HasSubstr("000002.exr")));
  const Finished scene = of_two({"--one-material", "--picture", picture_, "--scene", "s"});
  EXPECT_EQ(scene.exit_code, 2);
  EXPECT_THAT(scene.errors, HasSubstr("--scene is of one image"));
}

TEST_F(PhotographCommand, AreNotReplacedByWhatIsSaidOfThem) {
  const Finished photograph = predict({"--format", "pbrt", "-o", photo_});
  EXPECT_EQ(photograph.exit_code, 2);
  EXPECT_THAT(photograph.errors, HasSubstr("--output " + photo_ + ": that is the input"));
  const Finished mask = predict({"--picture", folder_.path("./mask.png")});
  EXPECT_EQ(mask.exit_code, 2);
  EXPECT_THAT(mask.errors, HasSubstr("that is the input " + mask_));
  EXPECT_EQ(predict({}).exit_code, 0);
}

TEST_F(PhotographCommand, ThatCannotBeUsedAreNamed) {
  write_png(photo_, 2, 1, std::vector<unsigned char>{0, 0, 0, 0, 0, 0});
  write_png(mask_, 2, 1, std::vector<unsigned char>{255, 255, 255, 0, 0, 0});
  const Finished black = predict({});
  EXPECT_EQ(black.exit_code, 3);
  EXPECT_THAT(black.errors, HasSubstr(photo_ + ": the image is black"));
  write_png(mask_, 2, 1, std::vector<unsigned char>{0, 0, 0, 0, 0, 0});
  EXPECT_THAT(predict({}).errors, HasSubstr(photo_ + ": the mask " + mask_ + " is black"));
  const Finished table = predict({"--format", "csv", "-o", folder_.path("out.csv")});
  EXPECT_EQ(table.exit_code, 2);
  EXPECT_THAT(table.errors, HasSubstr("--format csv > " + folder_.path("out.csv")));
}

TEST_F(PredictForPeople, SaysBeforeTheWorkWhereItCannotWrite) {
  EXPECT_EQ(predict({"--picture", folder_.path("picture.jpg")}).exit_code, 2);
  EXPECT_EQ(predict({"--report", "-"}).exit_code, 2);
  EXPECT_EQ(predict({"--scene", "scene.textproto"}).exit_code, 2);
  const Finished missing = predict({"--report", folder_.path("no/report.html")});
  EXPECT_EQ(missing.exit_code, 4);
  EXPECT_EQ(missing.output, "");
}

}  // namespace
}  // namespace itn
