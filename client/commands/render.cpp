// itn render: an image of a scene and its derivatives, as layers of an EXR file.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <google/protobuf/struct.pb.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/image/attributes.h"
#include "client/image/image.h"
#include "client/image/preview.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/measured_media.h"
#include "client/object_media.h"
#include "client/output.h"
#include "client/progress.h"
#include "client/render/image_render.h"
#include "client/render/render_rounds.h"
#include "client/render/reply_images.h"
#include "client/render_pool/render_pool.h"
#include "client/scene/scene_file.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/fields.h"
#include "common/files/atomic_file.h"
#include "common/flags.h"
#include "common/material.h"
#include "common/printable.h"
#include "common/render_limits.h"
#include "common/scene/material_proto.h"
#include "common/scene/mesh_builder.h"
#include "common/scene/wire_array.h"
#include "server/renderer.h"

namespace itn {
namespace {

struct RenderFlags {
  std::string scene;
  std::optional<v1::LengthUnit> mesh_unit;
  std::string output;
  std::string png;
  double picture_exposure = 0;  // in stops
  bool alpha = false;
  std::string film;
  ImageRequest image;
  std::string phase, pixels = "all", tracer = "wavefront";
  double noise = 0, seconds = 0;  // see RenderGoal
  WorkerFlags workers;
  bool json = false;
};

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return text;
}

SceneValue named_value(const std::string& text) {
  const auto [name, value] = named_number("--set", text, "light[0].scale=2");
  require_usage(!is_of_medium(name),
                fmt::format("--set {}: the medium is set by --sigma-t, --albedo, --g or --phase",
                            printable(text)));
  return {name, value};
}

// 2m as 120.
const CLI::Validator kTimeToSeconds(
    [](std::string& text) {
      double time = 0;
      const char* const end = text.data() + text.size();
      const auto [unit, error] = std::from_chars(text.data(), end, time);
      for (const auto& [name, seconds] :
           {std::pair{"s", 1}, std::pair{"m", 60}, std::pair{"h", 3600}, std::pair{"", 1}}) {
        if (error == std::errc() && std::string_view(unit, end) == name) {
          text = fmt::format("{}", time * seconds);
          return std::string();
        }
      }
      return text + " is not a time, as 10s, 2m or 1h";
    },
    "", "");

// What flags say in words.
void read_words(RenderFlags& options) {
  ImageRequest& image = options.image;
  image.pixels = pixels_named(options.pixels);
  image.tracer = tracer_named(options.tracer);
  if (!options.phase.empty()) parse_text_proto(options.phase, "--phase", image.phase.emplace());
}

// ---- Where results go ------------------------------------------------------------------------

std::string suffix(const std::string& path) {
  return lower(std::filesystem::path(path).extension().string());
}

// Before the work, so that no render is lost for want of a place to write it to.
void check_outputs(const RenderFlags& options) {
  // Nobody's scene or mesh is replaced by an image because of a slip of the keyboard.
  const auto may_be = [](const std::string& path, const char* expected) {
    return suffix(path).empty() || suffix(path) == expected;
  };
  require_usage(
      may_be(options.output, ".exr"),
      fmt::format("--output {}: it is written as OpenEXR, name it .exr; --picture writes a "
                  "picture to look at",
                  options.output));
  std::error_code absent;
  require_usage(!std::filesystem::equivalent(options.output, options.scene, absent),
                fmt::format("--output {}: that is the scene file", options.output));
  check_writable(options.output);
  const bool image_to_stdout = is_stdout(options.output);
  require_usage(!image_to_stdout || !options.json,
                "--json and the image cannot both go to standard output");
  if (options.png.empty()) return;
  require_usage(may_be(options.png, ".png"),
                fmt::format("--picture {}: it is written as PNG, name it .png", options.png));
  require_usage(std::filesystem::path(options.png).lexically_normal() !=
                        std::filesystem::path(options.output).lexically_normal() &&
                    !is_stdout(options.png),
                fmt::format("--picture {}: it needs a file of its own", options.png));
  check_writable(options.png);
}

// Flags that are right by themselves, but not together.
void check_combinations(const RenderFlags& options) {
  require_usage(options.tracer != "reference" || options.image.pilot_spp == 0,
                fmt::format("--tracer reference and --pilot-spp {}: the reference has no pilot; "
                            "leave out one of the two",
                            options.image.pilot_spp));
  require_usage((options.noise == 0 && options.seconds == 0) || options.image.pilot_spp == 0,
                "--noise and --time have no --pilot-spp: it spreads a number of samples that is "
                "known; leave out one of them");
  require_usage(options.image.estimates <= options.image.spp,
                fmt::format("--estimates {} and --spp {}: each estimate needs a sample per pixel; "
                            "take at most as many estimates",
                            options.image.estimates, options.image.spp));
}

// ---- The request -----------------------------------------------------------------------------

// `size`: N or WIDTHxHEIGHT in pixels.
void set_film(const std::string& size, v1::Film& film) {
  unsigned width = 0;
  unsigned height = 0;
  int used = 0;
  const auto all = [&](int found) { return found > 0 && used == static_cast<int>(size.size()); };
  if (all(std::sscanf(size.c_str(), "%5u%n", &width, &used))) {
    height = width;
  } else if (!all(std::sscanf(size.c_str(), "%5ux%5u%n", &width, &height, &used))) {
    throw Error(
        ErrorKind::kUsage,
        fmt::format("--resolution: {} is not N or WIDTHxHEIGHT in pixels, e.g. 128x96", size));
  }
  film.set_width(width);
  film.set_height(height);
}

Bounds bounds_of_object(const v1::Scene& scene) {
  return object_bounds("scene.object", scene.object());
}

// The scene's medium, unless flags name one.
void take_medium(const v1::Scene& scene, RenderFlags& options) {
  const bool has_flags = !options.image.sigma_t.empty() || !options.image.albedo.empty() ||
                         !options.image.g.empty() || !options.phase.empty() ||
                         !options.image.medium.empty();
  if (!has_flags && itn::take_medium(scene, options.image)) return;
  const bool has_medium = scene.object().has_medium() || !scene.object().material().empty();
  require_usage(
      !has_flags || !has_medium || !options.image.medium.empty() ||
          (!options.image.sigma_t.empty() && !options.image.albedo.empty()),
      "--albedo, --g and --phase need --sigma-t and --albedo beside them: flags stand for the "
      "whole of the medium that the scene's object has");
  require_usage(!options.image.medium.empty() ||
                    (!options.image.sigma_t.empty() && !options.image.albedo.empty()),
                "--sigma-t and --albedo are required, or --material, or a medium or material in "
                "the scene's object");
}

// How long until the goal is reached, as the noise falls with the root of the samples. The first
// round is too short to tell.
std::string what_is_left(const RenderGoal& goal, const RenderedSoFar& so_far) {
  if (so_far.rounds < 2) return "";
  double seconds = std::numeric_limits<double>::infinity();
  if (goal.noise > 0) {
    const double samples = so_far.spp * (std::pow(so_far.noise / goal.noise, 2) - 1);
    seconds = std::max(0.0, samples) * so_far.seconds_per_sample;
  }
  if (goal.seconds > 0) seconds = std::min(seconds, goal.seconds - so_far.seconds);
  seconds = std::min(seconds, (goal.spp - so_far.spp) * so_far.seconds_per_sample);
  return fmt::format(", about {:.2g} s left in all", std::max(0.0, seconds));
}

RenderGoal goal_of(const RenderFlags& options) {
  return {options.noise, options.seconds, options.image.spp, options.image.estimates};
}

RoundsReply render(const RenderFlags& options, const std::vector<RenderJob>& jobs,
                   std::chrono::steady_clock::time_point start) {
  RenderPool pool(options.workers.pool_options());
  std::optional<Progress> progress;
  uint32_t begun = 0;  // samples when the round began that is shown
  const RenderGoal goal = goal_of(options);
  RoundsReply reply = render_rounds(
      pool, jobs, goal, start, [&](const RenderedSoFar& so_far, uint32_t round, double fraction) {
        throw_if_interrupted();
        if (!progress || begun != so_far.spp) {
          if (progress) progress->finish();
          begun = so_far.spp;
          progress.emplace("rendering", "samples per pixel", begun + round, begun);
        }
        progress->update(begun + static_cast<uint64_t>(fraction * round),
                         begun > 0 ? fmt::format("noise {:.2g} %{}", 100 * so_far.noise,
                                                 what_is_left(goal, so_far))
                                   : "");
      });
  progress->finish();
  return reply;
}

// ---- The file --------------------------------------------------------------------------------

// `channel`: its name.
void add_channel(const std::string& channel, const v1::RenderGradReply& reply,
                 const RenderFlags& options, Image& image) {
  image.channels[channel] = mean_radiance(reply, options.image.spp);
  const std::vector<std::string>& derivatives = options.image.derivatives;
  for (size_t d = 0; d < derivatives.size(); ++d) {
    const auto derivative = [d](const v1::Estimate& e) -> const std::string& {
      return e.derivatives(static_cast<int>(d));
    };
    const std::string name = derivatives[d] + "." + channel;
    image.channels[name] = mean_of_estimates(reply, options.image.spp, derivative);
    if (reply.estimates_size() == 1) continue;
    image.channels["stderr." + name] = standard_error_of_estimates(reply, derivative);
  }
  image.channels["mask.Y"] = from_bytes<float>(reply.mask());  // the same in all channels
  if (options.alpha) image.channels["A"] = image.channel("mask.Y");
  image.channels["stderr." + channel] = from_bytes<float>(reply.standard_error());
  if (reply.estimates_size() == 1) return;
  for (int k = 0; k < reply.estimates_size(); ++k) {
    const v1::Estimate& estimate = reply.estimates(k);
    image.channels[fmt::format("estimate{}.{}", k, channel)] =
        from_bytes<float>(estimate.radiance());
    for (size_t d = 0; d < derivatives.size(); ++d) {
      image.channels[estimate_channel(k, derivatives[d], channel)] =
          from_bytes<float>(estimate.derivatives(static_cast<int>(d)));
    }
  }
}

Image make_image(const std::vector<ImageChannel>& channels, const RenderJob& job,
                 const std::vector<v1::RenderGradReply>& replies, const v1::Counters& counters,
                 const RenderFlags& options) {
  Image image;
  image.width = static_cast<int>(replies[0].width());
  image.height = static_cast<int>(replies[0].height());
  const auto count = [](uint64_t value) { return static_cast<double>(value); };
  image.attributes = {
      {attribute::kVersion, ITN_VERSION},
      {attribute::kSceneSha256, to_hex(job.scene->digest)},
      {attribute::kSpp, static_cast<int>(options.image.spp)},
      {attribute::kSeed, std::to_string(options.image.seed)},
      {attribute::kEstimates, static_cast<int>(options.image.estimates)},
      {attribute::kPilotSpp, static_cast<int>(options.image.pilot_spp)},
      {attribute::kPixels, options.pixels},
      {attribute::kTracer, options.tracer},
      {attribute::kPaths, count(counters.paths())},
      {attribute::kSteps, count(counters.steps())},
      {attribute::kInvalidSamples, count(counters.invalid_samples())},
      {attribute::kLeaks, count(counters.leaks())},
  };
  if (!options.phase.empty()) image.attributes[attribute::kPhase] = options.phase;
  std::vector<std::string> values;
  for (const auto& [name, value] : options.image.values) {
    values.push_back(fmt::format("{}={}", name, value));
  }
  if (!values.empty())
    image.attributes[attribute::kValues] = fmt::format("{}", fmt::join(values, " "));
  for (size_t c = 0; c < channels.size(); ++c) {
    const auto& [name, shown, material] = channels[c];
    add_channel(name, replies[c], options, image);
    const std::string of = options.image.colour ? "." + name : "";
    image.attributes[attribute::kSigmaT + of] = material.sigma_t;
    image.attributes[attribute::kAlbedo + of] = material.albedo;
    if (options.phase.empty()) image.attributes[attribute::kG + of] = material.g;
  }
  return image;
}

// For people to look at. White is what is on the object, so that a lamp in view does not make all
// else black; where there is no object, what is in the image.
void write_preview(const RenderFlags& options, const Image& image,
                   const std::vector<ImageChannel>& channels) {
  std::vector<float> all, on_object;
  const std::vector<float>& mask = image.channel("mask.Y");
  for (const ImageChannel& channel : channels) {
    const std::vector<float>& radiance = image.channel(channel.name);
    all.insert(all.end(), radiance.begin(), radiance.end());
    for (size_t p = 0; p < mask.size(); ++p) {
      if (mask[p] > 0.5F) on_object.push_back(radiance[p]);
    }
  }
  const float white = white_level(on_object.empty() ? all : on_object) /
                      static_cast<float>(std::exp2(options.picture_exposure));
  const size_t pixels = all.size() / channels.size();
  std::vector<unsigned char> rgb;
  for (size_t p = 0; p < pixels; ++p) {
    for (size_t c = 0; c < 3; ++c) {
      rgb.push_back(to_srgb_byte(all[std::min(c, channels.size() - 1) * pixels + p] / white));
    }
    if (options.alpha) rgb.push_back(to_byte(mask[p]));
  }
  write_png(options.png, image.width, image.height, rgb);
}

// ---- The result on stdout --------------------------------------------------------------------

// What of the object is outside of the film is not in the image.
bool leaves_film(const Image& image) {
  const std::vector<float>& mask = image.channel("mask.Y");
  for (int y = 0; y < image.height; ++y) {
    const bool whole_row = y == 0 || y == image.height - 1;
    for (int x = 0; x < image.width; x += whole_row ? 1 : std::max(1, image.width - 1)) {
      if (mask[static_cast<size_t>(y) * image.width + x] > 0) return true;
    }
  }
  return false;
}

// The sides of the object as it lies in the scene, in mm.
std::string size_of_object(const v1::Scene& scene) {
  const Bounds box = bounds_of_object(scene);
  const Vec3f size = box.max - box.min;
  return fmt::format("{:.3g} x {:.3g} x {:.3g} mm", size.x, size.y, size.z);
}

double noise_of(const Image& image, const std::string& channel) {
  return noise_on_object(image.channel(channel), image.channel("stderr." + channel),
                         image.channel("mask.Y"));
}

// One sample of a pixel says nothing of its noise, nor does an image without light.
bool knows_noise(const Image& image, const std::string& channel, const RenderFlags& options) {
  const std::vector<float>& radiance = image.channel(channel);
  return options.image.spp > 1 && std::ranges::any_of(radiance, [](float v) { return v > 0; });
}
std::string noise_text(double noise, bool is_known) {
  return is_known ? fmt::format("{:.2g} %", 100 * noise) : "unknown";
}

double mean_over_object(const Image& image, const std::string& channel) {
  const std::vector<float>& radiance = image.channel(channel);
  const std::vector<float>& mask = image.channel("mask.Y");
  double sum = 0;
  double weight = 0;
  for (size_t i = 0; i < radiance.size(); ++i) {
    sum += mask[i] * radiance[i];
    weight += mask[i];
  }
  return weight > 0 ? sum / weight : 0;
}

void print_json(const v1::Counters& counters, const RenderFlags& options,
                const std::vector<ImageChannel>& channels, const Image& image, double seconds) {
  google::protobuf::Struct result;
  auto& fields = *result.mutable_fields();
  const auto number = [&](const char* name, auto value) {
    fields[name].set_number_value(static_cast<double>(value));
  };
  fields["output"].set_string_value(options.output);
  number("width", image.width);
  number("height", image.height);
  number("spp", options.image.spp);
  number("object_coverage", coverage(image.channel("mask.Y")));
  for (const auto& [name, shown, material] : channels) {
    const std::string suffix = options.image.colour ? "_" + lower(name) : "";
    number(("mean_radiance_on_object" + suffix).c_str(), mean_over_object(image, name));
    if (knows_noise(image, name, options)) {
      number(("noise_on_object" + suffix).c_str(), noise_of(image, name));
    }
  }
  number("paths", counters.paths());
  number("steps", counters.steps());
  number("invalid_samples", counters.invalid_samples());
  number("leaks", counters.leaks());
  number("cpu_seconds", counters.cpu_seconds());
  number("seconds", seconds);
  print_result("{}\n", to_json(result));
}

void print_text(const RenderFlags& options, const v1::Scene& scene,
                const std::vector<ImageChannel>& channels, const Image& image, double seconds) {
  std::string text = fmt::format("{}: {} x {} pixels, {} samples per pixel, {:.3g} s\n",
                                 name_of_output(options.output), image.width, image.height,
                                 options.image.spp, seconds) +
                     fmt::format("object: {}, {:.2g} % of the film{}\n", size_of_object(scene),
                                 100 * coverage(image.channel("mask.Y")),
                                 leaves_film(image) ? ", cut by its edge" : "");
  if (!options.image.medium.empty()) {
    const MeasuredMedium& medium = measured_medium(options.image.medium);
    text += fmt::format("{} ({}), index {}\n", medium.name, medium.source, medium.index);
  }
  for (const auto& [name, shown, material] : channels) {
    text += fmt::format(
        "{}: sigma_t {:.4g} / mm, albedo {:.5g}{}; mean radiance on the object {:.6g}, noise {}\n",
        name, material.sigma_t, material.albedo,
        options.phase.empty() ? fmt::format(", g {:.3g}", material.g) : "",
        mean_over_object(image, name),
        noise_text(noise_of(image, name), knows_noise(image, name, options)));
  }
  print_result(text, is_stdout(options.output) ? stderr : stdout);
}

void run(RenderFlags options) {
  const auto start = std::chrono::steady_clock::now();
  read_words(options);
  check_combinations(options);
  check_outputs(options);
  v1::Scene scene = load_scene(options.scene, options.mesh_unit);
  take_medium(scene, options);
  if (!options.film.empty()) set_film(options.film, *scene.mutable_film());
  options.image.colour |= scene.film().channel() == v1::Film::RGB;
  const std::vector<ImageChannel> channels = channels_of(options.image, scene);
  const std::vector<RenderJob> jobs = jobs_of(options.image, scene, channels);
  auto [replies, spp, interrupted] = render(options, jobs, start);
  options.image.spp = spp;
  const v1::Counters counters = sum_of_counters(replies);
  const std::vector<v1::RenderGradReply> in_channels = replies_of(channels, std::move(replies));
  const Image image = make_image(channels, jobs[0], in_channels, counters, options);
  for (const std::string& remark :
       remarks_on(channels, in_channels, counters, goal_of(options), spp)) {
    spdlog::warn(remark);
  }
  write_exr(options.output, image);
  if (!options.png.empty()) write_preview(options, image, channels);
  if (interrupted) {
    throw Error(ErrorKind::kCancelled,
                fmt::format("interrupted; {} has the {} samples per pixel that were done",
                            options.output, options.image.spp));
  }
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
  if (options.json) {
    print_json(counters, options, channels, image, elapsed.count());
  } else {
    print_text(options, scene, channels, image, elapsed.count());
  }
}

}  // namespace

