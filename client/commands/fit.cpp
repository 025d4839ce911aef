// itn fit: finds where an object stands in a photograph, writes the scene, and refines its
// material.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/commands/fit.h"
#include "client/commands/fit_photograph.h"
#include "client/commands/fit_report.h"
#include "client/fit/disturbances.h"
#include "client/fit/pose_search.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/refine/refine_run.h"
#include "client/render_pool/render_pool.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/folder_lock.h"
#include "common/files/read_file.h"
#include "common/image/preview.h"
#include "common/rpc/wire_array.h"
#include "common/scene/material_proto.h"
#include "common/scene/scene_file.h"
#include "common/scene/text_proto.h"
#include "server/scene_compiler/mesh_builder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

// How far g may be from what it is taken for: that of nearly all that is translucent.
constexpr double kDoubtOfG = 0.4;
// The deviation of a g that is given.
constexpr double kAsGiven = 1e-4;

constexpr const char* kRoughness = "rough_dielectric.roughness";

// ---- The pose --------------------------------------------------------------------------------

// A few steps of a refinement of the luminance.
struct Scouting {
  double loss = 0;
  Material material;
};

Scouting scout(const FitPhotograph& photograph, const Mesh& mesh, const Pose& pose, v1::Scene scene,
               const FitOptions& options, uint32_t starts, const Synthesize& synthesize) {
  place(pose, mesh, options, scene);
  scene.mutable_film()->set_channel(v1::Film::LUMINANCE);
  const std::vector<Observation> observations{
      {.name = photograph.name,
       .radiance = radiance_of(photograph.image, photograph.channels, v1::Film::LUMINANCE),
       .mask = pixels_of_object(photograph, mesh, pose),
       .noise = {},
       .scene = serialize(scene)}};
  v1::RefineSettings settings;
  settings.set_unknown_exposure(true);
  if (options.photograph.gray_card && options.card_error > 0) {
    (*settings.mutable_known_within())[kExposure] = options.card_error;
  }
  settings.add_unknowns(kRoughness);
  settings.set_spp(32);
  settings.set_max_spp(64);
  settings.set_max_iterations(8);
  settings.set_seed(options.refine.seed);
  settings = with_defaults(settings);
  Refinement refinement(settings, observations,
                        starts_around(mean_of_size(longest_side(bounds(mesh))), starts));
  while (!refinement.finished()) refinement.step(synthesize);
  return {refinement.result().loss(), refinement.material()};
}

// Of another g: the material that looks about alike.
Material of_similar_light(const Material& material, double g) {
  const double sigma_s = material.sigma_s_reduced() / (1 - g);
  const double sigma_t = sigma_s + material.sigma_a();
  return {std::clamp(sigma_t, kMinRefinedSigmaT, kMaxRefinedSigmaT), sigma_s / sigma_t, g};
}

struct ChosenPose {
  FoundPose found;
  size_t alike = 1;  // that the silhouette does not tell apart
  bool is_ambiguous = false;
};

ChosenPose choose_pose(const FitPhotograph& photograph, const Mesh& mesh, const v1::Scene& scene,
                       const FitOptions& options, const Synthesize& synthesize) {
  std::vector<FoundPose> poses = find_poses(
      mesh, photograph.pose_mask, view_of(photograph, photograph.pose_side), {}, interruption());
  constexpr double kLeastOverlap = 0.9;
  const double best = std::ranges::max(poses, {}, &FoundPose::overlap).overlap;
  if (best < kLeastOverlap) {
    throw invalid_input(fmt::format(
        "{}: wherever the shape stands, its silhouette and the mask overlap by {:.0f} % at most. "
        "Is {} the shape of the object, the focal length right, and the mask of the object alone?",
        photograph.name, 100 * best, options.shape));
  }
  std::erase_if(poses, [&](const FoundPose& one) {
    const std::vector<float> mask = pixels_of_object(photograph, mesh, one.pose);
    return one.overlap < kLeastOverlap || std::ranges::none_of(mask, is_on_object);
  });
  if (poses.empty()) {
    throw invalid_input(
        fmt::format("{}: no pixel shows the object alone, unclipped: it is too small or too thin",
                    photograph.name));
  }
  if (poses.size() == 1) return {poses.front()};
  constexpr size_t kMostTried = 8;
  const size_t tried = std::min(poses.size(), kMostTried);
  std::vector<std::pair<double, size_t>> losses;
  for (size_t i = 0; i < tried; ++i) {
    const Scouting found = scout(photograph, mesh, poses[i].pose, scene, options, 1, synthesize);
    losses.emplace_back(found.loss, i);
  }
  std::ranges::sort(losses);
  constexpr double kDoubtful = 1.3;
  const auto& [least, first] = losses.front();
  const bool is_clear = poses.size() == tried && losses[1].first > kDoubtful * least;
  return {poses[first], poses.size(), !is_clear};
}

