// itn light: a photograph of a mirror ball becomes a panorama.
#include "client/commands/light.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <string>
#include <vector>

#include "client/commands/fit_photograph.h"
#include "client/commands/options.h"
#include "client/fit/mirror_ball.h"
#include "client/image/image.h"
#include "client/output.h"
#include "common/error.h"
#include "common/files/atomic_file.h"

namespace itn {
namespace {

void check_output(const LightOptions& options) {
  if (std::filesystem::path(options.output).extension() != ".exr") {
    throw Error(ErrorKind::kUsage,
                fmt::format("--output {}: it is written as OpenEXR, name it .exr", options.output));
  }
  require_no_input("--output", options.output, {options.image});
  check_writable(options.output);
}

void warn_if_clipped(const MarkedPhotograph& marked, const std::string& name) {
  const double clipped = clipped_part(marked.content.file.clipped, marked.mask);
  if (clipped == 0) return;
  spdlog::warn(
      "{}: {:.1f} % of the ball is as bright as the file can hold; what shines there is brighter "
      "than the panorama says, and an answer by it wrong. itn merge makes one of several exposures",
      name, 100 * clipped);
}

}  // namespace

void run_light(const LightOptions& options) {
  check_output(options);
  const MarkedPhotograph marked = read_marked(options.image, options.photograph);
  const PhotographContent& content = marked.content;
  if (reaches_edge(marked.view())) {
    throw invalid_input(options.image +
                        ": the ball is cut off by the frame; it must be seen whole");
  }
  warn_if_clipped(marked, options.image);
  MirrorBall ball;
  try {
    ball = ball_of_mask(marked.mask, content.width());
  } catch (const Error& error) {
    throw Error(error.kind(), fmt::format("{}: {}", options.image, error.what()));
  }
  const BallCamera camera{
      .width = content.width(),
      .height = content.height(),
      .focal = focal_in_pixels(content, options.image, options.focal_length_35mm),
      .degrees_down = options.camera_down};
  Image panorama;
  panorama.width = 2 * options.rows;
  panorama.height = options.rows;
  const std::vector<float> pixels =
      panorama_of_ball(marked.pixels, marked.view().channels, camera, ball, options.rows);
  const auto mirrored = static_cast<float>(options.reflectance);
  for (size_t i = 0; i < pixels.size(); ++i) {
    const std::string& channel = content.channels[i % content.channels.size()];
    panorama.channels[channel].push_back(pixels[i] / mirrored);
  }
  write_exr(options.output, panorama);
  print_result(
      "{}: {} x {} pixels, of a ball of {:.0f} pixels; the 16 degrees about what is behind the "
      "ball are filled from around them\n",
      options.output, panorama.width, panorama.height, 2 * ball.radius);
}

}  // namespace itn
