// itn refine: the material of an object of known shape in known light, by analysis by synthesis.
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/commands/refine.h"
#include "client/files/folder_lock.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/object_media.h"
#include "client/output.h"
#include "client/predict/photograph_input.h"
#include "client/predict/predictors.h"
#include "client/progress.h"
#include "client/refine/coordinates.h"
#include "client/refine/refine_run.h"
#include "client/render_pool/render_pool.h"
#include "client/scene/scene_file.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/image/photograph.h"
#include "common/learning/model_files.h"
#include "common/luminance.h"
#include "common/random.h"
#include "common/rpc/status.h"
#include "common/scene/material_proto.h"
#include "common/scene/mesh_builder.h"
#include "server/renderer.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

Error usage(const std::string& message) {
  return Error(ErrorKind::kUsage, message);
}

// ---- Images and their scenes -----------------------------------------------------------------

// Whether a colour differs from gray by more than this part.
bool has_colours(const Image& image, const std::vector<std::string>& channels) {
  constexpr float kGray = 0.01F;
  if (channels.size() != 3) return false;
  const auto &r = image.channel(channels[0]), &g = image.channel(channels[1]),
             &b = image.channel(channels[2]);
  for (size_t p = 0; p < r.size(); ++p) {
    const auto [least, most] = std::minmax({r[p], g[p], b[p]});
    if (most - least > kGray * most) return true;
  }
  return false;
}

// The colours of a film, one by one.
std::vector<v1::Film::Channel> channels_of(const v1::Film& film) {
  if (film.channel() != v1::Film::RGB) return {film.channel()};
  return {kColours.begin(), kColours.end()};
}

// What the image shows in each colour of the film.
std::vector<Observation> load_observations(const std::string& name, const v1::Scene& scene,
                                           const RefineOptions& options) {
  PhotographContent content = read_content(name, options.reading);
  const Image& image = content.file.image;
  const v1::Film& film = scene.film();
  std::vector<float> mask;
  if (!options.mask.empty()) {
    mask = read_mask_for(content, name, options.mask);
  } else if (image.has("mask.Y")) {
    mask = image.channel("mask.Y");
  }
  average_to_film(name, scene, content, mask);
  if (content.file.may_be_linear) {
    throw invalid_input(fmt::format(
        "{} holds 16-bit integers and does not say how they are encoded; --encoding linear or "
        "--encoding srgb says so",
        name));
  }
  if (film.channel() == v1::Film::RGB && content.channels.size() != 3) {
    throw invalid_input(fmt::format(
        "{} has no colours, and the film of its scene is RGB; film {{ channel: LUMINANCE }} is "
        "right",
        name));
  }
  if (content.file.encoded && !options.settings.unknown_exposure()) {
    spdlog::warn(
        "{} is encoded for a screen, by an exposure that nobody knows; --exposure unknown finds it",
        name);
  }
  if (film.channel() == v1::Film::LUMINANCE && has_colours(image, content.channels)) {
    spdlog::warn(
        "{} has colours, and the film of its scene is LUMINANCE: the answer is one material for "
        "all of them, which may fit none; film {{ channel: RGB }} fits each",
        name);
  }
  leave_out_clipped(name, content.file.clipped, mask);
  std::vector<Observation> observations;
  for (const v1::Film::Channel channel : channels_of(film)) {
    v1::Scene in_channel = scene;
    in_channel.mutable_film()->set_channel(channel);
    Observation& observation = observations.emplace_back(
        Observation{.name = name,
                    .radiance = radiance_of(image, content.channels, channel),
                    .mask = mask,
                    .noise = {},
                    .scene = serialize(in_channel),
                    .colour = observations.size()});
    const std::string noise =
        "stderr." + (film.channel() == v1::Film::RGB ? content.channels[observation.colour] : "Y");
    if (image.has(noise)) observation.noise = image.channel(noise);
    const std::string colour = film.channel() == v1::Film::RGB ? kRgb.at(observation.colour) : "";
    for (size_t d = 0; image.has(disturbance_name(d, colour)); ++d) {
      observation.disturbances.push_back(image.channel(disturbance_name(d, colour)));
    }
    validate(observation);
  }
  return observations;
}

// Gives the disturbances of each image coordinates of their own.
void tell_disturbances_apart(std::vector<Observation>& observations) {
  size_t first = 0;
  for (size_t i = 0; i < observations.size(); ++i) {
    std::vector<std::vector<float>>& own = observations[i].disturbances;
    const size_t count = own.size();
    own.insert(own.begin(), first, {});
    const bool is_last_of_image =
        i + 1 == observations.size() || observations[i + 1].colour <= observations[i].colour;
    if (is_last_of_image) first += count;
  }
  for (Observation& observation : observations) observation.disturbances.resize(first);
}

