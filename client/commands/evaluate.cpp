// itn evaluate: errors of trained networks on a split, beside the constant predictor.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/commands/evaluate.h"
#include "client/image/preview.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/panels.h"
#include "client/progress.h"
#include "client/training/augmentation.h"
#include "client/training/evaluation.h"
#include "client/training/shifts.h"
#include "client/training/similarity_predictor.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/learning/model_files.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

constexpr const char* kSimilarityPredictor = "similarity predictor";

// One row of the table, of a network at one level of noise or of a baseline, and its answers.
struct EvaluatedRow {
  v1::Evaluation::Row row;
  std::vector<Material> predictions;
  std::vector<MaterialEstimate> estimates;  // empty for a baseline
};

// What the images of a row of the table are like; the first are as they are.
std::vector<Shift> conditions(const EvaluateOptions& options, const v1::Model& model) {
  std::vector<Shift> all(1);
  if (options.noise_levels && model.noise() > 0) {
    for (const double level : {model.noise(), model.noise() / 2}) {
      all.push_back(
          {.name = fmt::format("noise {:.2g} %", 100 * level), .change = noise_of_level(level)});
    }
  }
  if (options.shifts) all.insert(all.end(), shifts().begin(), shifts().end());
  return all;
}

// The candidate who has not looked at the images.
EvaluatedRow baseline(const std::string& name, std::vector<Material> predictions,
                      const LabelledImages& images) {
  EvaluatedRow candidate;
  candidate.row.set_name(name);
  candidate.predictions = std::move(predictions);
  set_errors(candidate.predictions, images, candidate.row);
  return candidate;
}

EvaluatedRow network_row(const std::string& name, const std::string& checkpoint, double noise,
                         const Predictor& predictor, std::vector<MaterialEstimate> estimates,
                         const LabelledImages& images) {
  EvaluatedRow candidate;
  candidate.row.set_name(name);
  candidate.row.set_checkpoint(checkpoint);
  candidate.row.set_noise(noise);
  for (const MaterialEstimate& estimate : estimates) {
    candidate.predictions.push_back(estimate.material);
  }
  set_errors(candidate.predictions, images, candidate.row);
  set_details(estimates, images, candidate.row);
  set_outlier_fraction(estimates, candidate.row);
  set_likelihood(predictor, estimates, images, candidate.row);
  candidate.estimates = std::move(estimates);
  return candidate;
}

std::vector<EvaluatedRow> candidates_of(const EvaluateOptions& options,
                                        const LabelledImages& images,
                                        const v1::MaterialChoice& materials) {
  std::vector<EvaluatedRow> candidates;
  for (const std::string& checkpoint : options.checkpoints) {
    Predictor predictor = Predictor::load(find_model(checkpoint));
    warn_of_albedos_out_of_reach(images.truth, predictor.model().bounds(), predictor.name());
    std::vector<MaterialEstimate> usual;
    for (const Shift& condition : conditions(options, predictor.model())) {
      std::vector<MaterialEstimate> estimates =
          estimate_all(predictor, images, condition.change, interruption());
      const double noise = condition.change.noise().max();
      const std::string name =
          predictor.name() + (condition.name.empty() ? "" : ", " + condition.name);
      if (options.one_material) {
        candidates.push_back(network_row(name + ", all images of an object", checkpoint, noise,
                                         predictor, combined(predictor, images, estimates),
                                         images));
      }
      candidates.push_back(network_row(name, checkpoint, noise, predictor, estimates, images));
      v1::Evaluation::Row& row = candidates.back().row;
      if (noise == 0) row.set_shift(condition.name);
      if (usual.empty()) usual = std::move(estimates);
      if (!row.shift().empty() && row.has_outlier_fraction()) {
        row.set_outlier_area(outlier_area(usual, candidates.back().estimates));
      }
    }
  }
  candidates.push_back(baseline("constant predictor", constant_predictions(images), images));
  if (std::optional<std::vector<Material>> predictions =
          similarity_predictions(images, materials)) {
    candidates.push_back(baseline(kSimilarityPredictor, std::move(*predictions), images));
  }
  return candidates;
}

