// itn refine: its flags.
#include <memory>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/commands/refine.h"
#include "common/flags.h"
#include "common/render_limits.h"

namespace itn {
namespace {

void add_flags(CLI::App& command, RefineOptions& options) {
  v1::RefineSettings& settings = options.settings;
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
  command.add_option("--model", options.model,
                     "Of --init network: a checkpoint, the folder of a run, or a model that itn "
                     "models lists; default: any");
  command
      .add_option("--starts", options.starts,
                  "Starts, spread about --init; the best after four iterations of each goes on")
      ->check(number_in(1U, 64U))
      ->capture_default_str();
  command
      .add_option_function<std::string>(
          "--method",
          [&settings](const std::string& method) {
            settings.set_method(method == "adam" ? v1::RefineSettings::ADAM
                                                 : v1::RefineSettings::GAUSS_NEWTON);
          },
          "gauss-newton; adam: for comparison, 150 iterations at --spp by default")
      ->check(one_of({"gauss-newton", "adam"}))
      ->default_str("gauss-newton");
  command
      .add_option_function<std::string>(
          "--pixel-weights,--weights",
          [&settings](const std::string& weights) {
            settings.set_weights(weights == "map"    ? v1::RefineSettings::MAP
                                 : weights == "none" ? v1::RefineSettings::NONE
                                                     : v1::RefineSettings::NOISE);
          },
          "How pixels count: noise: by the inverse variance of their noise; map: by the "
          "squared weight map, near edges; none: all the same")
      ->check(one_of({"noise", "map", "none"}))
      ->default_str("noise");
  command
      .add_option_function<std::string>(
          "--exposure",
          [&settings](const std::string& text) {
            settings.set_unknown_exposure(text == "unknown");
          },
          "unknown: the images are the renders times one factor, which is found, too; default: "
          "known")
      ->check(one_of({"known", "unknown"}));
  command.add_flag_callback(
      "--unknown-exposure", [&settings] { settings.set_unknown_exposure(true); },
      "The same as --exposure unknown");
  command
      .add_option_function<std::vector<std::string>>(
          "--unknown",
          [&settings](const std::vector<std::string>& names) {
            settings.mutable_unknowns()->Assign(names.begin(), names.end());
          },
          "Numbers of the scene that are found, too, from where the scene files have them, "
          "separated by commas: what render --derivatives lists of boundary and surfaces, "
          "such as rough_dielectric.index,rough_dielectric.roughness,surface[0].reflectance")
      ->delimiter(',');
  command
      .add_option_function<std::vector<std::string>>(
          "--known-within",
          [&settings](const std::vector<std::string>& texts) {
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
  command
      .add_option_function<double>(
          "--expected-g", [&settings](double g) { settings.set_expected_g(g); },
          "What g is about, with --known-within g=...")
      ->check(number_in(-0.98, 0.98))
      ->default_str("0");
  command.add_flag_callback(
      "--g-of-each-colour", [&settings] { settings.set_g_of_each_colour(true); },
      "Find a g of red, of green and of blue, with films of RGB. Default: one of all");
  command
      .add_option_function<uint32_t>(
          "--block", [&settings](uint32_t side) { settings.set_block(side); },
          "Over squares of so many pixels a side, differences to the image may hang together "
          "by what the scene leaves out; intervals are as much wider. 1: they are noise")
      ->check(number_in(1U, 64U))
      ->default_str("1");
  const CLI::Validator spp_range = number_in(4U, kMaxSamples);
  command
      .add_option_function<uint32_t>(
          "--spp", [&settings](uint32_t spp) { settings.set_spp(spp); },
          "Samples per pixel and image of the first iteration; default 64")
      ->check(spp_range);
  command
      .add_option_function<uint32_t>(
          "--max-spp", [&settings](uint32_t spp) { settings.set_max_spp(spp); },
          "Samples per pixel and image of an iteration at most; as many behind the answer "
          "are enough; default 4096, or --spp if that is more")
      ->check(spp_range);
  command
      .add_option_function<uint32_t>(
          "--max-iterations", [&settings](uint32_t most) { settings.set_max_iterations(most); },
          "Of a start; default 40, of adam 150")
      ->check(number_in(1U, 100000U));
  command
      .add_option_function<double>(
          "--time-limit", [&settings](double seconds) { settings.set_time_limit(seconds); },
          "In seconds: the last iteration has as many samples as they leave time for, and one is "
          "made at least; 0: none")
      ->check(number_in(0.0, 1e9))
      ->default_str("0");
  command
      .add_option_function<double>(
          "--tolerance", [&settings](double least) { settings.set_tolerance(least); },
          "End when the standard deviations of ln sigma_t, albedo and g are no larger")
      ->check(number_in(0.0, 1.0))
      ->default_str("0.002");
  command
      .add_option_function<double>(
          "--learning-rate", [&settings](double rate) { settings.set_learning_rate(rate); },
          "Of adam, in unbounded coordinates")
      ->check(number_in(1e-6, 10.0))
      ->default_str("0.05");
  add_refine_seed_flag(command, settings);
  command.add_option("-o,--output", options.output,
                     "Folder for trajectory.jsonl, result.json, picture.png (target, fit, "
                     "difference) and the state, from which the same command goes on");
  add_format_flags(command, options.json, "itn.v1.RefineResult");
}

}  // namespace

void add_refine_seed_flag(CLI::App& command, v1::RefineSettings& settings) {
  command
      .add_option_function<uint64_t>(
          "--seed", [&settings](uint64_t seed) { settings.set_seed(seed); },
          "Of the random numbers")
      ->check(kAnySeed)
      ->default_str("0");
}

void add_refine_command(CLI::App& app) {
  const auto options = std::make_shared<RefineOptions>();
  CLI::App* command = app.add_subcommand(
      "refine", "Refine a material until renders of a known scene are like the image");
  add_flags(*command, *options);
  add_worker_flags(*command, options->workers);
  command->callback([options] { run_refine(*options); });
}

}  // namespace itn
