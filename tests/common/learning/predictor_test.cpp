#include "common/learning/predictor.h"

#include <cmath>
#include <random>
#include <span>

#include <gmock/gmock.h>
#include <torch/utils.h>

#include "common/error.h"
#include "common/learning/checkpoint.h"
#include "common/learning/predict_reply.h"
#include "tests/common/learning/model_for_tests.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

using testing::expect_error;
using ::testing::HasSubstr;

struct Pixels {
  int width, height, channels;
  std::vector<float> values, mask;
  Photograph photograph() const { return {width, height, channels, values, mask}; }
};

// A disc with a smooth pattern that is the same at every resolution.
Pixels disc(int width, int height, int channels, double centre_x, double centre_y, double radius) {
  Pixels p{width, height, channels, {}, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double u = (x + 0.5 - centre_x) / radius, v = (y + 0.5 - centre_y) / radius;
      p.mask.push_back(u * u + v * v < 1 ? 1.0F : 0.0F);
      for (int c = 0; c < channels; ++c) {
        p.values.push_back(static_cast<float>(1.5 + std::sin(2 * u + c) + 0.3 * std::cos(v)));
      }
    }
  }
  return p;
}

TEST(Predictor, AnswersInsideItsBoundsOneMaterialPerChannel) {
  Predictor predictor(small_model());
  const std::vector<Material> gray = predictor.predict(disc(16, 16, 1, 8, 8, 5.4).photograph());
  ASSERT_EQ(gray.size(), 1);
  EXPECT_NO_THROW(validate(gray[0]));
  EXPECT_EQ(predictor.predict(disc(16, 16, 3, 8, 8, 5.4).photograph()).size(), 3);
}

TEST(Predictor, OfADistributionAnswersItsMeanAndItsIntervals) {
  Predictor predictor(residual_model());
  const Pixels colour = disc(32, 32, 3, 16, 16, 10.8);
  const std::vector<MaterialEstimate> estimates = predictor.estimate(colour.photograph());
  ASSERT_EQ(estimates.size(), 3);
  const v1::PredictReply reply = to_reply(estimates, predictor.version());
  ASSERT_EQ(reply.materials_size(), 3);
  ASSERT_EQ(reply.posteriors_size(), 3);
  for (int i = 0; i < 3; ++i) {
    const v1::MaterialPosterior& p = reply.posteriors(i);
    EXPECT_EQ(reply.materials(i).sigma_t(), p.sigma_t().mean());
    for (const v1::ParameterPosterior* parameter :
         {&p.sigma_t(), &p.albedo(), &p.g(), &p.sigma_a(), &p.sigma_s(), &p.sigma_s_reduced()}) {
      EXPECT_LT(parameter->low(), parameter->mean());
      EXPECT_LT(parameter->mean(), parameter->high());
      EXPECT_GT(parameter->standard_deviation(), 0);
    }
    EXPECT_EQ(p.correlations_size(), 3);
    EXPECT_EQ(p.scattering_correlations_size(), 3);
  }
  Predictor point(small_model());
  EXPECT_EQ(to_reply(point.estimate(colour.photograph()), point.version()).posteriors_size(), 0);
}

TEST(Predictor, OfUnknownExposureDoesNotSeeIt) {
  const Pixels image = disc(32, 32, 1, 16, 16, 10.8);
  Pixels bright = image;
  for (float& y : bright.values) y *= 10;
  Predictor unknown(residual_model(32, v1::EXPOSURE_UNKNOWN)), known(residual_model(32));
  EXPECT_NEAR(unknown.predict(bright.photograph())[0].sigma_t,
              unknown.predict(image.photograph())[0].sigma_t, 1e-2);
  EXPECT_GT(std::abs(known.predict(bright.photograph())[0].sigma_t -
                     known.predict(image.photograph())[0].sigma_t),
            0.1);
}