void add_render_command(CLI::App& app) {
  const auto options = std::make_shared<RenderFlags>();
  CLI::App* command = app.add_subcommand("render", "Render a scene and its derivatives to an EXR");
  command
      ->add_option("scene", options->scene,
                   "Scene file (text format of itn.v1.Scene); -: standard input")
      ->required();
  add_mesh_unit_flag(*command, options->mesh_unit);
  command->add_option("-o,--output", options->output, "EXR file to write; -: standard output")
      ->required();
  const auto add_coefficient = [&](const char* flag, std::vector<double>& numbers,
                                   const char* description) {
    return command
        ->add_option(
            flag, numbers,
            fmt::format("{}; or three, of R, G and B, separated by commas, for an image in "
                        "colour",
                        description))
        ->delimiter(',')
        ->allow_extra_args(false);
  };
  add_coefficient("--sigma-t", options->image.sigma_t, "Extinction coefficient, in 1/mm")
      ->check(number_in(kMinSigmaT, kMaxSigmaT));
  add_coefficient("--albedo", options->image.albedo, "Single-scattering albedo")
      ->check(number_in(0.0, 1.0));
  CLI::Option* g = add_coefficient("--g", options->image.g, "Mean cosine of scattering")
                       ->check(number_in(-kMaxAbsG, kMaxAbsG))
                       ->default_str("0");
  command->add_flag("--color,--colour", options->image.colour,
                    "Channels R, G and B instead of Y: of coloured lights, and with --material of "
                    "the medium. One render, whose paths the channels share, where that costs "
                    "less than three");
  command
      ->add_option("--phase", options->phase,
                   "Phase function instead of Henyey and Greenstein's with --g, text format of "
                   "itn.v1.PhaseFunction: 'two_term { g_1: 0.8 g_2: -0.3 weight: 0.9 }'")
      ->excludes(g);
  CLI::Option* material =
      command
          ->add_option(
              "--material", options->image.medium,
              "Instead of --sigma-t, --albedo and --g, a measured medium (itn materials), "
              "in the film's channel; for LUMINANCE, in GREEN. Default: that of the scene's "
              "object, if it has one")
          ->excludes("--sigma-t", "--albedo", "--g", "--phase");
  command
      ->add_option("--object-size", options->image.object_size,
                   "With --material, the longest side of what the object stands for, in mm. "
                   "Default: the object's own")
      ->check(number_in(1e-6, 1e6))
      ->needs(material);
  command
      ->add_option("--spp", options->image.spp,
                   "Samples per pixel; with --noise or --time, the most, and 1048576 if absent")
      ->check(kSppRange)
      ->capture_default_str();
  command
      ->add_option("--noise", options->noise,
                   "Render until the noise on the object is this part of its mean radiance, as 1% "
                   "or 0.01: the root mean square of the standard errors of its pixels")
      ->transform(kPercentToPart)
      ->check(number_in(1e-4, 1.0));
  command
      ->add_option("--time", options->seconds,
                   "Render for about so long, as 10s, 2m or 1h, compiling the scene included")
      ->transform(kTimeToSeconds)
      ->check(number_in(0.01, 1e6));
  command->add_option("--seed", options->image.seed, "Of the random numbers")
      ->check(kAnySeed)
      ->capture_default_str();
  command
      ->add_option("--derivatives", options->image.derivatives,
                   fmt::format("Layers to add, separated by commas: {} (K-th of the scene file, "
                               "from 0; the scale of a light is 1 unless --set says otherwise)",
                               fmt::join(derivative_names(), ", ")))
      ->check(CLI::Validator(
          [](std::string& name) -> std::string {
            try {
              is_of_medium(name);
            } catch (const Error& error) {
              return error.what();
            }
            return "";
          },
          ""))
      ->delimiter(',')
      ->allow_extra_args(false);
  command
      ->add_option_function<std::vector<std::string>>(
          "--set",
          [options](const std::vector<std::string>& texts) {
            for (const std::string& text : texts)
              options->image.values.push_back(named_value(text));
          },
          "NAME=VALUE: a number of the scene instead of that in its file, by the name of its "
          "derivative, as light[0].scale=2 or rough_dielectric.index=1.4; none of the medium, "
          "which --sigma-t and so on set. May be repeated")
      ->allow_extra_args(false);
  command
      ->add_option("--estimates", options->image.estimates,
                   "Independent estimates, as further layers")
      ->check(number_in(1U, kMaxEstimates))
      ->capture_default_str();
  command
      ->add_option(
          "--pilot-spp", options->image.pilot_spp,
          "Samples per pixel, beyond --spp, of a pilot, which spreads the others and quietens "
          "derivatives in sigma_t and g; not with --tracer reference")
      ->check(number_in(0U, kMaxPilotSpp))
      ->capture_default_str();
  command
      ->add_option("--pixels", options->pixels, "Render all pixels, or those that see the object")
      ->check(one_of({"all", "object"}))
      ->capture_default_str();
  command
      ->add_option("--tracer", options->tracer,
                   "wavefront: the fast one; reference: plain path tracing, to check it against")
      ->check(one_of({"wavefront", "reference"}))
      ->capture_default_str();
  command->add_option("--resolution,--film", options->film,
                      "N or WIDTHxHEIGHT in pixels, instead of the scene's");
  CLI::Option* const picture = command->add_option(
      "--picture,--png", options->png,
      "Also write a picture to look at: sRGB, white at the 99th percentile on the object");
  command
      ->add_option("--picture-exposure", options->picture_exposure,
                   "Stops by which the picture is brighter; the EXR stays as it is")
      ->check(number_in(-20.0, 20.0))
      ->needs(picture)
      ->capture_default_str();
  command->add_flag("--alpha", options->alpha,
                    "Add how much of each pixel the objects cover: as channel A of the EXR, whose "
                    "radiance is not multiplied by it, and as the transparency of --picture");
  add_format_flags(*command, options->json, "of its size, means, counters and times");
  add_worker_flags(*command, options->workers);
  command->callback([command, options] {
    if (options->noise + options->seconds > 0 && command->count("--spp") == 0) {
      options->image.spp = kMaxSamples;
    }
    for (const auto& [flag, numbers] :
         {std::pair{"--sigma-t", &options->image.sigma_t},
          std::pair{"--albedo", &options->image.albedo}, std::pair{"--g", &options->image.g}}) {
      require_usage(
          numbers->size() <= 1 || numbers->size() == 3,
          fmt::format("{}: {} numbers; it takes one, or those of R, G and B (decimals take "
                      "a point)",
                      flag, numbers->size()));
      options->image.colour |= numbers->size() == 3;
    }
    run(*options);
  });
}

}  // namespace itn
