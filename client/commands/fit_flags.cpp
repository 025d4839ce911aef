// itn fit: its flags.
#include <fmt/format.h>

#include <memory>

#include "client/commands/command.h"
#include "client/commands/config_flags.h"
#include "client/commands/fit.h"
#include "client/commands/options.h"
#include "client/commands/photograph_flags.h"
#include "common/flags.h"
#include "common/render_limits.h"

namespace itn {
namespace {

using Settings = v1::RefineSettings;

void add_flags(CLI::App& command, ConfigFlags<Settings>& changes, FitOptions& options) {
  PhotographOptions& photograph = options.photograph;
  RefineOptions& refine = options.refine;
  command
      .add_option(
          "images", options.images,
          "Photographs of one object, as for itn predict, each seen whole, by one exposure "
          "that is set by hand. Pixels at its edge, and at the top of what a file can hold, "
          "do not count. A gray card is in the first one")
      ->required();
  command
      .add_option("--scene", options.scenes,
                  "Scene file in which all is known but material, roughness and exposure: one for "
                  "all images, or once for each, in order. Photographs are averaged down to its "
                  "film")
      ->allow_extra_args(false);
  command.add_option("--shape", options.shape,
                     "A PLY, OBJ or STL file, or a shape that itn shapes lists, as sphere: where "
                     "it stands is found");
  command
      .add_option("--object-size", options.object_size,
                  "Longest side of the object, in mm; or its sides along x, y and z of the shape, "
                  "y being up, separated by commas: a slab is a cube of 60,5,40. Default: as the "
                  "shape's file has it, if --mesh-unit says its unit")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(number_in(1e-3, 1e6));
  add_mesh_unit_flag(command, refine.mesh_unit);
  command.add_flag("--repair", options.repair, "Close a mesh that is nearly closed");
  command
      .add_option("--light", options.light,
                  "flash: of the camera, in a dark room; sun: of a clear sky; or the file of a "
                  "panorama (EXR or .hdr) of the room, of linear radiance")
      ->capture_default_str();
  command
      .add_option("--flash-offset", options.flash_offset,
                  "Where the flash is, from the lens: X,Y,Z in mm, to the right, up and back")
      ->delimiter(',')
      ->expected(3)
      ->check(number_in(-1e4, 1e4))
      ->capture_default_str();
  command
      .add_option(
          "--panorama-turn", options.panorama_turn,
          "Of the panorama, or the sun, about the vertical, in degrees, counter-clockwise seen "
          "from above: at 0, the panorama's middle, or the sun, lies where the camera looks. Of "
          "several photographs one for all, or one for each, separated by commas. Default: as "
          "light and shade on the object say")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(number_in(-360.0, 360.0));
  command
      .add_option("--camera-down", options.camera_down,
                  "How far below the horizon the camera looks, in degrees, likewise; counts with a "
                  "panorama or the sun")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(number_in(-89.0, 89.0))
      ->capture_default_str();
  command
      .add_option(
          "--sun-elevation", options.sun_elevation,
          "How far above the horizon the sun stands, in degrees, with --light sun. Default: "
          "as light and shade on the object say")
      ->check(number_in(0.0, 90.0));
  command
      .add_option("--turn-error", options.turn_error,
                  "How well the turn of the panorama, --camera-down and --sun-elevation are known, "
                  "in degrees, as a standard deviation")
      ->check(number_in(0.0, 20.0))
      ->capture_default_str();
  command
      .add_option("--focal-length", options.focal_length_35mm,
                  "Of the lens, in mm of a 35 mm camera. Default: as EXIF says")
      ->check(number_in(1.0, 10000.0));
  command.add_option("--index", options.index, "Index of refraction of the object")
      ->check(number_in(1.1, 2.5))
      ->capture_default_str();
  command
      .add_option("--index-error", options.index_error,
                  "How well --index is known: a standard deviation. The photograph tells the rest; "
                  "0: exactly")
      ->check(number_in(0.0, 0.2))
      ->capture_default_str();
  command
      .add_option("--flash-error", options.flash_error,
                  "How well --flash-offset is known, in mm, likewise")
      ->check(number_in(0.0, 50.0))
      ->capture_default_str();
  command
      .add_option(
          "--g", options.g,
          "What g is taken for. A photograph hardly tells it: materials of the same sigma_s "
          "(1 - g) and sigma_a look about alike. By how much they do not, for a g that is "
          "0.4 more or less, is in the intervals of these two")
      ->check(number_in(-0.98, 0.98))
      ->capture_default_str();
  command
      .add_option("--g-error", options.g_error,
                  "To find g, too, in thin or clear objects: how well --g is known, as a standard "
                  "deviation; 0: g is not found")
      ->check(number_in(0.0, 1.0))
      ->capture_default_str();
  CLI::Option* luminance = command.add_flag(
      "--luminance", options.luminance,
      "One material for all colours, in a third of the time. Default: red, green and "
      "blue, which share g and all that is no material");
  changes
      .add_switch("--g-of-each-colour", &Settings::set_g_of_each_colour,
                  "Of red, green and blue each has a g of its own, known as --g and --g-error say")
      ->excludes(luminance);
  command
      .add_option("--resolution", options.resolution,
                  "Pixels a side of the square about the object that is fitted")
      ->check(number_in(16, 256))
      ->capture_default_str();
  add_mask_flags(command, photograph);
  CLI::Option* card = add_gray_card_flags(command, photograph);
  command
      .add_option("--card-distance", options.card_distance,
                  "Of the gray card from the flash, in mm. Default: that of the object")
      ->check(number_in(1.0, 1e5))
      ->needs(card);
  command
      .add_option(
          "--card-error", options.card_error,
          "How well card, its distance and its angle tell the light, as a part of it or in "
          "percent, likewise. Default: 0.03, in a panorama, where the object shades the card, "
          "0.06")
      ->transform(kPercentToPart)
      ->check(number_in(0.0, 0.5))
      ->needs(card);
  command
      .add_option("--shape-error", options.shape_error,
                  "How far the object may be from its shape, root mean square, as a part of its "
                  "size or in percent: intervals allow for what that changes in the image")
      ->transform(kPercentToPart)
      ->check(number_in(0.0, 0.05))
      ->capture_default_str();
  add_encoding_flag(command, photograph.reading.is_linear);
  add_layer_flag(command, photograph.reading.layer);
  command
      .add_option("--init", refine.init,
                  "Where to start: mean (sigma_t 91 over the longest side of the object in mm, "
                  "0.67, 0.4), network, or SIGMA_T,ALBEDO,G")
      ->capture_default_str();
  command.add_option("--starts", refine.starts, "As of itn refine")
      ->check(number_in(1U, 64U))
      ->capture_default_str();
  changes.add<uint32_t>("--max-spp", &Settings::set_max_spp, "As of itn refine")
      ->check(number_in(64U, kMaxSamples));
  changes
      .add<double>(
          "--time-limit", &Settings::set_time_limit,
          "In seconds, from the beginning: the refinement has what the search for the "
          "object leaves, one iteration at least, and the report takes up to half a minute "
          "more; 0: none")
      ->check(number_in(0.0, 1e9))
      ->default_str(fmt::format("{}", refine.settings.time_limit()));
  changes.add<uint64_t>("--seed", &Settings::set_seed, "Of the random numbers")
      ->check(kAnySeed)
      ->default_str("0");
  command
      .add_option("-o,--output", refine.output,
                  "Folder for the scene that is found (scene.textproto), the photograph as it was "
                  "compared (photograph.exr), the pose over it (pose.png), and the refinements")
      ->required();
  add_format_flags(command, refine.json, "itn.v1.FitResult");
}

}  // namespace

void add_fit_command(CLI::App& app) {
  const auto options = std::make_shared<FitOptions>();
  options->refine.init = "mean";
  options->refine.starts = 4;
  options->refine.settings.set_max_spp(4096);
  options->refine.settings.set_time_limit(240);
  CLI::App* command = app.add_subcommand(
      "fit", "Find the material of an object of known shape from its photograph");
  const auto changes = std::make_shared<ConfigFlags<Settings>>(*command);
  add_flags(*command, *changes, *options);
  add_worker_flags(*command, options->refine.workers);
  command->callback([options, changes] {
    changes->apply_to(options->refine.settings);
    run_fit(*options);
  });
}

}  // namespace itn