// ---- Where to start --------------------------------------------------------------------------

Material parsed_material(const std::string& text) {
  std::array<double, 3> numbers{};
  const char* rest = text.c_str();
  for (size_t i = 0; i < 3; ++i) {
    char* end = nullptr;
    numbers[i] = std::strtod(rest, &end);
    if (end == rest || *end != (i < 2 ? ',' : '\0')) {
      throw usage(fmt::format(
          "--init: {} is neither network, nor mean, nor SIGMA_T,ALBEDO,G, such as 60,0.8,0.3",
          text));
    }
    rest = end + 1;
  }
  const Material material{numbers[0], numbers[1], numbers[2]};
  const auto in = [](double value, double min, double max) { return min <= value && value <= max; };
  if (!in(material.sigma_t, kMinRefinedSigmaT, kMaxRefinedSigmaT) || !in(material.albedo, 0, 1) ||
      !in(material.g, -kMaxAbsG, kMaxAbsG)) {
    throw usage(fmt::format(
        "--init: of {}, sigma_t must be in [{}, {}], the albedo in [0, 1], g in [-{}, {}]", text,
        kMinRefinedSigmaT, kMaxRefinedSigmaT, kMaxAbsG, kMaxAbsG));
  }
  return material;
}

// What a network sees in the images; of colours what is nearest to the films'.
Material network_guess(const RefineOptions& options, const std::vector<v1::Scene>& scenes) {
  std::vector<PredictInput> inputs;
  for (size_t i = 0; i < options.images.size(); ++i) {
    PhotographOptions photograph;
    photograph.reading = options.reading;
    photograph.mask = options.mask;
    photograph.object_size = longest_side(object_bounds("scene.object", scenes[i].object()));
    if (!options.settings.unknown_exposure()) photograph.exposure = 1;
    inputs.push_back(load_photograph(options.images[i], photograph));
  }
  const Predict predict = predictor_here(find_model(options.model, kDefaultGrayModel));
  const bool several = inputs.size() > 1;
  const v1::PredictBatchReply reply = predict(inputs, several);
  for (const v1::PredictOutcome& outcome : reply.outcomes()) {
    if (outcome.code() != grpc::StatusCode::OK) {
      throw to_error({static_cast<grpc::StatusCode>(outcome.code()), outcome.message()}, "");
    }
  }
  const auto& materials =
      several ? reply.combined().materials() : reply.outcomes(0).reply().materials();
  const v1::Film::Channel channel = scenes[0].film().channel();
  // What all colours have in common begins in the middle of them.
  const bool is_one = channel == v1::Film::RED || channel == v1::Film::BLUE;
  const int chosen = materials.size() == 1 ? 0 : is_one ? channel - v1::Film::RED : 1;
  return from_proto(materials.at(chosen));
}

Material first_start(const RefineOptions& options, const std::vector<v1::Scene>& scenes) {
  if (options.init == "mean")
    return mean_of_size(longest_side(object_bounds("scene.object", scenes[0].object())));
  if (options.init != "network") return parsed_material(options.init);
  try {
    return network_guess(options, scenes);
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kCancelled) throw;
    throw Error(error.kind(), fmt::format("no network could say where to start ({}); --init mean "
                                          "or --init SIGMA_T,ALBEDO,G need none",
                                          error.what()));
  }
}

std::string origin_of(const RefineOptions& options) {
  const std::string model = options.init == "network" ? " " + options.model : "";
  return fmt::format("--init {} --starts {}{}", options.init, options.starts, model);
}

// ---- All of it -------------------------------------------------------------------------------

v1::RefineSettings settings_of(const RefineOptions& options) {
  const v1::RefineSettings settings = with_defaults(options.settings);
  if (settings.spp() > settings.max_spp()) {
    throw usage(fmt::format("--spp {} must not be more than --max-spp {}", settings.spp(),
                            settings.max_spp()));
  }
  return settings;
}

// Sets the boundary as the scene has it, or as it was found.
void set_boundary(const v1::Object& object, v1::RefineResult& result) {
  const auto surface = surface_of_medium("scene.object", object);
  if (!surface) return;
  result.set_index(surface->index);
  result.set_roughness(surface->roughness);
  for (const v1::RefinedParameter& found : result.unknowns()) {
    if (found.name() == "rough_dielectric.index") result.set_index(found.value());
    if (found.name() == "rough_dielectric.roughness") result.set_roughness(found.value());
  }
}

// "rough_dielectric.index" is "index", "position.x" stays.
std::string last_words(const std::string& name) {
  constexpr size_t kLetter = 1;
  size_t dot = name.rfind('.');
  if (dot != std::string::npos && name.size() - dot - 1 == kLetter) dot = name.rfind('.', dot - 1);
  return dot == std::string::npos ? name : name.substr(dot + 1);
}