// Photographs are quieter than what a network learned from, and it knows nothing of such images.
TEST(Predictor, BringsQuietImagesUpToTheNoiseOfTraining) {
  v1::Model model = residual_model(32);
  Predictor without(model);
  model.set_noise(0.12);
  Predictor with(model);
  ImageBatch image = with.seen(disc(32, 32, 1, 16, 16, 10.8).photograph()).channels;
  const auto sigma_t = [&](Predictor& predictor) {
    return predictor.estimate(image)[0].material.sigma_t;
  };
  const double quiet = sigma_t(with);
  EXPECT_NE(quiet, sigma_t(without));
  EXPECT_EQ(quiet, sigma_t(with)) << "an image has one answer";
  image.noise = torch::full_like(image.luminance, 0.05);
  EXPECT_NE(sigma_t(with), quiet);
  EXPECT_NE(sigma_t(with), sigma_t(without));
  image.noise = torch::full_like(image.luminance, 0.12);
  EXPECT_EQ(sigma_t(with), sigma_t(without)) << "noisy enough";
}

TEST(Predictor, OfAModelThatKnowsMirrorImagesAnswersAnImageAndItsMirrorImageAlike) {
  v1::Model model = residual_model(32);
  Predictor one_way(model);
  model.set_mirrored(true);
  Predictor both_ways(model);
  const ImageBatch image = both_ways.seen(disc(32, 32, 1, 16, 16, 10.8).photograph()).channels;
  const auto outputs = [](Predictor& predictor, const ImageBatch& of) {
    return predictor.estimate(of)[0].outputs;
  };
  const std::vector<double> a = outputs(both_ways, image), b = outputs(both_ways, mirrored(image));
  const std::vector<double> left = outputs(one_way, image),
                            right = outputs(one_way, mirrored(image));
  for (size_t k = 0; k < a.size(); ++k) {
    EXPECT_NEAR(a[k], b[k], 1e-5);
    EXPECT_NEAR(a[k], (left[k] + right[k]) / 2, 1e-5);
  }
  EXPECT_GT(std::abs(left[0] - right[0]), 1e-3) << "or this tests nothing";
}

// Wider answers about the same centre.
TEST(Predictor, CorrectsItsWidths) {
  v1::Model model = residual_model(32);
  Predictor before(model);
  for (int k = 0; k < 3; ++k) {
    model.mutable_calibration()->add_offset(-std::log(2.0));
    model.mutable_calibration()->add_slope(0);
  }
  Predictor after(model);
  const Pixels image = disc(32, 32, 1, 16, 16, 10.8);
  const MaterialEstimate narrow = before.estimate(image.photograph())[0];
  const MaterialEstimate wide = after.estimate(image.photograph())[0];
  EXPECT_EQ(narrow.outputs[0], wide.outputs[0]);
  EXPECT_NEAR(wide.outputs[3], narrow.outputs[3] - std::log(2.0), 1e-12);
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_GT(wide.posterior->material.parameters[k].standard_deviation,
              narrow.posterior->material.parameters[k].standard_deviation);
  }
  v1::Model damaged = model;
  damaged.mutable_calibration()->clear_slope();
  expect_error(ErrorKind::kInvalidInput, {"widths"}, [&] { Predictor{damaged}; });
  v1::Model point = small_model();
  *point.mutable_calibration() = model.calibration();
  expect_error(ErrorKind::kInvalidInput, {"widths"}, [&] { Predictor{point}; });
}

// The density is that of standardised coordinates: it falls away from the centre.
TEST(Predictor, GivesTheTruthALikelihood) {
  Predictor predictor(residual_model());
  const MaterialEstimate estimate =
      predictor.estimate(disc(32, 32, 1, 16, 16, 10.8).photograph())[0];
  const OutputSpace space(residual_model());
  const std::vector<double>& o = estimate.outputs;
  const auto likelihood = [&](const MaterialCoordinates& at) {
    const Material truth = space.material(at);
    return predictor.log_likelihood(estimate, std::span(&truth, 1));
  };
  EXPECT_GT(likelihood({o[0], o[1], o[2]}), likelihood({o[0] + 0.5, o[1], o[2]}));
}

TEST(Predictor, TakesEachChannelByItself) {
  Predictor predictor(small_model());
  const Pixels colour = disc(16, 16, 3, 8, 8, 5.4);
  const std::vector<Material> all = predictor.predict(colour.photograph());
  for (size_t c = 0; c < 3; ++c) {
    Pixels one{16, 16, 1, {}, colour.mask};
    for (size_t i = c; i < colour.values.size(); i += 3) one.values.push_back(colour.values[i]);
    const Material alone = predictor.predict(one.photograph())[0];
    EXPECT_NEAR(alone.sigma_t, all[c].sigma_t, 1e-3);
    EXPECT_NEAR(alone.albedo, all[c].albedo, 1e-5);
  }
}

