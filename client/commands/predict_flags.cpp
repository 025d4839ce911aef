// itn predict: its flags.
#include <fmt/format.h>

#include <array>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/commands/photograph_flags.h"
#include "client/commands/predict.h"
#include "client/exports/exports.h"
#include "common/flags.h"
#include "common/learning/model_files.h"

namespace itn {
namespace {

void add_photograph_flags(CLI::App& command, PhotographOptions& options) {
  add_mask_flags(command, options);
  add_encoding_flag(command, options.reading.is_linear);
  add_layer_flag(command, options.reading.layer);
  command
      .add_option_function<std::string>(
          "--frame",
          [&options](const std::string& frame) {
            options.framing = frame == "whole" ? Framing::kSquareWhole : Framing::kObject;
          },
          "What the network sees: a square about the object, or the whole of a square image that "
          "was framed like those of training. Default: whole for files with a channel mask.Y, as "
          "renders have, otherwise object")
      ->check(CLI::IsMember({"object", "whole"}));
  command
      .add_option("--object-size", options.object_size,
                  "Longest side of the object, in mm. Default: unknown, and sigma_t is for an "
                  "object of 1 mm")
      ->check(number_in(1e-3, 1e6));
  const auto exposure =
      command
          .add_option("--radiance-scale,--exposure", options.exposure,
                      fmt::format("The image times this is radiance on the scale of the model's "
                                  "training: for {} a white card shows 31.8",
                                  kScaleModel))
          ->check(number_in(1e-12, 1e12));
  CLI::Option* const card = add_gray_card_flags(command, options);
  card->excludes(exposure);
}

// Adds what is printed of one image or one material.
void add_flags_for_people(CLI::App& command, PredictOptions& options) {
  command.add_option(
      "--picture", options.picture,
      "PNG file to write, of one image or one material: a row for each image, of what the network "
      "saw: the photograph as framed, white at its 99th percentile on the object; the mask over "
      "it, outlined; the weight map, black 0 to white 1; with --scene also the re-rendering and "
      "the difference, red where the re-rendering is brighter, blue where it is darker");
  command.add_option("--report", options.report,
                     "HTML file to write, of one image or one material: a page that needs no other "
                     "file, with the answer, what limits it, the panels of --picture, renders of "
                     "the material, and its files for all renderers");
  command.add_option("--scene", options.scene,
                     "Scene file, as itn render takes, that shows what the photograph shows, with "
                     "sides of the same ratio: its object is rendered with the answer for "
                     "--picture and --report. The object may have any size. The re-rendering is "
                     "compared with the image times --radiance-scale; without it, of images "
                     "encoded for a screen or with a gray card, brought to their mean");
  command
      .add_option("--spp", options.spp, "Samples per pixel of renders for --picture and --report")
      ->check(kSppRange)
      ->capture_default_str();
}

void add_output_flags(CLI::App& command, PredictOptions& options) {
  std::vector<std::string> formats{"text", "json", "csv"};
  std::string exports;
  for (const ExportFormat& format : export_formats()) {
    formats.emplace_back(format.name);
    exports += fmt::format("; {}: {}", format.name, format.description);
  }
  command
      .add_option("--format", options.format,
                  "text: a table; json: itn.v1.Prediction, one a line; csv" + exports)
      ->check(CLI::IsMember(formats))
      ->capture_default_str();
  command.add_option("-o,--output", options.output,
                     "File for a renderer's material, or a folder for those of several images; "
                     "default: standard output");
  command.add_option("--material-name", options.exports.name, "In a renderer's file")
      ->capture_default_str();
  add_scene_unit_flag(command, options.exports.mm_per_scene_unit);
}

}  // namespace

void add_predict_command(CLI::App& app) {
  const auto options = std::make_shared<PredictOptions>();
  CLI::App* command =
      app.add_subcommand("predict", "Optical parameters of the object in a photograph, or in many");
  command
      ->add_option(
          "image", options->images,
          "Photograph: EXR or Radiance HDR of linear radiance; PNG, JPEG, TIFF, HEIC, "
          "AVIF or WebP, which are taken through the curve of sRGB; -: standard input. Several, "
          "or a folder of them: one that cannot be used loses none of the others")
      ->required();
  add_photograph_flags(*command, options->photographs);
  command->add_flag("--one-material", options->one_material,
                    "All images, up to 64, show one material, in other light or from other sides: "
                    "answer from all of them together, too");
  command->add_option(
      "--model", options->model,
      fmt::format(
          "Predict in this process, by a model that itn models lists, a "
          "checkpoint or the folder of a run; default: {}; {} where the scale of radiance is "
          "known, by --gray-card of an image that is linear or whose --encoding is said, or "
          "by --radiance-scale; {} of photographs of one channel, and of all with --matt. "
          "With --predictor: by that one of its models (itn models --predictor lists "
          "them); default: the predictor's",
          kDefaultModel, kScaleModel, kDefaultGrayModel));
  command
      ->add_flag("--matt", options->matt,
                 "The object has no gloss: light enters and leaves it straight, as in renders "
                 "without a boundary, or seen through crossed polarisers")
      ->excludes("--model");
  const auto predictor = command->add_option("--predictor", options->predictor,
                                             "HOST:PORT of an itn-predictor to ask");
  add_security_flags(*command, options->security);
  command
      ->add_option("--model-version", options->version,
                   "Version of the predictor's model; default: its newest")
      ->needs(predictor);
  command->add_option("--timeout", options->timeout, "Of a call, in seconds")
      ->check(number_in(0.01, 3600.0))
      ->capture_default_str();
  add_output_flags(*command, *options);
  add_flags_for_people(*command, *options);
  command->add_flag_callback(
      "--json", [options] { options->format = "json"; },
      "--format json: itn.v1.Prediction, of several images one a line");
  command->callback([options] { run_predict(*options); });
}

}  // namespace itn
