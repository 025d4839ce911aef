#include "common/learning/outlier_detector.h"

#include <gmock/gmock.h>

#include <cmath>

#include "common/error.h"
#include "common/learning/checkpoint.h"
#include "common/learning/predict_reply.h"
#include "common/learning/predictor.h"
#include "tests/common/learning/familiar_model.h"
#include "tests/support/expect_error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using testing::expect_error;
using ::testing::HasSubstr;

ImageBatch of_luminance(const ImageBatch& images, const torch::Tensor& luminance) {
  ImageBatch result = images;
  result.luminance = luminance;
  return result;
}

double part_outliers(const std::vector<MaterialEstimate>& estimates) {
  return static_cast<double>(std::ranges::count_if(
             estimates, [](const auto& e) { return e.outlier->is_outlier; })) /
         static_cast<double>(estimates.size());
}

TEST(OutlierModel, IsOfImagesLikeThoseItWasFittedTo) {
  Predictor predictor(model_with_outlier_model());
  const ImageBatch proper = discs(300, 32, 3);
  const std::vector<MaterialEstimate> estimates = predictor.estimate(proper);
  EXPECT_LE(part_outliers(estimates), 0.03);
  double mean_rank = 0;
  for (const MaterialEstimate& e : estimates) {
    EXPECT_EQ(e.outlier->is_outlier, e.outlier->score > 1);
    EXPECT_EQ(e.outlier->reason.empty(), !e.outlier->is_outlier);
    mean_rank += e.outlier->rank / 300;
  }
  EXPECT_NEAR(mean_rank, 0.5, 0.07);  // uniform
  const ImageBatch few = discs(20, 32, 4);
  EXPECT_EQ(part_outliers(predictor.estimate(of_luminance(few, 0 * few.luminance))), 1);
  EXPECT_EQ(part_outliers(predictor.estimate(of_luminance(few, few.mask))), 1);
  EXPECT_EQ(part_outliers(predictor.estimate(
                of_luminance(few, torch::rand(few.luminance.sizes()) * few.mask))),
            1);
}

TEST(OutlierModel, SaysWhatIsUnusual) {
  Predictor predictor(model_with_outlier_model());
  const ImageBatch proper = discs(20, 32, 4);
  for (const MaterialEstimate& e :
       predictor.estimate(of_luminance(proper, 20 * proper.luminance))) {
    EXPECT_TRUE(e.outlier->is_outlier);
    EXPECT_THAT(e.outlier->reason, HasSubstr("mean radiance of the object: "));
    EXPECT_EQ(e.outlier->rank, 1);
  }
}

// Discs with more order than noise: lit from above.
ImageBatch shaded_discs(int64_t count, int64_t side, uint64_t seed) {
  ImageBatch images = discs(count, side, seed);
  images.luminance = images.luminance * torch::linspace(1.6, 0.4, side).view({1, side, 1});
  return images;
}

TEST(OutlierModel, KnowsThatNoiseHasNoOrder) {
  const v1::Model model = model_with_outlier_model(shaded_discs);
  Predictor predictor(model);
  const auto disorder = [&](const ImageBatch& images) {
    const Features features = predictor.features(images);
    return OutlierDetector(model.outlier_model(), features.embedding.size(1))
        .distances(features)
        .disorder;
  };
  const ImageBatch proper = shaded_discs(20, 32, 4);
  EXPECT_LE(disorder(proper).max().item<double>(), 1);
  EXPECT_GT(disorder(shuffled(proper)).min().item<double>(), 1);
}

TEST(OutlierModel, IsPartOfTheReply) {
  Predictor predictor(model_with_outlier_model());
  const ImageBatch proper = discs(1, 32, 4);
  const v1::PredictReply reply = to_reply(
      predictor.estimate(of_luminance(proper, 50 * proper.luminance)), predictor.version());
  ASSERT_EQ(reply.caveats_size(), 1);
  EXPECT_TRUE(reply.caveats(0).outlier().is_outlier());
  EXPECT_GT(reply.caveats(0).outlier().score(), 1);
  EXPECT_NE(reply.caveats(0).outlier().reason(), "");
  // There is nothing to say of a model that has none.
  Predictor without(residual_model());
  EXPECT_FALSE(to_reply(without.estimate(proper), without.version()).caveats(0).has_outlier());
}

TEST(OutlierModel, SurvivesACheckpoint) {
  const testing::TemporaryFolder folder;
  v1::Checkpoint checkpoint;
  *checkpoint.mutable_model() = model_with_outlier_model();
  write_checkpoint(folder.path("model.itn"), checkpoint);
  EXPECT_EQ(read_checkpoint(folder.path("model.itn")).SerializeAsString(),
            checkpoint.SerializeAsString());
}