TEST(Predictor, AveragesALargerImageDown) {
  Predictor predictor(small_model());
  const Pixels small = disc(16, 16, 1, 8, 8, 5.4);
  // Each pixel four times.
  Pixels large{32, 32, 1, {}, {}};
  for (int y = 0; y < 32; ++y) {
    for (int x = 0; x < 32; ++x) {
      large.values.push_back(small.values[(y / 2) * 16 + x / 2]);
      large.mask.push_back(small.mask[(y / 2) * 16 + x / 2]);
    }
  }
  EXPECT_NEAR(predictor.predict(large.photograph())[0].sigma_t,
              predictor.predict(small.photograph())[0].sigma_t, 1e-3);
}

TEST(Predictor, DoesNotDependOnWhereInAWideImageTheObjectIs) {
  Predictor predictor(small_model());
  const double a = predictor.predict(disc(96, 64, 1, 40, 32, 16).photograph())[0].sigma_t;
  const double b = predictor.predict(disc(96, 64, 1, 70, 20, 16).photograph())[0].sigma_t;
  EXPECT_NEAR(a, b, 1e-3);
  // At the border of the image too, where the cut-out reaches beyond it.
  const double c = predictor.predict(disc(96, 64, 1, 76, 44, 16).photograph())[0].sigma_t;
  EXPECT_NEAR(a, c, 1e-3);
}

// So that a client may frame a photograph that is too large to be sent.
TEST(Predictor, AnswersTheSameForAPhotographThatIsFramed) {
  for (const uint32_t resolution : {16U, 64U}) {
    Predictor predictor(small_model(v1::SIMILARITY, static_cast<int>(resolution)));
    for (const Pixels& p : {disc(900, 700, 3, 400, 300, 150),  // framed by 444 pixels, reduced
                            disc(900, 700, 1, 850, 300, 150),  // at the border
                            disc(96, 64, 1, 40, 32, 16), disc(600, 600, 1, 300, 300, 200)}) {
      const std::vector<Material> whole = predictor.predict(p.photograph());
      const std::vector<Material> sent = predictor.predict(framed(p.photograph()).view());
      ASSERT_EQ(sent.size(), whole.size());
      for (size_t c = 0; c < whole.size(); ++c) {
        EXPECT_EQ(sent[c].sigma_t, whole[c].sigma_t);
        EXPECT_EQ(sent[c].albedo, whole[c].albedo);
        EXPECT_EQ(sent[c].g, whole[c].g);
      }
    }
  }
}

TEST(Predictor, CanBeCancelled) {
  Predictor predictor(small_model());
  std::stop_source stop;
  stop.request_stop();
  try {
    predictor.predict(disc(16, 16, 1, 8, 8, 5.4).photograph(), stop.get_token());
    FAIL() << "predicted";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kCancelled);
  }
}

TEST(Predictor, SaysWhatIsWrongWithAnImage) {
  Predictor predictor(small_model());
  const Pixels good = disc(16, 16, 1, 8, 8, 5.4);
  struct Row {
    const char* message;
    std::function<void(Pixels&)> spoil;
  };
  const Row rows[] = {
      {"image is nan at pixel (3, 2)", [](Pixels& p) { p.values[2 * 16 + 3] = NAN; }},
      {"image is inf at pixel", [](Pixels& p) { p.values[0] = INFINITY; }},
      {"image is -1 at pixel (0, 0)", [](Pixels& p) { p.values[0] = -1; }},
      {"mask is 2 at pixel (1, 0)", [](Pixels& p) { p.mask[1] = 2; }},
      {"mask is empty", [](Pixels& p) { p.mask.assign(p.mask.size(), 0); }},
      {"mask has 5 values", [](Pixels& p) { p.mask.resize(5); }},
      {"image has 255 values", [](Pixels& p) { p.values.pop_back(); }},
      {"has 2 channels", [](Pixels& p) { p.channels = 2; }},
      {"0 x 16 pixels", [](Pixels& p) { p.width = 0; }},
      {"16 x 100000 pixels", [](Pixels& p) { p.height = 100000; }},
  };
  for (const Row& row : rows) {
    Pixels bad = good;
    row.spoil(bad);
    try {
      predictor.predict(bad.photograph());
      ADD_FAILURE() << row.message;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInvalidInput);
      EXPECT_THAT(error.what(), HasSubstr(row.message));
    }
  }
}

