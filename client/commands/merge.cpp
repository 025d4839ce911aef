// itn merge: photographs of one scene at several exposures, as one linear image.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/commands/merge.h"
#include "client/commands/options.h"
#include "client/image/attributes.h"
#include "client/image/exposure_merge.h"
#include "client/image/photograph_file.h"
#include "client/interrupt.h"
#include "client/output.h"
#include "common/error.h"
#include "common/files/atomic_file.h"

namespace itn {
namespace {

// Exposures that are closer are taken for one.
constexpr double kMinRatio = 1.1;

// What is known of a photograph before it is merged.
struct Bracketed {
  std::string name;
  PhotographFile taken;  // without its pixels
  double exposure = 0;
};

// How a setting of the camera changes the light from photograph to photograph, relative to the
// first: 1 unless all say what it was.
template <typename Setting>
std::vector<double> relative_light(const std::vector<Bracketed>& bracket, const Setting& setting) {
  std::vector<double> light;
  for (const Bracketed& photograph : bracket) {
    const std::optional<double> value = setting(photograph.taken);
    if (!value) return std::vector<double>(bracket.size(), 1);
    light.push_back(*value / setting(bracket.front().taken).value_or(*value));
  }
  return light;
}

double seconds_of(const MergeOptions& options, const std::vector<Bracketed>& bracket, size_t i) {
  if (!options.seconds.empty()) return options.seconds[i];
  if (const auto seconds = bracket[i].taken.exposure_seconds) return *seconds;
  throw invalid_input(fmt::format(
      "{} does not say for how long it was exposed: give the times of all, as --seconds 1/60,1/15",
      bracket[i].name));
}

// Seconds at the aperture and sensitivity of the first photograph.
void find_exposures(const MergeOptions& options, std::vector<Bracketed>& bracket) {
  const std::vector<double> sensitivity =
      relative_light(bracket, [](const PhotographFile& file) { return file.iso; });
  const std::vector<double> aperture =
      relative_light(bracket, [](const PhotographFile& file) -> std::optional<double> {
        if (!file.f_number) return std::nullopt;
        return 1 / (*file.f_number * *file.f_number);
      });
  for (size_t i = 0; i < bracket.size(); ++i) {
    bracket[i].exposure = seconds_of(options, bracket, i) * sensitivity[i] * aperture[i];
  }
  const auto [least, most] = std::ranges::minmax(bracket, {}, &Bracketed::exposure);
  if (most.exposure < kMinRatio * least.exposure) {
    throw invalid_input(fmt::format(
        "all photographs have an exposure of {:.4g} s: merging needs different ones, or --seconds "
        "where the files are wrong",
        least.exposure));
  }
}

PhotographFile read(const std::string& name, const MergeOptions& options) {
  throw_if_interrupted();
  return read_photograph(name, options.is_linear);
}

// Before the work: an EXR, and none of the photographs.
void check_output(const MergeOptions& options) {
  const std::string suffix = std::filesystem::path(options.output).extension().string();
  if (!suffix.empty() && suffix != ".exr") {
    throw Error(ErrorKind::kUsage,
                fmt::format("--output {}: it is written as OpenEXR, name it .exr", options.output));
  }
  require_no_input("--output", options.output, options.photographs);
  check_writable(options.output);
}

// Before the camera's response is looked for in them, which those of another size would hide.
void check_alike(const Bracketed& first, const PhotographFile& file, const std::string& name) {
  if (file.encoded != first.taken.encoded) {
    throw invalid_input(fmt::format("{} is linear, {} is not; all must be of one kind",
                                    file.encoded ? first.name : name,
                                    file.encoded ? name : first.name));
  }
  if (file.turned != first.taken.turned) {
    throw invalid_input(
        fmt::format("{} was turned upright, as its EXIF says, {} was not; all must be from one "
                    "camera that stood "
                    "still",
                    file.turned ? name : first.name, file.turned ? first.name : name));
  }
  if (file.image.width != first.taken.image.width ||
      file.image.height != first.taken.image.height) {
    throw invalid_input(
        fmt::format("{} has {} x {} pixels, {} has {} x {}; all must be of one size, from one "
                    "camera that stood still",
                    name, file.image.width, file.image.height, first.name, first.taken.image.width,
                    first.taken.image.height));
  }
}

}  // namespace

void run_merge(const MergeOptions& options) {
  const std::vector<std::string>& names = options.photographs;
  if (names.size() < 2) {
    throw Error(ErrorKind::kUsage, "merge: name two photographs at least, of different exposures");
  }
  if (std::ranges::find(names, "-") != names.end()) {
    throw Error(ErrorKind::kUsage, "merge: photographs are read twice, not from standard input");
  }
  if (!options.seconds.empty() && options.seconds.size() != names.size()) {
    throw Error(ErrorKind::kUsage, fmt::format("--seconds: {} times for {} photographs",
                                               options.seconds.size(), names.size()));
  }
  check_output(options);

  // What they are, and a sample of each.
  std::vector<Bracketed> bracket;
  std::vector<ExposureSample> samples;
  for (const std::string& name : names) {
    PhotographFile file = read(name, options);
    if (!bracket.empty()) check_alike(bracket.front(), file, name);
    warn_if_taken_for_srgb(file, name);
    if (file.encoded) samples.push_back(sample_exposure(file, 0, name));
    file.image.channels.clear();
    file.clipped = {};
    bracket.push_back({name, std::move(file), 0});
  }
  find_exposures(options, bracket);

  std::optional<Response> response;
  std::string response_name = "linear";
  if (bracket.front().taken.encoded) {
    response_name = options.response;
    for (size_t i = 0; i < samples.size(); ++i) samples[i].exposure = bracket[i].exposure;
    response = options.response == "srgb" ? srgb_response(samples.front().channels)
                                          : estimate_response(samples);
  }

  ExposureMerge merge(std::move(response));
  std::vector<double> exposures;
  for (const Bracketed& photograph : bracket) {
    merge.add(read(photograph.name, options), photograph.exposure, photograph.name);
    exposures.push_back(photograph.exposure);
  }
  for (const std::string& doubt : merge.doubts()) spdlog::warn("{}", doubt);
  Image image = merge.merged();
  if (const size_t clipped = merge.clipped_count(); clipped > 0) {
    spdlog::warn("{} of {} pixels are clipped in every photograph: a shorter exposure is missing",
                 clipped, static_cast<size_t>(image.width) * static_cast<size_t>(image.height));
  }
  image.attributes = {{attribute::kVersion, ITN_VERSION},
                      {attribute::kExposures, fmt::format("{:.6g}", fmt::join(exposures, ","))},
                      {attribute::kMergeMethod, "debevec"},
                      {attribute::kResponse, response_name}};
  write_exr(options.output, image);
  print_result(fmt::format("{}: {} photographs, exposures of {:.4g} to {:.4g} s; radiance per "
                           "second of exposure, relative\n",
                           options.output, bracket.size(), std::ranges::min(exposures),
                           std::ranges::max(exposures)),
               is_stdout(options.output) ? stderr : stdout);
}

}  // namespace itn
