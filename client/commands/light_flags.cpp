// itn light: its flags.
#include <memory>

#include "client/commands/command.h"
#include "client/commands/light.h"
#include "client/commands/options.h"
#include "client/commands/photograph_flags.h"
#include "common/flags.h"

namespace itn {

void add_light_command(CLI::App& app) {
  const auto options = std::make_shared<LightOptions>();
  CLI::App* command = app.add_subcommand(
      "light", "Make a panorama of a room from a photograph of a ball that mirrors it");
  command
      ->add_option("image", options->image,
                   "Photograph of the ball, whole, best linear and of several exposures, as itn "
                   "merge writes it: lamps are brighter than one exposure holds")
      ->required();
  add_mask_flags(*command, options->photograph);
  command
      ->add_option("--focal-length", options->focal_length_35mm,
                   "Of the lens, in mm of a 35 mm camera. Default: as EXIF says")
      ->check(number_in(1.0, 10000.0));
  command
      ->add_option("--camera-down", options->camera_down,
                   "How far below the horizon the camera looks, in degrees")
      ->check(number_in(-89.0, 89.0))
      ->capture_default_str();
  command
      ->add_option("--ball-reflectance", options->reflectance,
                   "Part of the light that the ball mirrors: of chrome some 0.6. It matters where "
                   "the exposure of other photographs is known by this one's")
      ->check(number_in(0.01, 1.0))
      ->capture_default_str();
  command
      ->add_option(
          "--rows", options->rows,
          "Of the panorama, in pixels; it is twice as wide. Between the pixels of the ball "
          "there is nothing more to see")
      ->check(number_in(16, 2048))
      ->capture_default_str();
  add_encoding_flag(*command, options->photograph.reading.is_linear);
  add_layer_flag(*command, options->photograph.reading.layer);
  command
      ->add_option("-o,--output", options->output,
                   "OpenEXR file for the panorama, in latitude-longitude format: its middle lies "
                   "where the camera looks")
      ->required();
  command->callback([options] { run_light(*options); });
}

}  // namespace itn