TEST(Predictor, NamesItselfByModelVersionAndStep) {
  v1::Model model = small_model();
  model.set_step(12);
  EXPECT_EQ(Predictor(model).name(), "test, step 12");  // as of files of before there were versions
  model.set_version("1.2.0");
  const Predictor predictor(model);
  EXPECT_EQ(predictor.name(), "test 1.2.0, step 12");
  const v1::PredictReply reply = to_reply(std::vector<MaterialEstimate>(), predictor.version());
  EXPECT_EQ(reply.model(), "test 1.2.0, step 12");
  EXPECT_EQ(reply.model_version().name(), "test");
  EXPECT_EQ(reply.model_version().version(), "1.2.0");
  EXPECT_EQ(reply.model_version().step(), 12);
  EXPECT_EQ(reply.model_version().sha256(), weights_sha256(model));
  EXPECT_EQ(reply.model_version().sha256().size(), 64);
}

TEST(Predictor, RefusesAVersionThatCouldSteerATerminal) {
  v1::Model model = small_model();
  model.set_version("1\x1b[2J");
  expect_error(ErrorKind::kInvalidInput, {"model.version must be"}, [&] { Predictor{model}; });
}

// --- Many ---

TEST(Predictor, OfManyLosesNoneForOneThatIsBad) {
  Predictor predictor(residual_model());
  std::vector<Pixels> images;
  for (int i = 0; i < 150; ++i) {  // more than go through the network together
    images.push_back(disc(32, 32, i % 3 == 0 ? 3 : 1, 16, 16, 9.0 + 0.01 * i));
  }
  images[70].values[5] = -1;
  images[149].mask.clear();
  const auto seen = [&](size_t i) { return predictor.seen(images[i].photograph()); };
  const std::vector<Predictor::Outcome> outcomes =
      predictor.estimate_each(images.size(), seen, false).each;
  ASSERT_EQ(outcomes.size(), images.size());
  for (size_t i = 0; i < images.size(); ++i) {
    if (i == 70 || i == 149) {
      EXPECT_EQ(std::get<Error>(outcomes[i]).kind(), ErrorKind::kInvalidInput);
      continue;
    }
    const std::vector<Material> alone = predictor.predict(images[i].photograph());
    const auto& together = std::get<std::vector<MaterialEstimate>>(outcomes[i]);
    ASSERT_EQ(together.size(), alone.size());
    for (size_t c = 0; c < alone.size(); ++c) {
      EXPECT_NEAR(together[c].material.sigma_t, alone[c].sigma_t, 1e-2);
      EXPECT_NEAR(together[c].material.albedo, alone[c].albedo, 1e-5);
    }
  }
  EXPECT_THAT(std::get<Error>(outcomes[70]).what(), HasSubstr("image is -1"));
}

TEST(Predictor, OfManyStopsBeforeTheNext) {
  Predictor predictor(small_model());
  std::stop_source stop;
  size_t seen = 0;
  const Pixels image = disc(16, 16, 1, 8, 8, 5.4);
  expect_error(ErrorKind::kCancelled, {"cancelled"}, [&] {
    predictor.estimate_each(
        100,
        [&](size_t i) {
          ++seen;
          if (i == 2) stop.request_stop();
          return predictor.seen(image.photograph());
        },
        false, stop.get_token());
  });
  EXPECT_EQ(seen, 3);
}

// --- What is known besides ---

