// rerendering_loss_bench: what the image term of an inverse transport network tells it, and what
// that costs. For images of a dataset, and a network's answers to them: signal and noise of the
// term's gradient by samples per pixel, in the coordinates of the network's outputs; and how far it
// points where the distance to the truth points.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "client/dataset/dataset.h"
#include "client/render_pool/render_pool.h"
#include "client/training/augmentation.h"
#include "client/training/evaluation.h"
#include "client/training/loss.h"
#include "client/training/rerendering_loss.h"
#include "client/training/training_set.h"
#include "common/error.h"
#include "common/learning/model_files.h"
#include "common/learning/predictor.h"
#include "common/random.h"

namespace itn {
namespace {

struct Options {
  std::string dataset, model;
  size_t images = 64;
  int repeats = 8;
  std::vector<uint32_t> spp = {2, 4, 16, 64, 256};
};

double dot(const MaterialCoordinates& a, const MaterialCoordinates& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

double cosine(const MaterialCoordinates& a, const MaterialCoordinates& b) {
  return dot(a, b) / std::sqrt(dot(a, a) * dot(b, b));
}

// Over repeated renders with other random numbers.
struct Moments {
  MaterialCoordinates mean{}, variance{};  // of one render
};

Moments moments(const std::vector<MaterialCoordinates>& values) {
  const auto n = static_cast<double>(values.size());
  Moments m;
  for (size_t k = 0; k < 3; ++k) {
    double sum = 0, squares = 0;
    for (const MaterialCoordinates& v : values) sum += v[k];
    m.mean[k] = sum / n;
    for (const MaterialCoordinates& v : values) squares += (v[k] - m.mean[k]) * (v[k] - m.mean[k]);
    m.variance[k] = squares / (n - 1);
  }
  return m;
}

// What a network answers to one image, and what follows from the truth alone.
struct Answer {
  MaterialCoordinates output{}, target{}, regression{};
  bool clamped = false;
};

class Bench {
 public:
  explicit Bench(const Options& options)
      : options_(options),
        dataset_(options.dataset),
        images_(first_images(images_of(dataset_, v1::SPLIT_TRAIN))),
        predictor_(Predictor::load(find_model(options.model))),
        space_(predictor_.model()) {}

  void run() {
    answer();
    fmt::print("{} images, {} renders of each\n", images_.items.size(), options_.repeats);
    fmt::print("clamped answers: {:.1f} %\n\n", 100 * share_clamped());
    fmt::print("{:>5} {:>9}  {:^26}  {:^26}  {:>10}\n", "spp", "CPU ms",
               "signal (first second third)", "noise over signal", "to truth");
    fmt::print("{:>5} {:>9}  {:^26}  {:^26}  {:>10}\n", "", "a render", "", "", "(cosine)");
    for (const uint32_t spp : options_.spp) row(spp);
  }

 private:
  LabelledImages first_images(LabelledImages all) const {
    const size_t count = std::min(options_.images, all.items.size());
    all.items.resize(count);
    all.truth.resize(count);
    return all;
  }

  void answer() {
    const std::vector<MaterialEstimate> estimates =
        estimate_all(predictor_, images_, noise_of_level(predictor_.model().noise()));
    for (size_t i = 0; i < images_.items.size(); ++i) {
      Answer a;
      std::copy_n(estimates[i].outputs.begin(), 3, a.output.begin());
      a.target = space_.standardized(images_.truth[i]);
      for (size_t k = 0; k < 3; ++k) a.regression[k] = 2 * (a.output[k] - a.target[k]);
      const MaterialCoordinates inside = space_.standardized(space_.material(a.output));
      for (size_t k = 0; k < 3; ++k) {
        a.clamped = a.clamped || std::abs(inside[k] - a.output[k]) > 1e-6;
      }
      answers_.push_back(a);
    }
  }

  double share_clamped() const {
    return static_cast<double>(std::ranges::count(answers_, true, &Answer::clamped)) /
           static_cast<double>(answers_.size());
  }

  void row(uint32_t spp) {
    RenderPool pool({});
    const RerenderingEvaluator term = pool_rerendering(
        pool, {.spp = spp, .estimates = spp < 4 ? 2U : 4U, .pilot_spp = spp < 16 ? 0U : 4U});
    MaterialCoordinates signal{}, noise{};
    double to_truth = 0;
    size_t pointed = 0;
    for (size_t i = 0; i < answers_.size(); ++i) {
      const Answer& a = answers_[i];
      const Moments m = moments(gradients(i, term));
      for (size_t k = 0; k < 3; ++k) {
        // The square of a mean has its variance in it.
        signal[k] += m.mean[k] * m.mean[k] - m.variance[k] / options_.repeats;
        noise[k] += m.variance[k];
      }
      if (dot(m.mean, m.mean) > 0) {
        to_truth += cosine(m.mean, a.regression);
        ++pointed;
      }
    }
    const auto n = static_cast<double>(answers_.size());
    const auto root = [&](double sum) { return std::sqrt(std::max(0.0, sum) / n); };
    const double renders = n * options_.repeats;
    fmt::print(
        "{:>5} {:>9.2f}  {:>8.4f} {:>8.4f} {:>8.4f}  {:>8.2f} {:>8.2f} {:>8.2f}  {:>10.3f}\n", spp,
        1e3 * pool.statistics().cpu_seconds / renders, root(signal[0]), root(signal[1]),
        root(signal[2]), root(noise[0]) / root(signal[0]), root(noise[1]) / root(signal[1]),
        root(noise[2]) / root(signal[2]), to_truth / static_cast<double>(pointed));
  }

  // In the outputs, by repeated renders of the answer to one image.
  std::vector<MaterialCoordinates> gradients(size_t i, const RerenderingEvaluator& term) {
    const DatasetImage image = images_.read(i);
    const std::vector<float> weight =
        image_weights(image, images_.resolution, v1::TrainingConfig::WEIGHT_MAP);
    std::vector<RenderQuery> queries;
    for (int r = 0; r < options_.repeats; ++r) {
      queries.push_back({.scene = images_.scene(i),
                         .material = space_.material(answers_[i].output),
                         .seed = derive_seed(1, {i, static_cast<uint64_t>(r)}),
                         .image = image.radiance,
                         .weight = weight});
    }
    std::vector<MaterialCoordinates> result;
    for (const LossWithGradient& loss : term(queries)) {
      result.push_back(space_.output_gradient(
          answers_[i].output, {loss.gradient[0], loss.gradient[1], loss.gradient[2]}));
    }
    return result;
  }

  const Options& options_;
  DatasetReader dataset_;
  LabelledImages images_;
  Predictor predictor_;
  OutputSpace space_;
  std::vector<Answer> answers_;
};

}  // namespace
}  // namespace itn

int main(int argc, char** argv) {
  itn::Options options;
  CLI::App app("What the image term of an inverse transport network tells it, and what it costs");
  app.add_option("dataset", options.dataset, "Dataset (training split)")->required();
  app.add_option("model", options.model, "Network: a run, a checkpoint or a model's name")
      ->required();
  app.add_option("--images", options.images, "First so many of the split")->capture_default_str();
  app.add_option("--repeats", options.repeats, "Renders of each, at least 2")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  app.add_option("--spp", options.spp, "Samples per pixel")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    itn::Bench(options).run();
  } catch (const itn::Error& error) {
    fmt::print(stderr, "rerendering_loss_bench: {}\n", error.what());
    return 1;
  }
  return 0;
}
