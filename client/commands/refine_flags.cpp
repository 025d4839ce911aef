// itn refine: its flags.
#include <memory>

#include "client/commands/command.h"
#include "client/commands/config_flags.h"
#include "client/commands/options.h"
#include "client/commands/refine.h"
#include "common/flags.h"
#include "common/learning/model_files.h"
#include "common/render_limits.h"

namespace itn {
namespace {

using Settings = v1::RefineSettings;

void add_flags(CLI::App& command, ConfigFlags<Settings>& changes, RefineOptions& options) {
  command
      .add_option(
          "images", options.images,
          "Images of one material, of linear radiance on the scale of their scenes' lights, "
          "of the size of their films, or larger: EXR, or others as for itn predict. Of an EXR, "
          "mask.Y "
          "says which pixels count (default: where the scene shows the object), and "
          "stderr.Y how noisy they are. Pixels at the top of what a file can hold do not count")
      ->required();
  command.add_option("--mask", options.mask,
                     "Image that is bright (above half) on the pixels that count, or a folder with "
                     "one of the same name for each image. Default: an EXR's mask.Y");
  add_encoding_flag(command, options.reading.is_linear);
  add_layer_flag(command, options.reading.layer);
  command
      .add_option(
          "--scene", options.scenes,
          "Scene file (text format of itn.v1.Scene); once for all images, or once for each, "
          "in order")
      ->required()
      ->allow_extra_args(false);
  add_mesh_unit_flag(command, options.mesh_unit);
  command
      .add_option("--init", options.init,
                  "Where to start: network (its answer to the images, which then need a mask.Y), "
                  "mean (sigma_t 91 over the longest side of the object in mm, 0.67, 0.4), or "
                  "SIGMA_T,ALBEDO,G, the first in 1/mm")
      ->capture_default_str();
  command.add_option(
      "--model", options.model,
      fmt::format("Of --init network: a checkpoint, the folder of a run, or a model that "
                  "itn models lists; default: {}",
                  kDefaultGrayModel));
  command
      .add_option("--starts", options.starts,
                  "Starts, spread about --init; the best after four iterations of each goes on")
      ->check(number_in(1U, 64U))
      ->capture_default_str();
  changes
      .add_choice<Settings::Method>(
          "--method", {{"gauss-newton", Settings::GAUSS_NEWTON}, {"adam", Settings::ADAM}},
          &Settings::set_method,
          "gauss-newton; adam: for comparison, 150 iterations at --spp by default")
      ->default_str("gauss-newton");
  changes
      .add_choice<Settings::Weights>(
          "--pixel-weights,--weights",
          {{"noise", Settings::NOISE}, {"map", Settings::MAP}, {"none", Settings::NONE}},
          &Settings::set_weights,
          "How pixels count: noise: by the inverse variance of their noise; map: by the "
          "squared weight map, near edges; none: all the same")
      ->default_str("noise");
  changes.add_choice<bool>(
      "--exposure", {{"known", false}, {"unknown", true}}, &Settings::set_unknown_exposure,
      "unknown: the images are the renders times one factor, which is found, too; default: "
      "known");
  changes.add_switch("--unknown-exposure", &Settings::set_unknown_exposure,
                     "The same as --exposure unknown");
  changes
      .add<std::vector<std::string>>(
          "--unknown",
          [](Settings& settings, const std::vector<std::string>& names) {
            settings.mutable_unknowns()->Assign(names.begin(), names.end());
          },
          "Numbers of the scene that are found, too, from where the scene files have them, "
          "separated by commas: what render --derivatives lists of boundary and surfaces, "
          "such as rough_dielectric.index,rough_dielectric.roughness,surface[0].reflectance")
      ->delimiter(',');
  changes
      .add<std::vector<std::string>>(
          "--known-within",
          [](Settings& settings, const std::vector<std::string>& texts) {
            for (const std::string& text : texts) {
              const auto [name, deviation] =
                  named_number("--known-within", text, "rough_dielectric.index=0.03");
              settings.mutable_known_within()->insert({name, deviation});
            }
          },
          "NAME=DEVIATION, separated by commas: how well the scene files know what --unknown "
          "names, "
          "or exposure, as a standard deviation: rough_dielectric.index=0.03,exposure=0.05; or g, "
          "about --expected-g")
      ->delimiter(',');
  changes
      .add<double>("--expected-g", &Settings::set_expected_g,
                   "What g is about, with --known-within g=...")
      ->check(number_in(-0.98, 0.98))
      ->default_str("0");
  changes.add_switch(
      "--g-of-each-colour", &Settings::set_g_of_each_colour,
      "Find a g of red, of green and of blue, with films of RGB. Default: one of all");
  changes
      .add<uint32_t>(
          "--block", &Settings::set_block,
          "Over squares of so many pixels a side, differences to the image may hang together "
          "by what the scene leaves out; intervals are as much wider. 1: they are noise")
      ->check(number_in(1U, 64U))
      ->default_str("1");
  const CLI::Validator spp_range = number_in(4U, kMaxSamples);
  changes
      .add<uint32_t>("--spp", &Settings::set_spp,
                     "Samples per pixel and image of the first iteration; default 64")
      ->check(spp_range);
  changes
      .add<uint32_t>(
          "--max-spp", &Settings::set_max_spp,
          "Samples per pixel and image of an iteration at most; as many behind the answer "
          "are enough; default 4096, or --spp if that is more")
      ->check(spp_range);
  changes
      .add<uint32_t>("--max-iterations", &Settings::set_max_iterations,
                     "Of a start; default 40, of adam 150")
      ->check(number_in(1U, 100000U));
  changes
      .add<double>(
          "--time-limit", &Settings::set_time_limit,
          "In seconds: the last iteration has as many samples as they leave time for, and one is "
          "made at least; 0: none")
      ->check(number_in(0.0, 1e9))
      ->default_str("0");
  changes
      .add<double>("--tolerance", &Settings::set_tolerance,
                   "End when the standard deviations of ln sigma_t, albedo and g are no larger")
      ->check(number_in(0.0, 1.0))
      ->default_str("0.002");
  changes
      .add<double>("--learning-rate", &Settings::set_learning_rate,
                   "Of adam, in unbounded coordinates")
      ->check(number_in(1e-6, 10.0))
      ->default_str("0.05");
  changes.add<uint64_t>("--seed", &Settings::set_seed, "Of the random numbers")
      ->check(kAnySeed)
      ->default_str("0");
  command.add_option("-o,--output", options.output,
                     "Folder for trajectory.jsonl, result.json, picture.png (target, fit, "
                     "difference) and the state, from which the same command goes on");
  add_format_flags(command, options.json, "itn.v1.RefineResult");
}

}  // namespace

void add_refine_command(CLI::App& app) {
  const auto options = std::make_shared<RefineOptions>();
  CLI::App* command = app.add_subcommand(
      "refine", "Refine a material until renders of a known scene are like the image");
  const auto changes = std::make_shared<ConfigFlags<Settings>>(*command);
  add_flags(*command, *changes, *options);
  add_worker_flags(*command, options->workers);
  command->callback([options, changes] {
    changes->apply_to(options->settings);
    run_refine(*options);
  });
}

}  // namespace itn
