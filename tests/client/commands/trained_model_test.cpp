// What itn train and itn export write into a model, as processes.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "common/learning/checkpoint.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn::testing {
namespace {

v1::Model model_of(const std::string& path) {
  return read_checkpoint(path).model();
}

// Trains for a step with a few images of a preset of itn dataset.
Finished train(const TemporaryFolder& folder, const std::string& preset, const std::string& name,
               const std::vector<std::string>& more) {
  const std::string dataset = folder.path("dataset-" + name);
  const Finished made = run({kItn, "dataset", dataset, "--preset", preset, "--random-shapes", "4",
                             "--count", "48", "--resolution", "16", "--spp", "2"});
  if (made.exit_code != 0) return made;
  std::vector<std::string> command = {
      kItn,      "train", dataset,           "-o", folder.path(name), "--preset", "residual",
      "--batch", "2",     "--base-channels", "4",  "--steps",         "1",        "--torch-threads",
      "1"};
  command.insert(command.end(), more.begin(), more.end());
  return run(command);
}

// All lights of the preset any have one irradiance, those of outdoor what the sun gives.
TEST(TrainedModel, SaysWhatIrradianceItsImagesHaveAndWhatCamerasDidToThem) {
  const TemporaryFolder folder;
  const std::string any = folder.path("any"), outdoor = folder.path("outdoor");
  const Finished trained = train(folder, "any", "any", {"--camera"});
  ASSERT_EQ(trained.exit_code, 0) << trained.errors;
  EXPECT_EQ(model_of(any).irradiance(), 100);
  EXPECT_GT(model_of(any).camera().blur(), 0);
  const std::string model = folder.path("model.itn");
  const Finished exported = run({kItn, "export", any, "-o", model});
  ASSERT_EQ(exported.exit_code, 0) << exported.errors;
  EXPECT_EQ(model_of(model).irradiance(), 100);
  EXPECT_GT(model_of(model).camera().blur(), 0);
  ASSERT_EQ(train(folder, "outdoor", "outdoor", {}).exit_code, 0);
  EXPECT_EQ(model_of(outdoor).irradiance(), 0);
  EXPECT_FALSE(model_of(outdoor).has_camera());
}

// A network that knew nothing of the exposure learns it.
TEST(TrainedModel, GoesOnFromOneOfTheOtherExposure) {
  const TemporaryFolder folder;
  const std::string unknown = folder.path("unknown"), known = folder.path("known");
  ASSERT_EQ(train(folder, "outdoor", "unknown", {"--exposure", "unknown"}).exit_code, 0);
  const Finished finished =
      train(folder, "any", "known", {"--init", unknown, "--exposure", "known"});
  ASSERT_EQ(finished.exit_code, 0) << finished.errors;
  EXPECT_EQ(model_of(known).exposure(), v1::EXPOSURE_KNOWN);
  EXPECT_GT(model_of(known).image_scale(), 0);
  EXPECT_NE(model_of(known).image_scale(), model_of(unknown).image_scale());
  EXPECT_EQ(model_of(known).mean(0), model_of(unknown).mean(0)) << "its coordinates are another's";
}

// The run is one that itn 0.1 could begin.
TEST(TrainedModel, OfAStreamIsWhatAnotherRunGoesOnFrom) {
  const TemporaryFolder folder;
  ASSERT_EQ(train(folder, "outdoor", "stream", {}).exit_code, 0);
  const std::string stream = folder.path("stream");
  v1::Checkpoint checkpoint = read_checkpoint(stream);
  checkpoint.mutable_training()->clear_dataset();
  write_checkpoint(stream + "/checkpoint.itn", checkpoint);
  const Finished refused = run({kItn, "train", "--resume", "-o", stream, "--steps", "2"});
  EXPECT_EQ(refused.exit_code, 3);
  EXPECT_NE(refused.errors.find("itn train DATASET -o RUN --init " + stream), std::string::npos);
  const Finished goes_on = train(folder, "outdoor", "on", {"--init", stream});
  EXPECT_EQ(goes_on.exit_code, 0) << goes_on.errors;
}

}  // namespace
}  // namespace itn::testing
