#include "client/experiment/refinements.h"

#include <gmock/gmock.h>

#include "client/scene/text_proto.h"
#include "client/training/evaluation.h"
#include "common/files/atomic_file.h"
#include "common/scene/material_proto.h"
#include "tests/client/experiment/experiment_fixture.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

class ExperimentRefinementsTest : public SmallExperiment {
 protected:
  static std::vector<v1::ExperimentRefinement> refine(const std::string& folder,
                                                      std::span<const Material> starts) {
    const v1::ExperimentRefinements refined =
        refine_images(experiment_.refinement(), *dataset_, test_, starts, files_->path(folder),
                      *pool_, [](size_t, size_t) {}, {});
    return {refined.images().begin(), refined.images().end()};
  }
};

TEST_F(ExperimentRefinementsTest, TellTheIterationsThatAreAskedFor) {
  const std::vector<Material> starts = wrong_materials();
  const std::vector<v1::ExperimentRefinement> refined = refine("told", starts);
  const std::vector<uint32_t> images = refined_images(experiment_.refinement(), test_.truth.size());
  EXPECT_EQ(images, spread(2, 6));
  ASSERT_EQ(refined.size(), 2U);
  for (size_t k = 0; k < refined.size(); ++k) {
    ASSERT_EQ(refined[k].adam_size(), 2);
    ASSERT_EQ(refined[k].gauss_newton_size(), 3);
    // The first is the start of both; then they differ, and cost more and more.
    const Material& start = starts[images[k]];
    EXPECT_NEAR(refined[k].adam(0).material().sigma_t(), start.sigma_t, 1e-3 * start.sigma_t);
    EXPECT_NEAR(refined[k].gauss_newton(0).material().albedo(), start.albedo, 1e-5);
    EXPECT_NE(refined[k].adam(1).material().albedo(), refined[k].adam(0).material().albedo());
    EXPECT_GT(refined[k].adam(1).cpu_seconds(), refined[k].adam(0).cpu_seconds());
    EXPECT_GE(refined[k].gauss_newton(2).cpu_seconds(), refined[k].gauss_newton(1).cpu_seconds());
    // Its images are more like the one that is looked for than those of the start.
    EXPECT_LT(refined[k].gauss_newton(2).loss(), 0.5 * refined[k].gauss_newton(0).loss());
  }
}

// Whatever the images are, as long as the refinements began where they are to begin.
TEST_F(ExperimentRefinementsTest, OfImagesThatAreDoneAreNotDoneAgain) {
  const fs::path folder = files_->path("kept");
  fs::create_directories(folder);
  const std::vector<uint32_t> images = refined_images(experiment_.refinement(), test_.truth.size());
  const std::vector<fs::path> files =
      refinement_files(experiment_.refinement(), test_.truth.size(), folder);
  v1::ExperimentRefinement done;
  done.add_adam()->set_loss(17);
  *done.mutable_start() = to_proto(test_.truth[images[0]]);
  done.mutable_start()->set_g(done.start().g() + 0.01);
  write_file_atomically(files[0], to_text_proto(done));
  *done.mutable_start() = to_proto(test_.truth[images[1]]);
  write_file_atomically(files[1], to_text_proto(done));
  const std::vector<v1::ExperimentRefinement> refined = refine("kept", test_.truth);
  EXPECT_EQ(refined[0].adam_size(), 2);
  EXPECT_EQ(to_text_proto(refined[1]), to_text_proto(done));
}

}  // namespace
}  // namespace itn
