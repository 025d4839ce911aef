#include "client/experiment/forecast.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "client/dataset/plan.h"
#include "client/dataset/shape_set.h"
#include "client/experiment/experiment.h"
#include "client/experiment/experiment_config.h"
#include "common/scene/text_proto.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using ::testing::IsSupersetOf;
using testing::TemporaryFolder;

v1::Experiment experiment_of(const std::string& text) {
  const TemporaryFolder folder;
  return load_experiment(folder.write("e.textproto", text));
}

TEST(Miniature, OfEveryPresetIsAnExperimentOfAllItsStages) {
  for (const ExperimentPreset& preset : experiment_presets()) {
    SCOPED_TRACE(preset.name);
    const v1::Experiment whole = experiment_of_preset(preset.name);
    const v1::Experiment small = miniature(whole);
    EXPECT_LE(small.dataset().count(), 24U);
    EXPECT_LE(small.steps(), 3U);
    EXPECT_LE(small.rerendering().images(), 2U);
    for (const v1::StudyNetwork& network : small.networks()) {
      EXPECT_EQ(network.as_long_as(), "");
    }
    // It can be loaded, and what it is measured by is not made smaller.
    const v1::Experiment again = experiment_of(to_text_proto(small));
    EXPECT_NO_THROW(split_shapes(again.dataset(), shape_set(again.dataset().shapes()).shapes));
    EXPECT_EQ(again.dataset().resolution(), whole.dataset().resolution());
    EXPECT_EQ(own_training(again, again.networks(0), 1).batch(),
              own_training(whole, whole.networks(0), 1).batch());
    EXPECT_EQ(own_training(again, again.networks(2), 1).spp(),
              own_training(whole, whole.networks(2), 1).spp());
    EXPECT_THAT(stage_names(small), IsSupersetOf(stage_names(whole)));
  }
}

// A miniature run that took these seconds, 2 seconds for each step of every network, and left 1,000
// bytes in each place.
class ExtrapolatedTest : public ::testing::Test {
 protected:
  ExtrapolatedTest() {
    for (const char* run : {"networks/rn_naive", "networks/itn_naive", "shared/1"}) {
      std::filesystem::create_directories(folder_.path(run));
      v1::NetworkCost cost;
      cost.set_steps(3);
      cost.set_seconds(6);
      folder_.write(std::string(run) + "/cost.textproto", to_text_proto(cost));
    }
    std::filesystem::create_directories(folder_.path("data/images"));
    folder_.write("data/images/a.exr", std::string(1000, 'x'));
  }

  static v1::Experiment study(const std::string& more = "") {
    return experiment_of(R"(
      dataset {
        count: 2400 resolution: 16 spp: 8
        shapes { builtin { names: ["sphere", "cube", "torus", "cone"] } }
        test_fraction: 0.25 validation_fraction: 0.25
      }
      training { batch: 10 }
      steps: 1000 shared_steps: 500 validate_every: 100
      rerendering { images: 20 spp: 8 shown: 4 }
      networks { name: "RN+naive" settings { loss: RN parameterization: NAIVE } }
      networks { name: "ITN+naive" settings { loss: ITN parameterization: NAIVE } }
      )" + more);
  }
  // Every stage of the miniature took a second.
  std::vector<StageForecast> extrapolate(const v1::Experiment& experiment) const {
    const v1::Experiment small = miniature(experiment);
    std::map<std::string, double> seconds;
    for (const std::string& name : stage_names(small)) seconds[name] = 1;
    return extrapolated(experiment, small, folder_.path(), seconds);
  }
  static StageForecast stage(const std::vector<StageForecast>& stages, const std::string& name) {
    const auto there = std::ranges::find(stages, name, &StageForecast::name);
    if (there != stages.end()) return *there;
    ADD_FAILURE() << "there is no stage " << name;
    return {};
  }

  const TemporaryFolder folder_;
};

TEST_F(ExtrapolatedTest, CountsImages) {
  const std::vector<StageForecast> stages = extrapolate(study());
  EXPECT_EQ(stages.size(), stage_names(study()).size());
  EXPECT_DOUBLE_EQ(stage(stages, "dataset").seconds, 100);  // 2,400 of 24
  EXPECT_EQ(stage(stages, "dataset").bytes, 100'000U);
  EXPECT_DOUBLE_EQ(stage(stages, "predict RN+naive").seconds, 100);
  EXPECT_DOUBLE_EQ(stage(stages, "images of RN+naive").seconds, 10);  // 20 of 2
  EXPECT_DOUBLE_EQ(stage(stages, "colours of RN+naive").seconds, 4);
}

TEST_F(ExtrapolatedTest, CountsStepsAndLooksAtTheValidation) {
  const std::vector<StageForecast> stages = extrapolate(study());
  // A look at 600 images is 20 steps of 10, forward only: 10 and 5 looks.
  EXPECT_DOUBLE_EQ(stage(stages, "train RN+naive").seconds, 2 * (1000 + 10 * 20));
  EXPECT_DOUBLE_EQ(stage(stages, "shared start 1").seconds, 2 * (500 + 5 * 20));
}

TEST_F(ExtrapolatedTest, ANetworkAsLongAsAnotherTakesAsLong) {
  v1::NetworkCost dear;
  dear.set_steps(3);
  dear.set_seconds(60);
  folder_.write("networks/itn_naive/cost.textproto", to_text_proto(dear));
  std::filesystem::create_directories(folder_.path("networks/rn_as_long"));
  folder_.write("networks/rn_as_long/cost.textproto", to_text_proto(dear));
  const std::vector<StageForecast> stages = extrapolate(
      study("networks { name: \"RN, as long\" settings { loss: RN parameterization: NAIVE } "
            "as_long_as: \"ITN+naive\" }"));
  EXPECT_DOUBLE_EQ(stage(stages, "train RN, as long").seconds, 20 * (1000 + 10 * 20));
}

TEST_F(ExtrapolatedTest, CountsTheRatesThatAreTried) {
  const std::vector<StageForecast> stages =
      extrapolate(study("rate_search { rates: [1e-3, 2e-3, 4e-3] steps: 200 }"));
  EXPECT_DOUBLE_EQ(stage(stages, "learning rate").seconds, 3 * 2 * (200 + 2 * 20));
}

// 150 iterations of Adam at 32, and of Gauss-Newton 32, 64, ..., 512 and 512 again up to 15; of the
// miniature 3 of each.
TEST_F(ExtrapolatedTest, CountsTheSamplesOfRefinements) {
  const std::vector<StageForecast> stages = extrapolate(study("refinement {}"));
  const double all = 150 * 32 + 32 + 64 + 128 + 256 + 11 * 512, few = 3 * 32 + 32 + 64 + 128;
  EXPECT_DOUBLE_EQ(stage(stages, "refine from RN+naive").seconds, 40 * all / few);
}

}  // namespace
}  // namespace itn
