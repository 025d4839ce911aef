#include "client/experiment/experiment_config.h"

#include <gtest/gtest.h>

#include "client/presets/presets.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace testing;

// The smallest experiment that is one, and more fields.
std::string file(const std::string& more = "") {
  return "steps: 3\n"
         "networks { name: \"A\" settings { loss: RN parameterization: NAIVE } }\n" +
         more;
}

v1::Experiment loaded(const std::string& text) {
  const TemporaryFolder folder;
  return load_experiment(folder.write("e.textproto", text));
}

void expect_refused(const std::string& text, const std::vector<std::string>& parts) {
  expect_error(ErrorKind::kInvalidInput, parts, [&] { loaded(text); });
}

TEST(ExperimentFile, TyposAreErrorsWithLineAndColumn) {
  expect_refused(file("stepps: 3\n"), {"e.textproto:3:7", "stepps"});
  expect_refused(file("networks { name: \"B\"\n  settings { los: RN } }\n"),
                 {"e.textproto:4:17", "los"});
  expect_refused(file("dataset { count: \"many\" }\n"), {"e.textproto:3:18"});
}

TEST(ExperimentFile, WhatIsOutOfRangeIsNamed) {
  expect_refused("steps: 3\n", {"no networks"});
  expect_refused("networks { name: \"A\" settings { parameterization: NAIVE } }", {"steps is 0"});
  expect_refused(file("rate_factor: 2"), {"rate_factor is 2", "(0, 1]"});
  expect_refused(file("rate_search { rates: [1e-3, 0] steps: 5 }"), {"rate_search.rates has 0"});
  expect_refused(file("rate_search { rates: 1e-3 }"), {"rate_search.steps is 0"});
  expect_refused(file("dataset { test_fraction: 0 }"), {"no test split"});
  expect_refused(file("dataset { validation_fraction: 0 }"), {"no validation split"});
  expect_refused(file("dataset { materials { colours {} } }"), {"not in colour"});
  expect_refused(file("other_noise {}"), {"other_noise says nothing"});
  expect_refused(file("other_noise { target { target: 3 } }"), {"other_noise: ", "target is 3"});
  expect_refused(file("networks { name: \"A+\" }"), {"two networks are called A+"});
  expect_refused(file("networks { name: \"a/b\" }"), {"\"a/b\""});
  expect_refused(file("networks { name: \"B\" as_long_as: \"C\" }"), {"B: as_long_as is \"C\""});
  expect_refused(file("networks { name: \"B\" settings { output: GAUSSIAN } }"),
                 {"B: ", "UNBOUNDED"});
  expect_refused(file("networks { name: \"B\" settings { input: RATIOS augmentation { "
                      "first_order_step: 0.1 } } }"),
                 {"B: ", "first_order_step", "derivatives: true"});
  expect_refused(file("training_preset: \"best\""), {"\"best\"", "paper"});
  expect_refused(file("refinement { networks: [\"A\", \"C\"] }"),
                 {"refinement.networks has \"C\""});
  expect_refused(file("rerendering { novel_shape: \"teapot\" }"), {"novel_shape", "teapot"});
  expect_refused(file("refinement { iterations: [1, 5, 5] }"), {"refinement.iterations", "rise"});
}

// A file of itn 0.1 is read, and what was made of it then is known by its text of then.
TEST(ExperimentFile, UnderstandsTheNamesOf01) {
  const auto with_step = [](const char* name) {
    return loaded(
        file("dataset { derivatives: true } networks { name: \"B\" settings { input: RATIOS "
             "augmentation { " +
             std::string(name) + ": 0.5 } } }"));
  };
  const v1::Experiment experiment = with_step("material_step");
  EXPECT_EQ(to_text_proto(experiment), to_text_proto(with_step("first_order_step")));
  EXPECT_THAT(to_text_proto_of_01(experiment), ::testing::HasSubstr("material_step: 0.5\n"));
}