// Renders some of the images again with every candidate's predictions.
void add_image_errors(const EvaluateOptions& options, const LabelledImages& images,
                      const std::vector<EvaluatedRow>& candidates, DatasetReader& dataset,
                      JobRenderer& pool, v1::Evaluation& evaluation) {
  const std::vector<uint32_t> chosen = spread(options.rerender, images.items.size());
  const bool in_colour = images.channels == 3;
  const size_t spheres = in_colour ? chosen.size() * (candidates.size() + 1) : 0;
  Progress progress("rerender", "images", chosen.size() * candidates.size() + spheres);
  uint64_t done = 0;
  const auto count = [&] { progress.update(++done); };
  const auto colours = [&](std::span<const Material> materials) {
    return sphere_colours(pool, images, chosen, materials, options.spp, count, interruption());
  };
  std::vector<std::array<double, 3>> truth;
  if (in_colour) truth = colours(images.truth);
  for (size_t c = 0; c < candidates.size(); ++c) {
    const ImageErrors errors =
        image_errors(dataset, pool, images, chosen, candidates[c].predictions, options.spp, count,
                     interruption());
    v1::Evaluation::Row& row = *evaluation.mutable_rows(static_cast<int>(c));
    if (in_colour) set_colour_differences(colours(candidates[c].predictions), truth, row);
    row.set_image(errors.relative);
    row.set_dissimilarity(errors.dissimilarity);
  }
  progress.finish();
  evaluation.set_rerendered(static_cast<uint32_t>(chosen.size()));
}

// Draws the errors of the first checkpoint.
void write_picture(const EvaluateOptions& options, const LabelledImages& images,
                   const EvaluatedRow& candidate, DatasetReader& dataset, JobRenderer& pool) {
  std::vector<PanelRow> rows;
  for (const size_t i : spread(options.picture_items, images.items.size())) {
    const std::vector<DatasetImage> channels = read_channels(images, i);
    for (size_t c = 0; c < channels.size(); ++c) {
      const std::vector<float>& input = channels[c].radiance;
      const std::vector<float> rendered =
          rerender(dataset, pool, *images.items[i], candidate.predictions[i * images.channels + c],
                   options.spp, interruption(), c);
      rows.push_back(
          compared(input, rendered, images.resolution, images.resolution, white_level(input)));
    }
  }
  write_panels(options.picture, rows);
}

std::string format_parameters(const v1::Evaluation::Triple& t, int decimals) {
  return fmt::format("{:7.{}f}  {:7.{}f}  {:7.{}f}", t.sigma_t(), decimals, t.albedo(), decimals,
                     t.g(), decimals);
}

