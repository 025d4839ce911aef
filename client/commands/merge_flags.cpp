// itn merge: its flags.
#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <string>

#include "client/commands/command.h"
#include "client/commands/merge.h"
#include "client/commands/options.h"
#include "common/flags.h"

namespace itn {
namespace {

// 1/4 as 0.25.
const CLI::Validator kSeconds(
    [](std::string& text) {
      const size_t slash = text.find('/');
      double above = 0, below = 1;
      const bool read =
          CLI::detail::lexical_cast(text.substr(0, slash), above) &&
          (slash == std::string::npos || CLI::detail::lexical_cast(text.substr(slash + 1), below));
      const double seconds = above / below;
      if (!read || !(above > 0 && below > 0) || !std::isfinite(seconds)) {
        return text + " is not a time in seconds, as 1/60 or 0.25";
      }
      text = fmt::format("{}", seconds);
      return std::string();
    },
    "", "");

}  // namespace

void add_merge_command(CLI::App& app) {
  const auto options = std::make_shared<MergeOptions>();
  CLI::App* command = app.add_subcommand(
      "merge", "Photographs of a scene at several exposures, from a tripod, as one linear EXR");
  command
      ->add_option("photographs", options->photographs,
                   "Two or more, of one size: JPEG, PNG, TIFF, HEIC, WebP; or linear: OpenEXR, "
                   "Radiance HDR, TIFF of floating-point numbers, and others with --encoding "
                   "linear")
      ->required();
  command
      ->add_option(
          "-o,--output", options->output,
          "EXR file to write: R, G, B (or Y) on a linear scale, which is the files' own (1 "
          "is white) for an exposure of one second at the aperture and sensitivity of the "
          "first: relative, not in W/(m^2 sr)")
      ->required();
  command
      ->add_option("--seconds", options->seconds,
                   "Exposure times, as 1/60,1/15,1/4, in the order of the photographs; default: "
                   "from EXIF. Where f-number and ISO are in EXIF and differ, they count as well")
      ->delimiter(',')
      ->allow_extra_args(false)
      ->transform(kSeconds);
  command
      ->add_option("--response", options->response,
                   "The camera's curve from light to the files' values: estimated from the "
                   "photographs, or sRGB's; linear files have none")
      ->check(one_of({"estimate", "srgb"}))
      ->capture_default_str();
  add_encoding_flag(*command, options->is_linear);
  command->callback([options] { run_merge(*options); });
}

}  // namespace itn
