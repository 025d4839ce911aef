// itn render: an image of a scene and its derivatives, as layers of an EXR file.
#include <fmt/format.h>
#include <google/protobuf/struct.pb.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <numeric>
#include <string>
#include <vector>

#include "client/commands/command.h"
#include "client/commands/options.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/render_pool/render_pool.h"
#include "client/render_pool/reply_images.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/flags.h"
#include "common/image/attributes.h"
#include "common/image/image.h"
#include "common/image/preview.h"
#include "common/material.h"
#include "common/measured_media.h"
#include "common/progress.h"
#include "common/rpc/wire_array.h"
#include "common/scene/material_proto.h"
#include "common/scene/scene_file.h"
#include "common/scene/text_proto.h"
#include "server/scene_compiler/derivatives.h"
#include "server/scene_compiler/mesh_builder.h"

namespace itn {
namespace {

struct RenderFlags {
  std::string scene;
  std::optional<v1::LengthUnit> mesh_unit;
  std::string output;
  std::string png;
  std::string film;
  std::string material;    // a measured one; then sigma_t, albedo and g follow from it
  double object_size = 0;  // 0: as in the scene
  double sigma_t = 0, albedo = 0;
  std::optional<double> g;
  std::string phase;
  uint32_t spp = 64;
  uint64_t seed = 0;
  std::vector<std::string> derivatives;
  uint32_t estimates = 1;
  uint32_t pilot_spp = 0;
  std::string pixels = "all";
  std::string tracer = "wavefront";
  WorkerFlags workers;
  bool json = false;
};

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return text;
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
  require_usage(options.tracer != "reference" || options.pilot_spp == 0,
                fmt::format("--tracer reference and --pilot-spp {}: the reference has no pilot; "
                            "leave out one of the two",
                            options.pilot_spp));
  require_usage(options.estimates <= options.spp,
                fmt::format("--estimates {} and --spp {}: each estimate needs a sample per pixel; "
                            "take at most as many estimates",
                            options.estimates, options.spp));
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

// The channel of a measured medium that a film shows. Luminance is mostly green.
size_t channel_of(const v1::Film& film) {
  return film.channel() == v1::Film::RED ? 0 : film.channel() == v1::Film::BLUE ? 2 : 1;
}

void set_measured(const v1::Scene& scene, RenderFlags& options) {
  Material material = measured_medium(options.material).material(channel_of(scene.film()));
  if (options.object_size > 0) {
    const Bounds box = object_bounds(scene);
    const Vec3f size = box.max - box.min;
    material.sigma_t *= options.object_size / double{std::max({size.x, size.y, size.z})};
  }
  options.sigma_t = material.sigma_t;
  options.albedo = material.albedo;
  options.g = material.g;
}

RenderJob make_job(RenderFlags& options) {
  v1::Scene scene = load_scene(options.scene, options.mesh_unit);
  if (!options.material.empty()) set_measured(scene, options);
  if (!options.film.empty()) set_film(options.film, *scene.mutable_film());
  RenderJob job;
  job.scene = serialize(scene);
  *job.request.mutable_material() =
      to_proto(Material{options.sigma_t, options.albedo, options.g.value_or(0)});
  if (!options.phase.empty()) {
    parse_text_proto(options.phase, "--phase", *job.request.mutable_phase());
  }
  job.request.set_spp(options.spp);
  job.request.set_seed(options.seed);
  job.request.set_estimates(options.estimates);
  job.request.set_pilot_spp(options.pilot_spp);
  job.request.set_pixels(options.pixels == "object" ? v1::OBJECT_PIXELS : v1::ALL_PIXELS);
  job.request.set_tracer(options.tracer == "reference" ? v1::REFERENCE : v1::WAVEFRONT);
  for (const std::string& name : options.derivatives) job.request.add_parameters(name);
  return job;
}

v1::RenderGradReply render(const RenderFlags& options, const RenderJob& job) {
  RenderPool pool(options.workers.pool_options());
  Progress progress("rendering", "samples per pixel", options.spp);
  auto reply = pool.render_split(job, [&](double fraction) {
    throw_if_interrupted();
    progress.update(static_cast<uint64_t>(fraction * options.spp));
  });
  progress.finish();
  return reply;
}

// ---- The file --------------------------------------------------------------------------------

void add_channels(const v1::RenderGradReply& reply, const RenderFlags& options, Image& image) {
  image.channels["Y"] = mean_radiance(reply, options.spp);
  const std::vector<std::string>& derivatives = options.derivatives;
  for (size_t d = 0; d < derivatives.size(); ++d) {
    const auto derivative = [d](const v1::Estimate& e) -> const std::string& {
      return e.derivatives(static_cast<int>(d));
    };
    image.channels[derivatives[d] + ".Y"] = mean_of_estimates(reply, options.spp, derivative);
    if (reply.estimates_size() == 1) continue;
    image.channels["stderr." + derivatives[d] + ".Y"] =
        standard_error_of_estimates(reply, derivative);
  }
  image.channels["mask.Y"] = from_bytes<float>(reply.mask());
  image.channels["stderr.Y"] = from_bytes<float>(reply.standard_error());
  if (reply.estimates_size() == 1) return;
  for (int k = 0; k < reply.estimates_size(); ++k) {
    const v1::Estimate& estimate = reply.estimates(k);
    image.channels[fmt::format("estimate{}.Y", k)] = from_bytes<float>(estimate.radiance());
    for (size_t d = 0; d < derivatives.size(); ++d) {
      image.channels[estimate_channel(k, derivatives[d])] =
          from_bytes<float>(estimate.derivatives(static_cast<int>(d)));
    }
  }
}

Image make_image(const v1::RenderGradReply& reply, const RenderFlags& options,
                 const RenderJob& job) {
  Image image;
  image.width = static_cast<int>(reply.width());
  image.height = static_cast<int>(reply.height());
  add_channels(reply, options, image);
  const v1::Counters& counters = reply.counters();
  const auto count = [](uint64_t value) { return static_cast<double>(value); };
  image.attributes = {
      {attribute::kVersion, ITN_VERSION},
      {attribute::kSceneSha256, to_hex(job.scene->digest)},
      {attribute::kSigmaT, options.sigma_t},
      {attribute::kAlbedo, options.albedo},
      {attribute::kSpp, static_cast<int>(options.spp)},
      {attribute::kSeed, std::to_string(options.seed)},
      {attribute::kEstimates, static_cast<int>(options.estimates)},
      {attribute::kPilotSpp, static_cast<int>(options.pilot_spp)},
      {attribute::kPixels, options.pixels},
      {attribute::kTracer, options.tracer},
      {attribute::kPaths, count(counters.paths())},
      {attribute::kSteps, count(counters.steps())},
      {attribute::kInvalidSamples, count(counters.invalid_samples())},
      {attribute::kLeaks, count(counters.leaks())},
  };
  if (options.phase.empty()) {
    image.attributes[attribute::kG] = options.g.value_or(0);
  } else {
    image.attributes[attribute::kPhase] = options.phase;
  }
  return image;
}

// For people to look at.
void write_preview(const std::filesystem::path& path, const Image& image) {
  const std::vector<float>& radiance = image.channel("Y");
  const float white = white_level(radiance);
  std::vector<unsigned char> rgb;
  for (const float value : radiance) rgb.insert(rgb.end(), 3, to_srgb_byte(value / white));
  write_png(path, image.width, image.height, rgb);
}

// ---- The result on stdout --------------------------------------------------------------------

// The part of the image's pixels that the object covers.
double coverage(const Image& image) {
  const std::vector<float>& mask = image.channel("mask.Y");
  return std::accumulate(mask.begin(), mask.end(), 0.0) / static_cast<double>(mask.size());
}

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

// As it lies in the scene, in mm.
std::string size_of_object(const RenderJob& job) {
  v1::Scene scene;
  scene.ParseFromString(job.scene->bytes);
  const Bounds box = object_bounds(scene);
  const Vec3f size = box.max - box.min;
  return fmt::format("{:.3g} x {:.3g} x {:.3g} mm", size.x, size.y, size.z);
}

void warn_small_object(const Image& image) {
  constexpr double kTiny = 1e-3;
  const double covered = coverage(image);
  const double pixels = static_cast<double>(image.width) * image.height;
  if (covered >= kTiny && covered * pixels >= 1) return;
  const std::string how = covered == 0 ? "the camera does not see the object: it is in no pixel"
                                       : fmt::format(
                                             "the camera hardly sees the object: it covers "
                                             "{:.2g} of {} pixels",
                                             covered * pixels, pixels);
  spdlog::warn("{}. Is it at the camera's target, and of the size that is meant, in mm?", how);
}

double mean_over_object(const Image& image) {
  const std::vector<float>& radiance = image.channel("Y");
  const std::vector<float>& mask = image.channel("mask.Y");
  double sum = 0;
  double weight = 0;
  for (size_t i = 0; i < radiance.size(); ++i) {
    sum += mask[i] * radiance[i];
    weight += mask[i];
  }
  return weight > 0 ? sum / weight : 0;
}

void print_json(const v1::RenderGradReply& reply, const RenderFlags& options, const Image& image,
                double seconds) {
  const v1::Counters& counters = reply.counters();
  google::protobuf::Struct result;
  auto& fields = *result.mutable_fields();
  const auto number = [&](const char* name, auto value) {
    fields[name].set_number_value(static_cast<double>(value));
  };
  fields["output"].set_string_value(options.output);
  number("width", reply.width());
  number("height", reply.height());
  number("spp", options.spp);
  number("object_coverage", coverage(image));
  number("mean_radiance_on_object", mean_over_object(image));
  number("paths", counters.paths());
  number("steps", counters.steps());
  number("invalid_samples", counters.invalid_samples());
  number("leaks", counters.leaks());
  number("cpu_seconds", counters.cpu_seconds());
  number("seconds", seconds);
  print_result("{}\n", to_json(result));
}

void print_text(const v1::RenderGradReply& reply, const RenderFlags& options, const RenderJob& job,
                const Image& image, double seconds) {
  const v1::Counters& counters = reply.counters();
  std::string text =
      fmt::format("{}: {} x {} pixels, {} samples per pixel, {:.3g} s\n",
                  name_of_output(options.output), reply.width(), reply.height(), options.spp,
                  seconds) +
      fmt::format("object: {}, {:.2g} % of the film{}\n", size_of_object(job),
                  100 * coverage(image), leaves_film(image) ? ", cut by its edge" : "") +
      fmt::format("mean radiance on the object: {:.6g}\n", mean_over_object(image));
  if (!options.material.empty()) {
    const MeasuredMedium& medium = measured_medium(options.material);
    text += fmt::format("{} ({}), index {}: here sigma_t {:.4g} / mm, albedo {:.5g}, g {:.3g}\n",
                        medium.name, medium.source, medium.index, options.sigma_t, options.albedo,
                        *options.g);
  }
  if (counters.invalid_samples() > 0 || counters.leaks() > 0) {
    text += fmt::format("dropped: {} invalid samples, {} leaks of {} paths\n",
                        counters.invalid_samples(), counters.leaks(), counters.paths());
  }
  print_result(text, is_stdout(options.output) ? stderr : stdout);
}

void run(RenderFlags options) {
  const auto start = std::chrono::steady_clock::now();
  check_combinations(options);
  check_outputs(options);
  const RenderJob job = make_job(options);
  const v1::RenderGradReply reply = render(options, job);
  const Image image = make_image(reply, options, job);
  warn_small_object(image);
  write_exr(options.output, image);
  if (!options.png.empty()) write_preview(options.png, image);
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
  options.json ? print_json(reply, options, image, elapsed.count())
               : print_text(reply, options, job, image, elapsed.count());
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
  command->add_option("--sigma-t", options->sigma_t, "Extinction coefficient, in 1/mm")
      ->check(number_in(kMinSigmaT, kMaxSigmaT));
  command->add_option("--albedo", options->albedo, "Single-scattering albedo")
      ->check(number_in(0.0, 1.0));
  CLI::Option* g = command->add_option("--g", options->g, "Mean cosine of scattering")
                       ->check(number_in(-kMaxAbsG, kMaxAbsG))
                       ->default_str("0");
  command
      ->add_option("--phase", options->phase,
                   "Phase function instead of Henyey and Greenstein's with --g, text format of "
                   "itn.v1.PhaseFunction: 'two_term { g_1: 0.8 g_2: -0.3 weight: 0.9 }'")
      ->excludes(g);
  CLI::Option* material =
      command
          ->add_option("--material", options->material,
                       "Instead of --sigma-t, --albedo and --g, a measured medium (itn materials), "
                       "in the film's channel; for LUMINANCE, in GREEN")
          ->excludes("--sigma-t", "--albedo", "--g", "--phase");
  command
      ->add_option("--object-size", options->object_size,
                   "With --material, the longest side of what the object stands for, in mm. "
                   "Default: the object's own")
      ->check(number_in(1e-6, 1e6))
      ->needs(material);
  command->add_option("--spp", options->spp, "Samples per pixel")
      ->check(kSppRange)
      ->capture_default_str();
  command->add_option("--seed", options->seed, "Of the random numbers")
      ->check(kAnySeed)
      ->capture_default_str();
  command
      ->add_option("--derivatives", options->derivatives,
                   fmt::format("Layers to add, separated by commas: {} (K-th of the scene file, "
                               "from 0; the scale of a light is 1)",
                               fmt::join(parameter_names(), ", ")))
      ->check(CLI::Validator(
          [](std::string& name) -> std::string {
            try {
              parameter_of(name);
            } catch (const Error& error) {
              return error.what();
            }
            return "";
          },
          ""))
      ->delimiter(',')
      ->allow_extra_args(false);
  command->add_option("--estimates", options->estimates, "Independent estimates, as further layers")
      ->check(number_in(1U, 16U))
      ->capture_default_str();
  command
      ->add_option(
          "--pilot-spp", options->pilot_spp,
          "Samples per pixel, beyond --spp, of a pilot, which spreads the others and quietens "
          "derivatives in sigma_t and g; not with --tracer reference")
      ->check(number_in(0U, 64U))
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
  command->add_option("--picture,--png", options->png, "Also write a picture to look at");
  add_format_flags(*command, options->json, "of its size, means, counters and times");
  add_worker_flags(*command, options->workers);
  command->callback([command, options] {
    const bool has_coefficients = command->count("--sigma-t") > 0 && command->count("--albedo") > 0;
    require_usage(has_coefficients || !options->material.empty(),
                  "--sigma-t and --albedo are required, or --material");
    run(*options);
  });
}

}  // namespace itn