TEST(OutlierModel, OfAStrangerIsChecked) {
  const v1::Model good = model_with_outlier_model();
  const auto fails = [&](const std::string& message, const auto& spoil) {
    v1::Model bad = good;
    spoil(*bad.mutable_outlier_model());
    expect_error(ErrorKind::kInvalidInput, {"model.outlier_model", message},
                 [&] { Predictor{bad}; });
  };
  fails("embedding: ", [](auto& f) { f.mutable_embedding()->mutable_mean()->set_shape(0, 3); });
  fails("statistics: ", [](auto& f) { f.mutable_statistics()->clear_axes(); });
  fails("positive", [](auto& f) { f.mutable_statistics()->set_threshold(0); });
  fails("positive", [](auto& f) { f.mutable_embedding()->set_rest(NAN); });
  fails("range.lowest", [](auto& f) { f.mutable_range()->clear_lowest(); });
  fails("range.highest", [](auto& f) { f.mutable_range()->set_highest(3, NAN); });
  fails("range.threshold", [](auto& f) { f.mutable_range()->set_threshold(0); });
  fails("encoding", [](auto& f) { f.clear_encoding(); });
  fails("encoding", [](auto& f) { f.set_encoding(2, NAN); });
  fails("disorder", [](auto& f) { f.add_disorder(1); });
  fails("quantiles", [](auto& f) { f.clear_quantiles(); });
  fails("quantiles", [](auto& f) { f.set_quantiles(0, 1e9); });
}

// Either the brightest pixel is kept, or the mean.
TEST(EncodedForScreen, HasTheGammaOfScreens) {
  const ImageBatch images = discs(2, 32, 6);
  const torch::Tensor y = images.luminance, encoded = tone_mapped(images).luminance;
  EXPECT_NEAR(encoded[0].max().item<double>(), y[0].max().item<double>(), 1e-5);
  EXPECT_NEAR(encoded[1].sum().item<double>(), y[1].sum().item<double>(), 1e-2);
  for (int i = 0; i < 2; ++i) {
    const double ratio = (y[i][16][16] / y[i][20][20]).item<double>();
    EXPECT_NEAR((encoded[i][16][16] / encoded[i][20][20]).item<double>(), std::pow(ratio, 1 / 2.2),
                1e-5);
  }
}

TEST(Shuffled, HasTheSamePixelsElsewhere) {
  ImageBatch images = discs(2, 32, 6);
  images.noise = 0.1 * images.luminance;  // so that it tells which pixel moved
  const ImageBatch moved = shuffled(images);
  EXPECT_TRUE(torch::equal(shuffled(images).luminance, moved.luminance));
  EXPECT_TRUE(torch::allclose(moved.noise, 0.1 * moved.luminance));
  EXPECT_TRUE(torch::equal(moved.mask, images.mask));
  for (int i = 0; i < 2; ++i) {
    EXPECT_FALSE(torch::equal(moved.luminance[i], images.luminance[i]));
    EXPECT_TRUE(torch::equal(std::get<0>(moved.luminance[i].flatten().sort()),
                             std::get<0>(images.luminance[i].flatten().sort())));
    EXPECT_EQ((moved.luminance[i] * (1 - images.mask[i])).abs().max().item<double>(), 0);
  }
}

// A model of unknown exposure must not look at it.
TEST(ImageStatistics, AreThoseOfAnImageThatIsKnown) {
  v1::Model model = residual_model();
  const ImageBatch images = discs(8, 32, 5);
  const torch::Tensor known = image_statistics(model, images);
  const torch::Tensor brighter =
      image_statistics(model, of_luminance(images, 10 * images.luminance));
  EXPECT_EQ(known.size(1), kImageStatistics);
  EXPECT_NEAR((brighter - known).select(1, 0).mean().item<double>(), std::log(10), 1e-5);
  model.set_exposure(v1::EXPOSURE_UNKNOWN);
  EXPECT_LT((image_statistics(model, of_luminance(images, 10 * images.luminance)) -
             image_statistics(model, images))
                .abs()
                .max()
                .item<double>(),
            1e-4);
  // The numbers of a white disc: ln of 1, of nothing (as small as it gets), and of the area.
  const torch::Tensor white = image_statistics(model, of_luminance(images, images.mask.clone()))[0];
  EXPECT_NEAR(white[3].item<double>(), 0, 1e-6);
  EXPECT_NEAR(white[9].item<double>(), std::log(0.003), 1e-6);
  EXPECT_NEAR(std::exp(white[12].item<double>()), images.mask[0].mean().item<double>(), 1e-6);
  EXPECT_NEAR(white[13].item<double>(), 0, 1e-6);
  // There are numbers of nothing at all, too.
  EXPECT_TRUE(image_statistics(model, of_luminance(images, 0 * images.luminance))
                  .isfinite()
                  .all()
                  .item<bool>());
}

TEST(OutlierModel, OfSeveralImagesOfOneMaterialIsThatOfTheFarthestOutlier) {
  Predictor predictor(model_with_outlier_model());
  const ImageBatch proper = discs(1, 32, 3);
  const auto seen = [&](size_t i) {
    const double factor = i == 1 ? 50 : 1;
    return NetworkView{.channels = of_luminance(proper, factor * proper.luminance),
                       .object_size = std::nullopt,
                       .warnings = {{}}};
  };
  const Predictor::Outcomes outcomes = predictor.estimate_each(3, seen, true);
  const auto& bright = std::get<std::vector<MaterialEstimate>>(outcomes.each[1])[0];
  EXPECT_TRUE(bright.outlier->is_outlier);
  ASSERT_EQ(outcomes.combined.size(), 1);
  ASSERT_TRUE(outcomes.combined[0].outlier.has_value());
  EXPECT_TRUE(outcomes.combined[0].outlier->is_outlier);
  EXPECT_EQ(outcomes.combined[0].outlier->score, bright.outlier->score);
}

}  // namespace
}  // namespace itn