std::string in_short(const v1::RefineIteration& iteration, const v1::RefineSettings& settings) {
  std::string sigma_t, albedo, unknowns;
  for (const v1::Material& material : iteration.materials()) {
    sigma_t += fmt::format(" {:.4g}", material.sigma_t());
    albedo += fmt::format(" {:.4f}", material.albedo());
  }
  for (int i = 0; i < iteration.unknowns_size(); ++i) {
    unknowns += fmt::format(" {} {:.4f}", last_words(settings.unknowns(i)), iteration.unknowns(i));
  }
  return fmt::format("sigma_t{} albedo{} g {:.4f}{}, loss {:.2g}, {} spp", sigma_t, albedo,
                     iteration.materials(0).g(), unknowns, iteration.loss(), iteration.spp());
}

std::vector<Render> render_fits(const Refinement& refinement,
                                std::span<const Observation> observations,
                                const Renderer& renderer) {
  constexpr uint32_t kPictureSpp = 256;
  std::vector<RenderQuery> queries;
  for (const Observation& observation : observations) {
    queries.push_back(refinement.query(observation, kPictureSpp, queries.size()));
  }
  std::vector<Render> fits = renderer(queries);
  for (size_t i = 0; i < fits.size(); ++i) {
    for (const uint32_t pixel : refinement.unexplained_pixels(i)) fits[i].mask[pixel] = 0;
  }
  return fits;
}

}  // namespace

std::vector<v1::Scene> load_scenes(const RefineOptions& options) {
  if (options.scenes.size() != 1 && options.scenes.size() != options.images.size()) {
    throw usage(fmt::format(
        "{} images and {} scenes: give --scene once for all of them, or once for each, in order",
        options.images.size(), options.scenes.size()));
  }
  std::vector<v1::Scene> scenes;
  for (const std::string& file : options.scenes) {
    scenes.push_back(load_scene(file, options.mesh_unit));
    if (options.channel) scenes.back().mutable_film()->set_channel(*options.channel);
    if (scenes.back().film().channel() != scenes.front().film().channel()) {
      throw invalid_input(fmt::format(
          "{} and {}: film.channel must be the same in both; RGB finds a material for each colour",
          options.scenes.front(), file));
    }
    resolve_media(scenes.back());
  }
  scenes.resize(options.images.size(), scenes.front());
  return scenes;
}

void average_to_film(const std::string& name, const v1::Scene& scene, PhotographContent& content,
                     std::vector<float>& mask) {
  Image& image = content.file.image;
  const v1::Film& film = scene.film();
  const auto columns = static_cast<int>(film.width()), rows = static_cast<int>(film.height());
  if (image.width == columns && image.height == rows) return;
  if (scene.camera().has_crop()) {
    throw invalid_input(fmt::format(
        "{} is {} x {} pixels, and its scene shows a part of the frame (camera.crop): an image of "
        "that part, of {} x {} pixels, would be right, such as the photograph.exr that itn fit "
        "writes beside its scene",
        name, image.width, image.height, columns, rows));
  }
  const double by = static_cast<double>(image.width) / columns;
  constexpr double kRounded = 0.5;  // of a pixel of the film
  if (columns < 1 || rows < 1 || image.width < columns || image.height < rows ||
      std::abs(image.height - by * rows) > kRounded * by) {
    throw invalid_input(fmt::format(
        "{} is {} x {} pixels, the film of its scene {} x {}; it must be as large, or larger and "
        "of the same shape",
        name, image.width, image.height, columns, rows));
  }
  const int width = image.width;
  const auto average = [&](const std::vector<float>& plane) {
    return averaged(plane, 1, width, columns, rows, interruption());
  };
  const double pixels = by * image.height / rows;
  for (auto& [channel, plane] : image.channels) {
    // Variances add up.
    const bool is_noise = channel.starts_with("stderr.");
    if (is_noise) std::ranges::transform(plane, plane.begin(), [](float v) { return v * v; });
    plane = average(plane);
    if (!is_noise) continue;
    std::ranges::transform(plane, plane.begin(), [&](float v) {
      return static_cast<float>(std::sqrt(double{v} / pixels));
    });
  }
  image.width = columns;
  image.height = rows;
  // What is clipped, or not of the object, in a part does not count.
  if (!mask.empty()) {
    mask = average(mask);
    std::ranges::transform(mask, mask.begin(),
                           [](float v) { return v >= kWholePixel ? 1.0F : 0.0F; });
  }
  std::vector<unsigned char>& clipped = content.file.clipped;
  if (clipped.empty()) return;
  const std::vector<float> parts = average({clipped.begin(), clipped.end()});
  clipped.resize(parts.size());
  std::ranges::transform(parts, clipped.begin(),
                         [](float v) { return static_cast<unsigned char>(v > kClippedPixel); });
}