// What errors of the pose do to the photograph, and a g that is another.
std::vector<std::vector<float>> disturbances_of(const FitPhotograph& photograph, const Mesh& mesh,
                                                const FoundPose& found, const v1::Scene& scene,
                                                const Material& material, const FitOptions& options,
                                                RenderPool& pool) {
  constexpr uint32_t kSpp = 256, kEstimates = 4;
  // So many standard deviations from the middle, that the noise is small beside the difference.
  constexpr double kFar = 2;
  std::vector<RenderJob> jobs;
  const auto add_job = [&](const Pose& pose, const Material& of_material) {
    v1::Scene moved = scene;
    place(pose, mesh, options, moved);
    moved.mutable_film()->set_channel(v1::Film::LUMINANCE);
    RenderJob& job = jobs.emplace_back(RenderJob{.scene = serialize(moved), .request = {}});
    *job.request.mutable_material() = to_proto(of_material);
    job.request.set_spp(kSpp);
    job.request.set_seed(options.refine.seed);
    job.request.set_estimates(kEstimates);
    job.request.set_pixels(v1::OBJECT_PIXELS);
  };
  const Vec3d middle = middle_of(bounds(mesh));
  std::vector<PoseMove> errors = found.errors;
  // The mask may be half a pixel too large or too small all around.
  errors.push_back({{}, found.pose.to_scene(middle) * (1.0 / photograph.pose_side)});
  for (const PoseMove& error : errors) {
    for (const double times : {kFar, -kFar}) {
      add_job(moved(found.pose, middle, error, times), material);
    }
  }
  std::vector<double> apart(errors.size(), 2 * kFar);
  if (options.g_error == 0) {
    for (const double g : {options.g + kDoubtOfG, options.g - kDoubtOfG}) {
      add_job(found.pose, of_similar_light(material, std::clamp(g, -kMaxAbsG, kMaxAbsG)));
    }
    apart.push_back(2);
  }
  std::vector<RenderedChange> changes(apart.size());
  const std::vector<v1::RenderGradReply> replies = pool.render_split(jobs, [](double /*fraction*/) {
    if (interruption().stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
  });
  for (size_t i = 0; i < replies.size(); ++i) {
    RenderedChange& change = changes[i / 2];
    change.apart = apart[i / 2];
    for (const v1::Estimate& estimate : replies[i].estimates()) {
      (i % 2 == 0 ? change.more : change.less).push_back(from_bytes<float>(estimate.radiance()));
    }
  }
  return disturbances_of(changes, pixels_of_object(photograph, mesh, found.pose), photograph.side);
}

// The photograph with the contour of the shape.
void write_overlay(const fs::path& file, const FitPhotograph& photograph, const Mesh& mesh,
                   const Pose& pose) {
  const int side = photograph.pose_side;
  const float white = white_level(photograph.picture);
  std::vector<unsigned char> rgb;
  for (const float value : photograph.picture)
    rgb.insert(rgb.end(), 3, to_srgb_byte(value / white));
  for (const ContourPoint& point : Silhouette(mesh, pose, view_of(photograph, side)).contour()) {
    const auto p =
        static_cast<size_t>(point.y) * static_cast<size_t>(side) + static_cast<size_t>(point.x);
    constexpr std::array<unsigned char, 3> kRed{255, 40, 40};
    std::ranges::copy(kRed, rgb.begin() + static_cast<ptrdiff_t>(3 * p));
  }
  write_png(file, side, side, rgb);
}

// ---- All of it -------------------------------------------------------------------------------

void check(const FitOptions& options) {
  const auto usage = [](const std::string& message) { return Error(ErrorKind::kUsage, message); };
  if (options.photograph.gray_card && !is_by_flash(options)) {
    throw usage(
        "--gray-card is for --light flash: how bright a card is in a panorama is not computed");
  }
  if (options.photograph.gray_card && options.images.size() > 1) {
    throw usage("--gray-card is of one photograph; several are fitted without, or one by one");
  }
  if (options.images.size() > 1 && is_by_flash(options)) {
    throw usage(
        "several photographs by flash cannot be fitted together yet: how their exposures differ is "
        "not known; fit them one by one");
  }
  if (!options.photograph.object_size && (is_builtin(options.shape) || !options.refine.mesh_unit)) {
    throw usage(
        "--object-size is required, the longest side of the object in mm, or --mesh-unit where the "
        "shape's file has its size");
  }
}

// Writes photographs and scenes that a refinement is of, as files that can be corrected, and says
// which they are.
void write_posed_scenes(const FitOptions& options, const fs::path& folder, RefineOptions& refine,
                        v1::FitResult& result) {
  RenderPool pool(options.refine.workers.pool_options());
  const Synthesize synthesize = rendered_by(pool, interruption());
  for (size_t i = 0; i < options.images.size(); ++i) {
    FitPhotograph photograph = load_fit_photograph(options.images[i], options);
    const std::string stem = options.images.size() == 1 ? "" : fmt::format("_{}", i);
    const fs::path scene_file = folder / fmt::format("scene{}.textproto", stem);
    v1::Scene scene = scene_of(photograph, options);
    write_file_atomically(scene_file, to_text_proto(scene));
    const v1::Scene loaded = load_scene(scene_file);
    const Mesh mesh = MeshBuilder(UINT64_MAX).build("object.mesh", loaded.object().mesh());
    const ChosenPose chosen = choose_pose(photograph, mesh, loaded, options, synthesize);
    const FoundPose& found = chosen.found;
    v1::FitPose& pose = *result.add_poses();
    pose.set_image(photograph.name);
    pose.set_scene(scene_file.string());
    pose.set_overlap(found.overlap);
    pose.set_contour_distance(found.distance);
    pose.set_contour_side(static_cast<uint32_t>(photograph.pose_side));
    pose.set_angle_error(found.angle_error);
    pose.set_range_error(found.range_error);
    pose.set_range(length(found.pose.to_scene(middle_of(bounds(mesh)))));
    pose.set_alike(static_cast<uint32_t>(chosen.alike));
    pose.set_ambiguous(chosen.is_ambiguous);
    place(found.pose, mesh, options, scene);
    write_overlay(folder / fmt::format("pose{}.png", stem), photograph, mesh, found.pose);
    photograph.image.channels["mask.Y"] = pixels_of_object(photograph, mesh, found.pose);
    const Material scouted =
        scout(photograph, mesh, found.pose, loaded, options, options.refine.starts, synthesize)
            .material;
    if (options.refine.init == "mean") {
      const Material start = of_similar_light(scouted, options.g);
      refine.init = fmt::format("{},{},{}", start.sigma_t, start.albedo, start.g);
      refine.starts = 1;
    }
    const std::vector<std::vector<float>> disturbances =
        disturbances_of(photograph, mesh, found, loaded, scouted, options, pool);
    for (size_t d = 0; d < disturbances.size(); ++d) {
      photograph.image.channels[fmt::format("{}{}", kDisturbance, d)] = disturbances[d];
    }
    const fs::path image_file = folder / fmt::format("photograph{}.exr", stem);
    write_exr(image_file, photograph.image);
    write_file_atomically(scene_file, to_text_proto(scene));
    refine.images.push_back(image_file.string());
    refine.scenes.push_back(scene_file.string());
  }
}

// What is found with the material, and how well it was known.
void set_unknowns(const FitOptions& options, RefineOptions& refine) {
  refine.mesh_unit.reset();  // the scenes say it
  refine.unknowns = {kRoughness};
  const auto find_within = [&](const std::string& name, double deviation) {
    if (deviation == 0) return;
    refine.unknowns.push_back(name);
    refine.known_within[name] = deviation;
  };
  find_within("rough_dielectric.index", options.index_error);
  if (is_by_flash(options)) {
    find_within("light[0].sphere.center.x", options.flash_error);
    find_within("light[0].sphere.center.y", options.flash_error);
  }
  refine.expected_g = options.g;
  refine.known_within[kKnownG] = options.g_error > 0 ? options.g_error : kAsGiven;
  refine.unknown_exposure = !options.photograph.gray_card || options.card_error > 0;
  if (options.photograph.gray_card && options.card_error > 0) {
    refine.known_within[kExposure] = options.card_error;
  }
}

std::string to_text(const v1::FitResult& result, const fs::path& folder) {
  std::string text;
  for (const v1::FitPose& pose : result.poses()) {
    text += fmt::format(
        "{}: the object stands {:.0f} mm from the camera ({:.1f} %, {:.1f} degrees); its "
        "silhouette covers {:.1f} % of what it and the mask cover\n",
        pose.image(), pose.range(), 100 * pose.range_error(), pose.angle_error(),
        100 * pose.overlap());
    if (pose.ambiguous()) {
      text += fmt::format(
          "{}: {} poses have that silhouette, and light and shade do not tell them apart: if the "
          "shape is not symmetric, the material may be wrong with the pose\n",
          pose.image(), pose.alike());
    }
  }
  text += to_table(std::vector(result.results().begin(), result.results().end()));
  text +=
      "per mm, with 95 % intervals, which know nothing of an error of pose, shape or focal "
      "length\n";
  return text + fmt::format("for renderers: itn materials --refined {} --format openpbr\n",
                            folder.string());
}

// What a fit is of, in words.
std::string in_words(const FitOptions& options) {
  const PhotographOptions& photograph = options.photograph;
  return fmt::format(
      "photographs: {}\nshape: {}, size {}, mesh unit {}, repair {}\nlight: {}, flash {} within "
      "{}, panorama {}, camera {}\ncard: {} of {} at {} within {}\nfocal length: {}\nindex: {} "
      "within {}\ng: {} within {}\nresolution: {}, luminance {}\nmask: {}\nstart: {}, {} starts, "
      "seed {}, spp {}\n",
      fmt::join(options.images, " "), options.shape, photograph.object_size.value_or(0),
      static_cast<int>(options.refine.mesh_unit.value_or(v1::MM)), options.repair, options.light,
      fmt::join(options.flash_offset, ","), options.flash_error, options.panorama_turn,
      options.camera_down,
      photograph.gray_card
          ? fmt::format("{},{},{},{}", photograph.gray_card->x, photograph.gray_card->y,
                        photograph.gray_card->width, photograph.gray_card->height)
          : "none",
      photograph.gray, options.card_distance.value_or(0), options.card_error,
      options.focal_length_35mm.value_or(0), options.index, options.index_error, options.g,
      options.g_error, options.resolution, options.luminance, photograph.mask, options.refine.init,
      options.refine.starts, options.refine.seed, options.refine.max_spp);
}

constexpr const char* kOptionsFile = "options.txt";

// None goes on in the folder of another one.
void require_same(const FitOptions& options, const fs::path& folder) {
  const fs::path file = folder / kOptionsFile;
  if (!fs::exists(file)) return;
  const std::string before = read_file(file, "options"), now = in_words(options);
  if (before == now) return;
  throw invalid_input(
      fmt::format("choose another folder: {} has a fit of other options ({}):\n{}these are\n{}",
                  folder.string(), kOptionsFile, before, now));
}

void write_report(const FitOptions& options, const fs::path& folder, const v1::FitResult& result) {
  constexpr uint32_t kSwatchSpp = 64;
  const v1::Scene scene = load_scene(result.poses(0).scene());
  const Mesh mesh = MeshBuilder(UINT64_MAX).build("object.mesh", scene.object().mesh());
  std::vector<Material> materials;
  for (const v1::RefineResult& one : result.results()) {
    // Of an object of 1 mm.
    materials.push_back(from_proto(one.material()));
    materials.back().sigma_t *= longest_side(bounds(mesh));
  }
  RenderPool pool(options.refine.workers.pool_options());
  const std::string title = fs::path(result.poses(0).image()).filename().string();
  write_file_atomically(
      folder / "report.html",
      fit_report_page(title, result, folder, render_swatches(pool, materials, kSwatchSpp, [] {})));
}

}  // namespace

void run_fit(const FitOptions& options) {
  check(options);
  const fs::path folder = options.refine.output;
  check_folder_writable(folder);
  const FolderLock lock(folder, "fits a material");
  lock.remove_temporary_files();
  require_same(options, folder);
  v1::FitResult result;
  RefineOptions refine = options.refine;
  write_posed_scenes(options, folder, refine, result);
  set_unknowns(options, refine);
  write_file_atomically(folder / kOptionsFile, in_words(options));
  const std::vector<v1::RefineResult> found = find_materials(refine);
  result.mutable_results()->Add(found.begin(), found.end());
  write_report(options, folder, result);
  options.refine.json ? print_result("{}\n", to_json(result))
                      : print_result(to_text(result, folder));
}

}  // namespace itn