// What there is to say of one network beside its errors.
void print_details(const v1::Evaluation::Row& row) {
  const auto with_interval = [](double value, const v1::Interval& interval) {
    return fmt::format("{:.3f} ({:.3f} to {:.3f})", value, interval.min(), interval.max());
  };
  print_result("\n{}\n", row.name());
  print_result("  RMSE over the constant predictor's (95 % intervals over shapes):\n");
  print_result("    sigma_t {}, albedo {}, g {}\n",
               with_interval(row.relative().sigma_t(), row.relative_sigma_t()),
               with_interval(row.relative().albedo(), row.relative_albedo()),
               with_interval(row.relative().g(), row.relative_g()));
  print_result("  mean absolute error over that of the best constant, the median:\n");
  print_result("    sigma_t {}, albedo {}, g {}\n",
               with_interval(row.relative_absolute().sigma_t(), row.relative_absolute_sigma_t()),
               with_interval(row.relative_absolute().albedo(), row.relative_absolute_albedo()),
               with_interval(row.relative_absolute().g(), row.relative_absolute_g()));
  print_result("  RMSE of what the eye sees: diffuse albedo {:.3f}, ln diffusion length {:.3f}\n",
               row.diffuse_albedo(), row.ln_diffusion_length());
  print_result(
      "  RMSE: ln sigma_t {:.3f}, sigma_a {:.2f}, sigma_s {:.1f}, sigma_s (1 - g) {:.1f} 1/mm\n",
      row.ln_sigma_t(), row.sigma_a(), row.sigma_s(), row.sigma_s_reduced());
  print_result("  median relative error: sigma_t {:.1f} %, sigma_s (1 - g) {:.1f} %\n",
               100 * row.median_relative_sigma_t(), 100 * row.median_relative_sigma_s_reduced());
  if (row.has_log_likelihood()) {
    print_result(
        "  mean log-likelihood of the truth {:.3f}{}\n", row.log_likelihood(),
        row.has_constant_log_likelihood()
            ? fmt::format("; of the Gaussian of all truths {:.3f}", row.constant_log_likelihood())
            : "");
  }
  if (row.has_joint_coverage()) {
    print_result("  in the 90 % region of all parameters together: {:.1f} % of the truths\n",
                 100 * row.joint_coverage());
  }
  if (row.rank_tests_size() > 0) {
    std::string tests;
    for (const v1::Evaluation::RankTest& test : row.rank_tests()) {
      tests +=
          fmt::format("{}{} {:.2g}", tests.empty() ? "" : ", ", test.quantity(), test.p_value());
    }
    print_result("  p-values of the truth's ranks in the answers: {}\n", tests);
  }
  if (row.has_outlier_fraction()) {
    print_result("  outliers: {:.1f} % of the images{}\n", 100 * row.outlier_fraction(),
                 row.has_outlier_area()
                     ? fmt::format("; told from those as they are with an area of {:.2f} under the "
                                   "curve (.5: not at all)",
                                   row.outlier_area())
                     : "");
  }
  const bool intervals = row.has_coverage();
  print_result("  {:20}  {:>25}{}\n", "", "RMSE: sigma_t, albedo, g",
               intervals ? "   in their 90 % intervals, %" : "");
  const auto percent = [](v1::Evaluation::Triple t) {
    t.set_sigma_t(100 * t.sigma_t());
    t.set_albedo(100 * t.albedo());
    t.set_g(100 * t.g());
    return format_parameters(t, 1);
  };
  const auto print_line = [&](const std::string& name, const v1::Evaluation::Triple& rmse,
                              const v1::Evaluation::Triple& coverage) {
    print_result("  {:20}  {}{}\n", name, format_parameters(rmse, 4),
                 intervals ? "   " + percent(coverage) : "");
  };
  v1::Evaluation::Triple rmse;
  rmse.set_sigma_t(row.sigma_t());
  rmse.set_albedo(row.albedo());
  rmse.set_g(row.g());
  print_line("all", rmse, row.coverage());
  for (const v1::Evaluation::Tercile& third : row.terciles()) {
    print_line(
        fmt::format("sigma_t {:.0f} to {:.0f}", third.sigma_t().min(), third.sigma_t().max()),
        third.rmse(), third.coverage());
  }
}

// Single answers beside their truth, of images spread over all.
void print_examples(uint32_t count, const EvaluatedRow& candidate, const LabelledImages& images) {
  print_result("\n{}: answers beside the truth; * where the 90 % interval does not hold it\n",
               candidate.row.name());
  int held = 0, intervals = 0;
  for (const size_t i : spread(count, images.items.size())) {
    for (size_t c = 0; c < images.channels; ++c) {
      const Material& truth = images.truth_of(i)[c];
      const MaterialEstimate& estimate = candidate.estimates[i * images.channels + c];
      print_result("  {}{}:", images.items[i]->file(),
                   images.channels > 1 ? fmt::format(" {}", kColourChannels.at(c)) : "");
      const auto print_one = [&](size_t k, const char* name, double true_value, double answer,
                                 int decimals) {
        print_result("  {} {:.{}f}, truth {:.{}f}", name, answer, decimals, true_value, decimals);
        if (!estimate.posterior) return;
        const ParameterPosterior& p = estimate.posterior->material.parameters[k];
        const bool holds = p.low <= true_value && true_value <= p.high;
        print_result(" in {:.{}f} to {:.{}f}{}", p.low, decimals, p.high, decimals,
                     holds ? "" : " *");
        ++intervals;
        held += holds ? 1 : 0;
      };
      print_one(0, "sigma_t", truth.sigma_t, estimate.material.sigma_t, 0);
      print_one(1, "albedo", truth.albedo, estimate.material.albedo, 2);
      print_one(2, "g", truth.g, estimate.material.g, 2);
      print_result("\n");
    }
  }
  if (intervals > 0) {
    print_result("  {} of {} intervals hold the truth; 90 % of all should.\n", held, intervals);
  }
}