TEST(ExperimentFile, PresetsAreFilesThatCanBeRead) {
  for (const Preset& preset : experiment_presets()) {
    const v1::Experiment experiment = loaded(std::string(preset.file));
    EXPECT_GE(experiment.networks_size(), 2)
        << preset.name;  // the first, and what it is compared with
    EXPECT_EQ(to_text_proto(experiment), to_text_proto(experiment_of_preset(preset.name)));
    // With all defaults: as a file again it is the same.
    EXPECT_EQ(to_text_proto(loaded(to_text_proto(experiment))), to_text_proto(experiment));
  }
  expect_error(ErrorKind::kInvalidInput,
               {"\"tiny\"", "smoke, small, ablation, few_shapes, paper_64, paper_64_gloss, paper"},
               [] { experiment_of_preset("tiny"); });
}

TEST(ExperimentFile, PaperIsTheProtocolOfThePaper) {
  const v1::Experiment paper = experiment_of_preset("paper");
  const v1::MaterialChoice& materials = paper.dataset().materials();
  EXPECT_EQ(materials.sigma_t().one_of().value_size() * materials.albedo().one_of().value_size() *
                materials.g().one_of().value_size(),
            300);
  const int train = paper.dataset().shapes().builtin().names_size() -
                    paper.dataset().test_shapes_size() - paper.dataset().validation_shapes_size();
  EXPECT_EQ(train, 6);
  EXPECT_EQ(paper.dataset().test_shapes_size(), 4);
  const v1::TrainingConfig training = own_training(paper, paper.networks(0), 1e-4);
  EXPECT_EQ(training.batch(), 60);
  EXPECT_EQ(training.steps() * training.batch(), 50U * 6 * 4 * 300);  // 50 epochs of 7,200 images
}

TEST(ExperimentNetworks, DifferInWhatTheySayAlone) {
  const v1::Experiment experiment = loaded(
      "steps: 30 shared_steps: 70 rate_factor: 0.5 seed: 4\n"
      "training { batch: 7 warmup_steps: 20 }\n"
      "networks { name: \"RN\" settings { parameterization: NAIVE } }\n"
      "networks { name: \"ITN\" settings { loss: ITN parameterization: NAIVE spp: 8 } }\n");
  const v1::TrainingConfig rn = own_training(experiment, experiment.networks(0), 0.01);
  v1::TrainingConfig itn = own_training(experiment, experiment.networks(1), 0.01);
  EXPECT_EQ(rn.loss(), v1::TrainingConfig::RN);
  EXPECT_EQ(rn.batch(), 7);
  EXPECT_EQ(rn.steps(), 30U);
  EXPECT_EQ(rn.warmup_steps(), 3U);  // a tenth
  EXPECT_DOUBLE_EQ(rn.learning_rate(), 0.005);
  EXPECT_EQ(rn.seed(), 4U);
  EXPECT_EQ(rn.spp(), 0U);  // it renders nothing
  EXPECT_EQ(itn.loss(), v1::TrainingConfig::ITN);
  EXPECT_EQ(itn.spp(), 8U);
  itn.set_loss(rn.loss());
  itn.clear_spp();
  itn.clear_estimates();
  itn.clear_pilot_spp();
  EXPECT_EQ(to_text_proto(itn), to_text_proto(rn));
  // A seed of its own.
  v1::ExperimentNetwork seeded = experiment.networks(0);
  seeded.mutable_settings()->set_seed(9);
  EXPECT_EQ(own_training(experiment, seeded, 0.01).seed(), 9U);
  EXPECT_EQ(shared_training(experiment, seeded, 0.01).seed(), 9U);
  // Both begin alike, as RN at the full rate.
  const v1::TrainingConfig shared = shared_training(experiment, experiment.networks(1), 0.01);
  EXPECT_EQ(to_text_proto(shared),
            to_text_proto(shared_training(experiment, experiment.networks(0), 0.01)));
  EXPECT_EQ(shared.steps(), 70U);
  EXPECT_DOUBLE_EQ(shared.learning_rate(), 0.01);
  EXPECT_EQ(file_name_of("ITN+similar, time of ITN"), "itn_similar_time_of_itn");
}

}  // namespace
}  // namespace itn
