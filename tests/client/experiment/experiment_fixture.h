// A small experiment whose dataset is rendered, without networks: what its images, refinements and
// report are made of.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <optional>
#include <string>

#include "client/dataset/dataset_render.h"
#include "client/dataset/shape_set.h"
#include "client/experiment/colours.h"
#include "client/experiment/experiment_config.h"
#include "client/experiment/images.h"
#include "client/training/training_set.h"
#include "tests/support/temporary_folder.h"

namespace itn {

inline constexpr const char* kSmallStudy = R"(
dataset {
  count: 16 resolution: 16 spp: 64
  shapes { builtin { names: ["sphere", "cube", "torus", "cone"] } }
  test_shapes: ["torus", "cone"] test_fraction: 0.375 validation_fraction: 0.2
}
steps: 5 shared_steps: 10
rerendering { images: 3 spp: 1024 shown: 2 }
refinement { images: 2 spp: 16 max_spp: 64 iterations: [1, 4] gauss_newton_iterations: [1, 2, 9] }
networks { name: "RN+naive" settings { loss: RN parameterization: NAIVE } }
networks { name: "ITN+naive" settings { loss: ITN parameterization: NAIVE } }
)";

// Rendered once for all tests of a suite.
class SmallExperiment : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    files_ = std::make_unique<testing::TemporaryFolder>();
    pool_.emplace(RenderPoolOptions());
    experiment_ = load_experiment(files_->write("study.textproto", kSmallStudy));
    const v1::DatasetConfig& config = experiment_.dataset();
    DatasetPlan plan = plan_dataset(config, shape_set(config.shapes()).shapes);
    render_dataset(plan, files_->path("data"), *pool_, [](const DatasetProgress&) {});
    dataset_.emplace(files_->path("data"));
    test_ = images_of(*dataset_, v1::SPLIT_TEST);
  }
  static void TearDownTestSuite() {
    dataset_.reset();
    pool_.reset();
    files_.reset();
  }

  static ExperimentImages images(const std::string& folder) {
    return ExperimentImages(experiment_.rerendering(), *dataset_, test_, files_->path(folder),
                            files_->path(folder + "_pictures"));
  }
  // For each image of the test: much darker than it, or much brighter.
  static std::vector<Material> wrong_materials() {
    std::vector<Material> materials = test_.truth;
    for (Material& m : materials) m.albedo = m.albedo > 0.65 ? 0.4 : 0.95;
    return materials;
  }

  static inline std::unique_ptr<testing::TemporaryFolder> files_;
  static inline std::optional<RenderPool> pool_;
  static inline v1::Experiment experiment_;
  static inline std::optional<DatasetReader> dataset_;
  static inline LabelledImages test_;
};

}  // namespace itn
