#include "client/experiment/images.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <utility>
#include <vector>

#include "client/image/ms_ssim.h"
#include "client/scene/text_proto.h"
#include "client/training/evaluation.h"
#include "tests/client/experiment/experiment_fixture.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using testing::expect_error;
using ::testing::Lt;

void nobody(size_t, size_t) {}

class ExperimentImagesTest : public SmallExperiment {};

TEST_F(ExperimentImagesTest, AreSpreadOverTheTest) {
  const ExperimentImages study = images("spread");
  EXPECT_EQ(study.chosen(), spread(3, 6));
  EXPECT_EQ(study.shown().size(), 2U);
  EXPECT_EQ(study.resolution(), 16);
}

TEST_F(ExperimentImagesTest, ComparesWithTheTruthInBothScenes) {
  ExperimentImages study = images("compared");
  std::vector<std::pair<size_t, size_t>> progress;
  study.render_references(
      *pool_, [&](size_t done, size_t total) { progress.emplace_back(done, total); }, {});
  EXPECT_EQ(progress.front(), std::pair(size_t{0}, size_t{6}));
  EXPECT_EQ(progress.back(), std::pair(size_t{6}, size_t{6}));
  const v1::ExperimentImageErrors truth = study.compare(test_.truth, *pool_, nobody, {});
  const v1::ExperimentImageErrors wrong = study.compare(wrong_materials(), *pool_, nobody, {});
  ASSERT_EQ(truth.same_scene_size(), 3);
  ASSERT_EQ(truth.novel_scene_size(), 3);
  for (int k = 0; k < 3; ++k) {
    // What is left of the truth is noise, of which there is more than none.
    EXPECT_GT(truth.same_scene(k).relative_l2(), 0);
    EXPECT_LT(truth.same_scene(k).relative_l2(), 0.5 * wrong.same_scene(k).relative_l2());
    EXPECT_LT(truth.novel_scene(k).relative_l2(), 0.5 * wrong.novel_scene(k).relative_l2());
    EXPECT_LT(truth.same_scene(k).dissimilarity(), wrong.same_scene(k).dissimilarity());
    EXPECT_LT(truth.novel_scene(k).dissimilarity(), wrong.novel_scene(k).dissimilarity());
  }
  // The novel scene is another one, and the same whatever the image was of.
  EXPECT_NE(study.reference(ExperimentScene::kSame, 0),
            study.reference(ExperimentScene::kNovel, 0));
}

// By the same random numbers as images that are compared; the second time they are there.
TEST_F(ExperimentImagesTest, PicturesComeWithTheirReferences) {
  ExperimentImages study = images("shown");
  study.render_pictures("wrong", wrong_materials(), *pool_, {});
  const size_t k = study.shown()[1];
  const std::vector<float> picture = study.picture("wrong", ExperimentScene::kNovel, k);
  EXPECT_EQ(picture.size(), 256U);
  EXPECT_EQ(study.reference(ExperimentScene::kNovel, k).size(), 256U);
  EXPECT_NE(study.picture("wrong", ExperimentScene::kSame, k), picture);
  const v1::ExperimentImageErrors compared = study.compare(wrong_materials(), *pool_, nobody, {});
  EXPECT_EQ(compared.novel_scene(static_cast<int>(k)).dissimilarity(),
            1 - ms_ssim(study.resolution(), study.reference(ExperimentScene::kNovel, k), picture));
  study.render_pictures("wrong", test_.truth, *pool_, {});
  EXPECT_EQ(study.picture("wrong", ExperimentScene::kNovel, k), picture);
}

// Candidates differ by their materials alone, never by the luck of their renders.
TEST_F(ExperimentImagesTest, RendersAllCandidatesWithTheSameRandomNumbers) {
  ExperimentImages study = images("random");
  study.render_references(*pool_, nobody, {});
  EXPECT_EQ(to_text_proto(study.compare(test_.truth, *pool_, nobody, {})),
            to_text_proto(study.compare(test_.truth, *pool_, nobody, {})));
}

TEST_F(ExperimentImagesTest, RendersTheReferencesThatAreMissing) {
  ExperimentImages study = images("again");
  study.render_references(*pool_, nobody, {});
  const std::vector<float> before = study.reference(ExperimentScene::kNovel, 1);
  const std::string file = fmt::format("novel_{:04}.exr", study.chosen()[1]);
  std::filesystem::remove(files_->path("again") + "/" + file);
  expect_error(ErrorKind::kIo, {file}, [&] { study.reference(ExperimentScene::kNovel, 1); });
  std::vector<size_t> done;
  study.render_references(*pool_, [&](size_t now, size_t) { done.push_back(now); }, {});
  EXPECT_THAT(done, ElementsAre(5, 6));
  EXPECT_EQ(study.reference(ExperimentScene::kNovel, 1), before);
}

TEST_F(ExperimentImagesTest, StopsWhenItIsTold) {
  ExperimentImages study = images("stopped");
  std::stop_source stop;
  stop.request_stop();
  expect_error(ErrorKind::kCancelled, {},
               [&] { study.render_references(*pool_, nobody, stop.get_token()); });
}

}  // namespace
}  // namespace itn
