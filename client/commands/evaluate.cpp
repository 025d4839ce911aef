// itn evaluate: errors of trained networks on a split, beside the constant predictor.
#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/picture.h"
#include "client/training/evaluation.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/flags.h"
#include "common/progress.h"

namespace itn {
namespace {

struct EvaluateOptions {
  std::vector<std::string> checkpoints;
  std::string dataset;
  std::string split = "test";
  uint32_t rerender = 0;
  uint32_t spp = 256;
  std::string picture;
  uint32_t picture_items = 2;
  WorkerFlags workers;
  bool json = false;
};

// One row of the table before it is a number: what was predicted for each image.
struct Candidate {
  std::string name;
  std::string checkpoint;
  std::vector<Material> predictions;
};

std::vector<Candidate> candidates_of(const EvaluateOptions& options, const LabelledImages& images) {
  std::vector<Candidate> candidates;
  for (const std::string& checkpoint : options.checkpoints) {
    Predictor predictor = Predictor::load(checkpoint);
    candidates.push_back(
        {predictor.name(), checkpoint, predict_all(predictor, images, interruption())});
  }
  candidates.push_back({"constant predictor", "", constant_predictions(images)});
  return candidates;
}

// Renders some of the images again with every candidate's predictions.
void add_image_errors(const EvaluateOptions& options, const LabelledImages& images,
                      const std::vector<Candidate>& candidates, DatasetReader& dataset,
                      RenderPool& pool, v1::Evaluation& evaluation) {
  const std::vector<size_t> chosen = spread(options.rerender, images.items.size());
  Progress progress("rerender", "images", chosen.size() * candidates.size());
  uint64_t done = 0;
  for (size_t c = 0; c < candidates.size(); ++c) {
    double sum = 0;
    for (const size_t i : chosen) {
      const std::vector<float> rendered =
          rerender(dataset, pool, *images.items[i], candidates[c].predictions[i], options.spp,
                   interruption());
      const DatasetImage image = images.read(i);
      sum += relative_image_error(image.radiance, rendered, image.mask);
      progress.update(++done);
    }
    evaluation.mutable_rows(static_cast<int>(c))
        ->set_image(sum / static_cast<double>(chosen.size()));
  }
  progress.finish();
  evaluation.set_rerendered(static_cast<uint32_t>(chosen.size()));
}

// Of the first checkpoint.
void write_picture(const EvaluateOptions& options, const LabelledImages& images,
                   const Candidate& candidate, DatasetReader& dataset, RenderPool& pool) {
  std::vector<Comparison> rows;
  for (const size_t i : spread(options.picture_items, images.items.size())) {
    rows.push_back(
        {images.read(i).radiance, rerender(dataset, pool, *images.items[i],
                                           candidate.predictions[i], options.spp, interruption())});
  }
  write_comparison(options.picture, images.resolution, rows);
}

void print(const v1::Evaluation& evaluation) {
  print_result("RMSE over {} {} images{}\n", evaluation.items(), evaluation.split(),
               evaluation.rerendered() > 0
                   ? fmt::format("; relative image error over {} of them", evaluation.rerendered())
                   : "");
  size_t width = 0;
  for (const v1::Evaluation::Row& row : evaluation.rows()) {
    width = std::max(width, row.name().size());
  }
  print_result("{:{}}  {:>14}  {:>7}  {:>7}{}\n", "", width, "sigma_t [1/mm]", "albedo", "g",
               evaluation.rerendered() > 0 ? "    image" : "");
  for (const v1::Evaluation::Row& row : evaluation.rows()) {
    print_result("{:{}}  {:14.2f}  {:7.4f}  {:7.4f}", row.name(), width, row.sigma_t(),
                 row.albedo(), row.g());
    if (row.has_image()) {
      print_result("  {:7.4f}", row.image());
    }
    print_result("\n");
  }
  print_result(
      "The constant predictor answers the mean of these images' own truth: no constant does "
      "better.\n");
}

void run(const EvaluateOptions& options) {
  if (!options.picture.empty()) {
    check_writable(options.picture);
  }
  set_torch_threads(static_cast<int>(std::max(1U, std::thread::hardware_concurrency())));
  DatasetReader dataset(options.dataset);
  const v1::Split split = options.split == "train" ? v1::SPLIT_TRAIN : v1::SPLIT_TEST;
  const LabelledImages images = images_of(dataset, split);
  const std::vector<Candidate> candidates = candidates_of(options, images);
  v1::Evaluation evaluation;
  evaluation.set_split(options.split);
  evaluation.set_items(static_cast<uint32_t>(images.items.size()));
  for (const Candidate& candidate : candidates) {
    v1::Evaluation::Row& row = *evaluation.add_rows();
    row.set_name(candidate.name);
    row.set_checkpoint(candidate.checkpoint);
    set_errors(candidate.predictions, images, row);
  }
  std::optional<RenderPool> pool;
  if (options.rerender > 0 || !options.picture.empty()) {
    pool.emplace(options.workers.pool_options());
  }
  if (options.rerender > 0) {
    add_image_errors(options, images, candidates, dataset, *pool, evaluation);
  }
  options.json ? print_result("{}\n", to_json(evaluation)) : print(evaluation);
  if (!options.picture.empty()) {
    std::fflush(stdout);  // the table is there whatever becomes of the picture
    write_picture(options, images, candidates.front(), dataset, *pool);
  }
}

}  // namespace

void add_evaluate_command(CLI::App& app) {
  const auto options = std::make_shared<EvaluateOptions>();
  CLI::App* command = app.add_subcommand(
      "evaluate", "Errors of trained networks on a dataset, beside the constant predictor");
  command->add_option("checkpoints", options->checkpoints, "Checkpoints, or folders of runs")
      ->required();
  command->add_option("--dataset", options->dataset, "Folder that itn dataset wrote")->required();
  command->add_option("--split", options->split, "Images to evaluate on")
      ->check(one_of({"test", "train"}))
      ->capture_default_str();
  command
      ->add_option("--rerender", options->rerender,
                   "Images to render again with every prediction, for the image error")
      ->check(number_in(0U, UINT32_MAX))
      ->capture_default_str();
  command->add_option("--spp", options->spp, "Samples per pixel of these renders")
      ->check(kSppRange)
      ->capture_default_str();
  command->add_option("--picture", options->picture,
                      "PNG to write: input, re-rendering by the first checkpoint, difference");
  command->add_option("--picture-items", options->picture_items, "Rows of the picture")
      ->check(number_in(1U, 100U))
      ->capture_default_str();
  command->add_flag("--json", options->json, "Print the result as JSON (itn.v1.Evaluation)");
  add_worker_flags(*command, options->workers);
  command->callback([options] { run(*options); });
}

}  // namespace itn
