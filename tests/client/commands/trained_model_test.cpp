// What itn train and itn export write into a model, as processes.
#include <gtest/gtest.h>

#include <string>

#include "common/learning/checkpoint.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn::testing {
namespace {

v1::Model model_of(const std::string& path) {
  return read_checkpoint(path).model();
}

// All lights of the preset any have one irradiance, those of outdoor what the sun gives.
TEST(TrainedModel, SaysWhatIrradianceItsImagesHaveAndWhatCamerasDidToThem) {
  const TemporaryFolder folder;
  const auto train = [&](const std::string& preset, const std::string& run_folder) {
    return run({testing::kItn,
                "train",
                "--stream",
                preset,
                "-o",
                run_folder,
                "--preset",
                "residual",
                "--batch",
                "2",
                "--base-channels",
                "4",
                "--held",
                "32",
                "--first-images",
                "32",
                "--steps",
                "1",
                "--torch-threads",
                "1",
                preset == "any" ? "--camera" : "--mirror"});
  };
  const std::string any = folder.path("any"), outdoor = folder.path("outdoor");
  const Finished trained = train("any", any);
  ASSERT_EQ(trained.exit_code, 0) << trained.errors;
  EXPECT_EQ(model_of(any).irradiance(), 100);
  EXPECT_GT(model_of(any).camera().blur(), 0);
  const std::string model = folder.path("model.itn");
  const Finished exported = run({testing::kItn, "export", any, "-o", model});
  ASSERT_EQ(exported.exit_code, 0) << exported.errors;
  EXPECT_EQ(model_of(model).irradiance(), 100);
  EXPECT_GT(model_of(model).camera().blur(), 0);
  ASSERT_EQ(train("outdoor", outdoor).exit_code, 0);
  EXPECT_EQ(model_of(outdoor).irradiance(), 0);
  EXPECT_FALSE(model_of(outdoor).has_camera());
}

// A network that knew nothing of the exposure learns it.
TEST(TrainedModel, GoesOnFromOneOfTheOtherExposure) {
  const TemporaryFolder folder;
  const auto train = [&](const char* preset, const std::string& run_folder,
                         const std::vector<std::string>& more) {
    std::vector<std::string> command = {testing::kItn, "train",    "--stream",        preset,
                                        "-o",          run_folder, "--preset",        "residual",
                                        "--batch",     "2",        "--base-channels", "4",
                                        "--held",      "4",        "--first-images",  "4",
                                        "--steps",     "1",        "--torch-threads", "1"};
    command.insert(command.end(), more.begin(), more.end());
    return run(command);
  };
  const std::string unknown = folder.path("unknown"), known = folder.path("known");
  ASSERT_EQ(train("outdoor", unknown, {"--exposure", "unknown"}).exit_code, 0);
  const Finished finished = train("any", known, {"--init", unknown, "--exposure", "known"});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_EQ(model_of(known).exposure(), v1::EXPOSURE_KNOWN);
  EXPECT_GT(model_of(known).image_scale(), 0);
  EXPECT_NE(model_of(known).image_scale(), model_of(unknown).image_scale());
  EXPECT_EQ(model_of(known).mean(0), model_of(unknown).mean(0)) << "its coordinates are another's";
}

}  // namespace
}  // namespace itn::testing