void leave_out_clipped(const std::string& name, const std::vector<unsigned char>& clipped,
                       std::vector<float>& mask) {
  if (std::ranges::count(clipped, 1) == 0) return;
  if (mask.empty()) mask.assign(clipped.size(), 1);
  size_t left_out = 0, all = 0;
  for (size_t p = 0; p < clipped.size(); ++p) {
    if (!is_on_object(mask[p])) continue;
    ++all;
    if (clipped[p] == 0) continue;
    ++left_out;
    mask[p] = 0;
  }
  if (left_out > 0) {
    spdlog::warn("{}: {} of {} pixels are at the top of what the file can hold and do not count",
                 name, left_out, all);
  }
}

std::string disturbance_name(size_t which, const std::string& colour) {
  return fmt::format("disturbance.{}{}", colour, which);
}

std::vector<float> radiance_of(const Image& image, const std::vector<std::string>& names,
                               v1::Film::Channel channel) {
  if (names.size() == 1) return image.channel(names[0]);
  if (channel != v1::Film::LUMINANCE) {
    return image.channel(names[static_cast<size_t>(channel - v1::Film::RED)]);
  }
  std::vector<float> luminance(image.channel(names[0]).size());
  for (size_t c = 0; c < 3; ++c) {
    const std::vector<float>& plane = image.channel(names[c]);
    const auto weight = static_cast<float>(kLuminanceOfColours[c]);
    for (size_t p = 0; p < plane.size(); ++p) luminance[p] += weight * plane[p];
  }
  return luminance;
}

Material mean_of_size(double longest_side) {
  // The middle of the materials of Che et al. 2020: sigma_t 30 to 276 for an object whose longest
  // side is 1 mm, albedo .39 to .95, g 0 to .8.
  constexpr Material kMean{91, 0.67, 0.4};
  Material mean = kMean;
  mean.sigma_t = std::clamp(mean.sigma_t / longest_side, kMinRefinedSigmaT, kMaxRefinedSigmaT);
  return mean;
}

void check_init(const std::string& init) {
  if (init != "network" && init != "mean") parsed_material(init);
}

std::vector<v1::RefineResult> find_materials(const RefineOptions& options) {
  const v1::RefineSettings settings = settings_of(options);
  check_init(options.init);
  const std::vector<v1::Scene> scenes = load_scenes(options);
  std::vector<Observation> observations;
  for (size_t i = 0; i < scenes.size(); ++i) {
    for (Observation& observation : load_observations(options.images[i], scenes[i], options)) {
      const auto is_same = [&](const Observation& other) {
        return other.colour == observation.colour && other.radiance == observation.radiance;
      };
      const auto same = std::ranges::find_if(observations, is_same);
      if (same != observations.end()) {
        throw invalid_input(fmt::format(
            "{} and {} are the same photograph: it says nothing new, and would make the "
            "standard errors too small",
            same->name, observation.name));
      }
      observation.photograph = i;
      observations.push_back(std::move(observation));
    }
  }
  tell_disturbances_apart(observations);
  RenderPool pool(options.workers.pool_options());
  const Renderer renderer = rendered_by(pool, interruption());
  Progress progress("refining", "iterations", settings.max_iterations());
  const RefineRun refine_run{
      .folder = options.output,
      .origin = origin_of(options),
      .seconds_before = options.seconds_before,
      .starts = [&] { return starts_around(first_start(options, scenes), options.starts); },
      .report =
          [&](const v1::RefineIteration& i, size_t done) {
            const double limit = settings.time_limit();
            if (limit > 0) progress.end_within(limit - i.seconds());
            progress.update(done, in_short(i, settings));
          }};
  const Refinement refinement = refine(settings, observations, renderer, refine_run);
  std::vector<v1::RefineResult> results;
  for (size_t colour = 0; colour < refinement.colours(); ++colour) {
    set_boundary(scenes[0].object(), results.emplace_back(refinement.result(colour)));
  }
  if (!options.output.empty()) {
    write_outcome(options.output, results, observations,
                  render_fits(refinement, observations, renderer), refinement.exposure());
  }
  return results;
}

void run_refine(const RefineOptions& options) {
  std::optional<FolderLock> lock;
  if (!options.output.empty()) {
    check_folder_writable(options.output);
    lock.emplace(options.output, "refines a material");
    lock->remove_temporary_files();
  }
  const std::vector<v1::RefineResult> results = find_materials(options);
  if (results.size() == 1) {
    options.json ? print_result("{}\n", to_json(results[0])) : print_result(to_text(results[0]));
    return;
  }
  v1::FitResult of_colours;
  of_colours.mutable_results()->Add(results.begin(), results.end());
  options.json ? print_result("{}\n", to_json(of_colours)) : print_result(to_table(results));
}

}  // namespace itn