TEST(Predictor, AnswersPerMmOfAnObjectWhoseSizeIsKnown) {
  Predictor predictor(residual_model());
  const Pixels image = disc(32, 32, 1, 16, 16, 10.8);
  v1::Capture capture;
  capture.set_object_size(50);
  const MaterialEstimate relative = predictor.estimate(image.photograph())[0];
  const MaterialEstimate per_mm = predictor.estimate(image.photograph(), capture)[0];
  EXPECT_DOUBLE_EQ(per_mm.material.sigma_t, relative.material.sigma_t / 50);
  EXPECT_EQ(per_mm.material.albedo, relative.material.albedo);
  EXPECT_EQ(per_mm.material.g, relative.material.g);
  const auto &a = per_mm.posterior->scattering.parameters[2],
             &b = relative.posterior->scattering.parameters[2];
  for (const auto member :
       {&ParameterPosterior::mean, &ParameterPosterior::standard_deviation,
        &ParameterPosterior::median, &ParameterPosterior::low, &ParameterPosterior::high}) {
    EXPECT_DOUBLE_EQ(a.*member, b.*member / 50);
  }
  EXPECT_DOUBLE_EQ(per_mm.posterior->diffusion_length.high,
                   relative.posterior->diffusion_length.high * 50);
  EXPECT_EQ(per_mm.posterior->diffuse_albedo.high, relative.posterior->diffuse_albedo.high);
  EXPECT_EQ(per_mm.posterior->material.parameters[1].low,
            relative.posterior->material.parameters[1].low);
  EXPECT_EQ(relative.warnings.size(), per_mm.warnings.size() + 1) << "its size is unknown";
}

// A card makes the exposure of no account.
TEST(Predictor, TakesTheScaleOfRadianceFromAWhiteCard) {
  v1::Model model = residual_model();
  model.set_irradiance(100);
  Predictor predictor(model);
  const auto outputs = [&](double exposure) {
    Pixels image = disc(32, 32, 3, 16, 16, 10.8);
    for (float& value : image.values) value *= static_cast<float>(exposure);
    v1::Capture capture;
    for (const double white : {0.4, 0.5, 0.6}) capture.add_white(white * exposure);
    return predictor.estimate(image.photograph(), capture)[2].outputs;
  };
  const std::vector<double> dark = outputs(0.01), bright = outputs(30);
  for (size_t k = 0; k < dark.size(); ++k) EXPECT_NEAR(dark[k], bright[k], 1e-5);
}

TEST(Predictor, CombinesImagesOfOneMaterial) {
  Predictor predictor(residual_model());
  std::vector<Pixels> images;
  for (const double radius : {9.0, 10.0, 10.8}) images.push_back(disc(32, 32, 3, 16, 16, radius));
  images[1].values[0] = -1;  // cannot be used
  const auto seen = [&](size_t i) { return predictor.seen(images[i].photograph()); };
  const Predictor::Outcomes outcomes = predictor.estimate_each(3, seen, true);
  ASSERT_EQ(outcomes.combined.size(), 3);
  const Combination combination(predictor.model());
  const auto answer = [&](size_t image, size_t channel) {
    ImageAnswer result;
    const auto& estimates = std::get<std::vector<MaterialEstimate>>(outcomes.each[image]);
    result.outputs = estimates[channel].outputs;
    return result;
  };
  for (size_t channel = 0; channel < 3; ++channel) {
    const auto expected =
        combination(std::vector<ImageAnswer>{answer(0, channel), answer(2, channel)});
    for (size_t k = 0; k < expected.size(); ++k) {
      EXPECT_DOUBLE_EQ(outcomes.combined[channel].outputs[k], expected[k]);
    }
  }
  EXPECT_EQ(to_reply(outcomes, predictor.version()).combined().materials_size(), 3);
  EXPECT_TRUE(predictor.estimate_each(3, seen, false).combined.empty());
  images[2] = disc(32, 32, 1, 16, 16, 10.8);
  expect_error(ErrorKind::kInvalidInput, {"must have the same channels"},
               [&] { predictor.estimate_each(3, seen, true); });
  images[1] = images[2] = images[0];
  const auto of_two_sizes = [&](size_t i) {
    v1::Capture capture;
    if (i == 1) capture.set_object_size(50);
    return predictor.seen(images[i].photograph(), capture);
  };
  expect_error(ErrorKind::kInvalidInput, {"object_size must be known of all or of none"},
               [&] { predictor.estimate_each(3, of_two_sizes, true); });
}

// --- Batches ---