void print(const v1::Evaluation& evaluation) {
  print_result("RMSE over {} {} images{}\n", evaluation.items(), evaluation.split(),
               evaluation.rerendered() > 0
                   ? fmt::format("; relative error and dissimilarity of the image over {} of them",
                                 evaluation.rerendered())
                   : "");
  size_t width = 0;
  for (const v1::Evaluation::Row& row : evaluation.rows()) {
    width = std::max(width, row.name().size());
  }
  print_result("{:{}}  {:>14}  {:>7}  {:>7}{}\n", "", width, "sigma_t [1/mm]", "albedo", "g",
               evaluation.rerendered() > 0 ? "    image  1-MS-SSIM" : "");
  for (const v1::Evaluation::Row& row : evaluation.rows()) {
    print_result("{:{}}  {:14.2f}  {:7.4f}  {:7.4f}", row.name(), width, row.sigma_t(),
                 row.albedo(), row.g());
    if (row.has_image()) print_result("  {:7.4f}  {:9.4f}", row.image(), row.dissimilarity());
    print_result("\n");
  }
  for (const v1::Evaluation::Row& row : evaluation.rows()) {
    if (!row.has_colour_difference()) continue;
    print_result(
        "{}: colour of a sphere under white light off by {:.1f}, of nine in ten by less than "
        "{:.1f} (CIE delta E 2000)\n",
        row.name(), row.colour_difference(), row.colour_difference_of_nine_in_ten());
  }
  print_result(
      "The constant predictor answers the mean of these images' own truth: no constant does "
      "better.\n");
  if (evaluation.rows().rbegin()->name() == kSimilarityPredictor) {
    print_result(
        "The similarity predictor is told sigma_t (1 - albedo g) and the reduced albedo, by which "
        "materials look alike,\nand nothing else: who is better has told such materials apart.\n");
  }
  for (const v1::Evaluation::Row& row : evaluation.rows()) {
    if (row.terciles_size() > 0) print_details(row);
  }
}

}  // namespace

void run_evaluate(const EvaluateOptions& options) {
  if (!options.picture.empty()) check_writable(options.picture);
  set_torch_threads(static_cast<int>(std::max(1U, std::thread::hardware_concurrency())));
  DatasetReader dataset(options.dataset);
  const v1::Split split = options.split == "train"        ? v1::SPLIT_TRAIN
                          : options.split == "validation" ? v1::SPLIT_VALIDATION
                                                          : v1::SPLIT_TEST;
  const LabelledImages images = images_of(dataset, split);
  const std::vector<EvaluatedRow> candidates =
      candidates_of(options, images, dataset.manifest().config().materials());
  v1::Evaluation evaluation;
  evaluation.set_split(options.split);
  evaluation.set_items(static_cast<uint32_t>(images.items.size()));
  for (const EvaluatedRow& candidate : candidates) *evaluation.add_rows() = candidate.row;
  std::optional<RenderPool> pool;
  if (options.rerender > 0 || !options.picture.empty()) {
    pool.emplace(options.workers.pool_options());
  }
  if (options.rerender > 0) {
    add_image_errors(options, images, candidates, dataset, *pool, evaluation);
  }
  if (options.json) {
    print_result("{}\n", to_json(evaluation));
  } else {
    print(evaluation);
    if (options.examples > 0) print_examples(options.examples, candidates.front(), images);
  }
  if (!options.picture.empty()) {
    std::fflush(stdout);  // the table is there whatever becomes of the picture
    write_picture(options, images, candidates.front(), dataset, *pool);
  }
}

}  // namespace itn