// Bit for bit, in batches that fill the network's and in those that do not, by sums that torch
// splits over threads (256 x 256) and that it does not.
TEST(Predictor, AnswersAnImageAloneAsAmongOthers) {
  torch::set_num_threads(2);
  const auto mirrored = [](v1::Model model) {
    model.set_mirrored(true);
    return model;
  };
  const std::vector<v1::Model> models{small_model(), mirrored(small_model(v1::UNBOUNDED, 64)),
                                      residual_model(), mirrored(residual_model()),
                                      residual_model(256)};
  for (const v1::Model& model : models) {
    const Predictor predictor(model);
    const int side = static_cast<int>(model.resolution());
    constexpr int kImages = 17;
    std::vector<ImageBatch> images;
    for (int i = 0; i < kImages; ++i) {
      Pixels p = disc(side, side, 1, 0.5 * side, 0.5 * side, side * (0.25 + 0.01 * i));
      for (float& m : p.mask) m *= 0.7F;  // sums of ones are exact in any order
      images.push_back(resampled(side, p.values, p.mask, side, model.input()));
    }
    for (const size_t count : {2, 3, kImages}) {
      const std::vector<MaterialEstimate> together =
          predictor.estimate(concatenated(std::span(images).first(count)));
      for (size_t i = 0; i < count; ++i) {
        EXPECT_EQ(together[i].outputs, predictor.estimate(images[i]).front().outputs)
            << model.resolution() << ", " << i << " of " << count;
      }
    }
  }
  torch::set_num_threads(1);
}

// --- Bounds ---

TEST(Predictor, SaysWhereItReachesTheEndOfWhatItCanAnswer) {
  const Pixels image = disc(16, 16, 1, 8, 8, 5.4);
  v1::Model model = small_model();
  const Material guess = Predictor(model).predict(image.photograph())[0];
  EXPECT_TRUE(Predictor(model).estimate(image.photograph())[0].at_bounds.empty());
  model.mutable_bounds()->mutable_sigma_t()->set_min(guess.sigma_t);
  model.mutable_bounds()->mutable_albedo()->set_max(guess.albedo);
  EXPECT_THAT(Predictor(model).estimate(image.photograph())[0].at_bounds,
              ::testing::ElementsAre(v1::SIGMA_T_MIN, v1::ALBEDO_MAX));
}

// Of a range over four decades the lowest hundredth has nearly all materials.
TEST(Predictor, MeasuresHowNearTheEndSigmaTIsByItsLogarithm) {
  const Pixels image = disc(16, 16, 1, 8, 8, 5.4);
  v1::Model model = small_model();
  const Material guess = Predictor(model).predict(image.photograph())[0];
  model.mutable_bounds()->mutable_sigma_t()->set_min(guess.sigma_t / 2);
  model.mutable_bounds()->mutable_sigma_t()->set_max(guess.sigma_t * 5000);
  EXPECT_TRUE(Predictor(model).estimate(image.photograph())[0].at_bounds.empty());
}

// It is the interval that counts of a distribution.
TEST(Predictor, SaysWhichIntervalsReachTheEndOfWhatItCanAnswer) {
  const Pixels image = disc(32, 32, 1, 16, 16, 10.8);
  v1::Model model = residual_model();
  const MaterialEstimate before = Predictor(model).estimate(image.photograph())[0];
  const auto& sigma_t = before.posterior->material.parameters[0];
  model.mutable_bounds()->mutable_sigma_t()->set_max(0.5 * (sigma_t.mean + sigma_t.high));
  const MaterialEstimate after = Predictor(model).estimate(image.photograph())[0];
  EXPECT_LT(after.material.sigma_t, 0.99 * model.bounds().sigma_t().max());
  EXPECT_THAT(after.at_bounds, ::testing::Contains(v1::SIGMA_T_MAX));
  const v1::PredictReply reply = to_reply(std::vector{after}, {});
  EXPECT_THAT(reply.caveats(0).at_bounds(), ::testing::Contains(v1::SIGMA_T_MAX));
}

// --- In colour ---

TEST(ColourPredictor, AnswersAboutAllColoursTogether) {
  const Predictor predictor(residual_model(32, v1::EXPOSURE_UNKNOWN, 3));
  const Pixels photograph = disc(60, 50, 3, 25, 24, 18);
  const std::vector<MaterialEstimate> estimates = predictor.estimate(photograph.photograph());
  ASSERT_EQ(estimates.size(), 3);
  for (const MaterialEstimate& estimate : estimates) {
    EXPECT_NO_THROW(validate(estimate.material));
    EXPECT_EQ(estimate.outputs, estimates[0].outputs);
    EXPECT_EQ(estimate.outputs.size(), gaussian_outputs(7));
    EXPECT_EQ(estimate.posterior->material.parameters[2].mean,
              estimates[0].posterior->material.parameters[2].mean);
  }
  EXPECT_NE(estimates[0].material.sigma_t, estimates[2].material.sigma_t);
  // Another exposure changes nothing, another colour all.
  Pixels brighter = photograph, bluer = photograph;
  for (float& value : brighter.values) value *= 4;
  for (size_t p = 2; p < bluer.values.size(); p += 3) bluer.values[p] *= 2;
  const auto red_of = [&](const Pixels& pixels) {
    return predictor.estimate(pixels.photograph())[0].material.sigma_t;
  };
  EXPECT_NEAR(red_of(brighter), estimates[0].material.sigma_t,
              1e-3 * estimates[0].material.sigma_t);
  EXPECT_GT(std::abs(red_of(bluer) / estimates[0].material.sigma_t - 1), 1e-3);
  expect_error(ErrorKind::kInvalidInput, {"in colour", "one channel"},
               [&] { predictor.estimate(disc(32, 32, 1, 16, 16, 10.8).photograph()); });
}

TEST(ColourPredictor, AnswersToSeveralAsToEach) {
  const Predictor predictor(residual_model(32, v1::EXPOSURE_UNKNOWN, 3));
  const std::vector<Pixels> photographs{disc(60, 50, 3, 25, 24, 18), disc(40, 40, 3, 20, 20, 12),
                                        disc(32, 32, 1, 16, 16, 10.8)};
  const auto outcomes = predictor.estimate_each(
      photographs.size(), [&](size_t i) { return predictor.seen(photographs[i].photograph()); },
      false);
  for (size_t i = 0; i < 2; ++i) {
    const auto& together = std::get<std::vector<MaterialEstimate>>(outcomes.each[i]);
    ASSERT_EQ(together.size(), 3);
    EXPECT_EQ(together[1].outputs, predictor.estimate(photographs[i].photograph())[1].outputs);
  }
  EXPECT_TRUE(std::holds_alternative<Error>(outcomes.each[2]));
}

TEST(ColourPredictor, CombinesImagesOfOneMaterial) {
  v1::Model model = residual_model(32, v1::EXPOSURE_UNKNOWN, 3);
  for (int k = 0; k < 49; ++k) model.add_correlation(k % 8 == 0 ? 1 : 0);
  const Predictor predictor(model);
  const std::vector<Pixels> photographs{disc(60, 50, 3, 25, 24, 18), disc(40, 40, 3, 20, 20, 12)};
  const auto outcomes = predictor.estimate_each(
      2, [&](size_t i) { return predictor.seen(photographs[i].photograph()); }, true);
  ASSERT_EQ(outcomes.combined.size(), 3);
  std::vector<ImageAnswer> answers;
  for (size_t i = 0; i < 2; ++i) {
    const auto& estimates = std::get<std::vector<MaterialEstimate>>(outcomes.each[i]);
    answers.push_back({estimates[0].outputs, 1});
  }
  for (const MaterialEstimate& channel : outcomes.combined) {
    EXPECT_EQ(channel.outputs, Combination(model)(answers));
    EXPECT_EQ(channel.material.g, outcomes.combined[0].material.g);
  }
  EXPECT_NE(outcomes.combined[0].material.sigma_t, outcomes.combined[2].material.sigma_t);
}

// A white card tells the colour of the light, though not how bright it was to the camera.
TEST(ColourPredictor, TakesTheLightsColourFromACard) {
  const Predictor predictor(residual_model(32, v1::EXPOSURE_UNKNOWN, 3));
  const Pixels photograph = disc(32, 32, 3, 16, 16, 10.8);
  Pixels tinted = photograph;
  for (size_t p = 0; p < tinted.values.size(); p += 3) tinted.values[p] *= 3;
  v1::Capture card;
  for (const double white : {3.0, 1.0, 1.0}) card.add_white(white);
  const auto outputs = [&](const Pixels& pixels, const v1::Capture& capture) {
    return predictor.estimate(pixels.photograph(), capture)[0].outputs;
  };
  const std::vector<double> expected = outputs(photograph, {});
  const std::vector<double> corrected = outputs(tinted, card), misled = outputs(tinted, {});
  for (size_t k = 0; k < expected.size(); ++k) EXPECT_NEAR(corrected[k], expected[k], 1e-3);
  EXPECT_GT(std::abs(misled[0] - expected[0]), 1e-2);
}

}  // namespace
}  // namespace itn
