// itn fit: finds where an object stands in a photograph, writes the scene, and refines its
// material.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "client/commands/fit.h"
#include "client/commands/fit_given.h"
#include "client/commands/fit_photograph.h"
#include "client/commands/fit_report.h"
#include "client/commands/fit_stand.h"
#include "client/dataset/panorama.h"
#include "client/files/folder_lock.h"
#include "client/image/preview.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/refine/refine_result.h"
#include "client/refine/refine_run.h"
#include "client/render_pool/render_pool.h"
#include "client/scene/scene_file.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "common/image/photograph.h"
#include "common/scene/material_proto.h"
#include "common/scene/mesh_builder.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

// The deviation of a g that is given.
constexpr double kAsGiven = 1e-4;

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
  if (options.shape.empty() == options.scenes.empty()) {
    throw usage(
        "say either --shape, of an object that is to be found, or --scene, where shape and pose "
        "are "
        "known");
  }
  check_init(options.refine.init);
  if (options.refine.settings.g_of_each_colour() && options.g_error == 0) {
    throw usage("--g-of-each-colour is for a g that is found: say --g-error, such as 0.4");
  }
  if (!options.scenes.empty()) {
    if (options.photograph.gray_card) {
      throw usage("--gray-card is for --shape: how bright it is in a scene is not known");
    }
    const FitOptions unsaid;
    const bool is_said_twice =
        options.light != unsaid.light || options.flash_offset != unsaid.flash_offset ||
        options.panorama_turn != unsaid.panorama_turn ||
        options.camera_down != unsaid.camera_down || options.sun_elevation ||
        options.focal_length_35mm || !options.object_size.empty() || options.index != unsaid.index;
    if (is_said_twice) {
      throw usage(
          "--object-size, --index, --focal-length, --light and where the light stands are for "
          "--shape: the scene of --scene says them");
    }
    return;
  }
  if (!is_by_flash(options) && !is_in_sun(options) && !fs::exists(options.light)) {
    throw Error(ErrorKind::kIo,
                fmt::format("--light is flash, sun or the file of a panorama; there is no file {}",
                            options.light));
  }
  const bool is_turned =
      !options.panorama_turn.empty() || options.camera_down != FitOptions().camera_down;
  if (is_by_flash(options) && is_turned) {
    throw usage("--panorama-turn and --camera-down are for a panorama or the sun: say --light");
  }
  if (options.images.size() > 1 && fs::is_regular_file(options.photograph.mask)) {
    throw usage(
        "--mask is one file for several photographs; it must be a folder with one of the name of "
        "each");
  }
  const auto require_one_or_each = [&](const char* flag, const std::vector<double>& values) {
    if (values.size() <= 1 || values.size() == options.images.size()) return;
    throw usage(
        fmt::format("{} has {} numbers for {} photographs; say one for all, or one for each", flag,
                    values.size(), options.images.size()));
  };
  require_one_or_each("--panorama-turn", options.panorama_turn);
  require_one_or_each("--camera-down", options.camera_down);
  if (is_in_sun(options) && options.photograph.gray_card) {
    throw usage(
        "--gray-card is for a flash or a panorama: how bright the sun is, is not known; the "
        "exposure is found without");
  }
  if (options.sun_elevation && !is_in_sun(options)) {
    throw usage("--sun-elevation is for --light sun");
  }
  if (!is_builtin(options.shape) && fs::path(options.shape).extension().empty()) {
    throw usage(fmt::format(
        "--shape {}: it is neither the name of a .ply, .obj or .stl file nor a shape that itn "
        "shapes lists",
        options.shape));
  }
  if (options.object_size.size() == 2 || options.object_size.size() > 3) {
    throw usage(
        fmt::format("--object-size has {} numbers; it takes the longest side, or the sides along "
                    "x, y and z of the shape",
                    options.object_size.size()));
  }
  if (options.object_size.empty() && (is_builtin(options.shape) || !options.refine.mesh_unit)) {
    throw usage(
        "--object-size is required, the longest side of the object in mm, or --mesh-unit where the "
        "shape's file has its size");
  }
}

// With its files loaded: panoramas as large as light and shade need them, as many copies are made.
v1::Scene for_search(v1::Scene scene) {
  constexpr uint32_t kWidth = 512;
  load_files(scene, {});
  for (v1::Light& light : *scene.mutable_lights()) {
    if (!light.has_environment_map()) continue;
    v1::EnvironmentMap& map = *light.mutable_environment_map();
    *map.mutable_pixels() = averaged_down(map.pixels(), kWidth, kWidth / 2);
  }
  return scene;
}

// The value of photograph i, where there is one for all or one for each.
std::optional<double> of_photograph(const std::vector<double>& all, size_t i) {
  if (all.empty()) return {};
  return all[std::min(i, all.size() - 1)];
}

// What says how large the object is.
const char* size_flag(const FitOptions& options) {
  return options.object_size.empty() ? "--mesh-unit" : "--object-size";
}

void refuse_if_huge(const FitOptions& options, double size) {
  constexpr double kHuge = 5000;  // mm
  if (size <= kHuge) return;
  throw invalid_input(fmt::format("{} is {:.4g} mm large; it must be {} mm at most: is {} right?",
                                  options.shape, size, kHuge, size_flag(options)));
}

// A photograph is hardly ever taken from so near, and never from nearer than a camera can see
// sharply.
void check_distance(const FitOptions& options, const v1::FitPose& pose, double size) {
  constexpr double kNearest = 20, kNear = 70, kSmall = 15;  // mm
  if (pose.range() >= kNear || size >= kSmall) return;
  const std::string what = fmt::format(
      "{}: an object of {:.3g} mm would stand {:.2g} mm before the camera: is {} right?",
      pose.image(), size, pose.range(), size_flag(options));
  if (pose.range() < kNearest) throw invalid_input(what);
  spdlog::warn("{}", what);
}

// Files in a folder: the options of its fit, and its poses, a FitResult without results.
constexpr const char *kOptionsFile = "options.txt", *kPosesFile = "poses.textproto";

fs::path scene_file(const fs::path& folder, const FitOptions& options, size_t i) {
  return file_of(folder, "scene", ".textproto", options, i);
}

// What the refinement takes from an image of an object that is posed.
void set_seen(const FitOptions& options, const Image& image, const v1::FitPose& pose,
              RefineOptions& refine) {
  const std::vector<float>& mask = image.channel("mask.Y");
  allow_for_likeness(mask, image.width, pose.image(), options.shape_error, refine);
  if (options.refine.init != "mean") return;
  const v1::Material& start = pose.start();
  refine.init = fmt::format("{},{},{}", start.sigma_t(), start.albedo(), start.g());
  refine.starts = 1;
}

// Writes photographs and scenes that a refinement is of, as files that can be corrected, and says
// which they are.
void write_posed_scenes(FitOptions options, const fs::path& folder, RefineOptions& refine,
                        v1::FitResult& result) {
  RenderPool pool(options.refine.workers.pool_options());
  // All of them, before any work: what is wrong with one is said at once.
  std::vector<FitPhotograph> photographs;
  for (const std::string& image : options.images) {
    std::optional<Exposure> of_first;
    if (!photographs.empty()) of_first = photographs.front().exposure;
    photographs.push_back(load_fit_photograph(image, options, of_first));
  }
  for (size_t i = 0; i < photographs.size(); ++i) {
    FitPhotograph& photograph = photographs[i];
    photograph.panorama_turn = of_photograph(options.panorama_turn, i);
    photograph.camera_down = of_photograph(options.camera_down, i).value();
    v1::Scene scene = scene_of(photograph, options);
    const v1::Scene loaded = for_search(scene);
    const Mesh mesh = MeshBuilder(UINT64_MAX).build("object.mesh", loaded.object().mesh());
    refuse_if_huge(options, longest_side(bounds(mesh)));
    spdlog::info("{}: searching where the object stands", photograph.name);
    const FoundStand stand = find_stand(photograph, mesh, loaded, options, pool);
    const FoundPose& found = stand.pose;
    v1::FitPose& pose = *result.add_poses();
    pose.set_image(photograph.name);
    pose.set_scene(scene_file(folder, options, i).string());
    pose.set_overlap(found.overlap);
    pose.set_contour_distance(found.distance);
    pose.set_contour_side(static_cast<uint32_t>(photograph.pose_side));
    pose.set_angle_error(found.angle_error);
    pose.set_range_error(found.range_error);
    pose.set_range(length(found.pose.to_scene(middle_of(bounds(mesh)))));
    pose.set_alike(static_cast<uint32_t>(stand.alike));
    pose.set_ambiguous(stand.ambiguous);
    if (!is_by_flash(options)) {
      pose.set_panorama_turn(std::remainder(stand.stand.panorama_turn, 360.0));
      pose.set_turn_ambiguous(stand.turn_ambiguous);
      if (is_in_sun(options)) pose.set_sun_elevation(stand.stand.sun_elevation);
    }
    *pose.mutable_start() = to_proto(of_similar_light(stand.material, options.g));
    check_distance(options, pose, longest_side(bounds(mesh)));
    // The flash is that of the first photograph.
    if (!options.card_distance) options.card_distance = flash_range(stand.stand, mesh, options);
    place(stand.stand, mesh, options, scene);
    write_overlay(file_of(folder, "pose", ".png", options, i), photograph, mesh, found.pose);
    photograph.image.channels["mask.Y"] = pixels_of_surfaces(photograph, mesh, found.pose);
    set_seen(options, photograph.image, pose, refine);
    add_disturbances(disturbances_of(photograph, mesh, stand, loaded, options, pool),
                     photograph.image);
    write_exr(photograph_file(folder, options, i), photograph.image);
    write_file_atomically(scene_file(folder, options, i), to_text_proto(scene));
    refine.images.push_back(photograph_file(folder, options, i).string());
    refine.scenes.push_back(scene_file(folder, options, i).string());
  }
}

// Takes up what a fit that was stopped has written, if it has found where all stands.
bool read_posed_scenes(const FitOptions& options, const fs::path& folder, RefineOptions& refine,
                       v1::FitResult& result) {
  const fs::path file = folder / kPosesFile;
  if (!fs::exists(file) || !fs::exists(folder / kOptionsFile)) return false;
  parse_text_proto(read_file(file, "poses"), file.string(), result);
  if (result.poses_size() != static_cast<int>(options.images.size())) {
    throw invalid_input(
        fmt::format("{} has {} poses, for {} photographs: delete it, and they are "
                    "searched again",
                    file.string(), result.poses_size(), options.images.size()));
  }
  result.clear_results();
  for (size_t i = 0; i < options.images.size(); ++i) {
    v1::FitPose& pose = *result.mutable_poses(static_cast<int>(i));
    pose.set_scene(scene_file(folder, options, i).string());
    const fs::path image_file = photograph_file(folder, options, i);
    set_seen(options, read_exr(image_file), pose, refine);
    refine.images.push_back(image_file.string());
    refine.scenes.push_back(pose.scene());
  }
  spdlog::info("{} says where all stands: it is not searched again", file.string());
  return true;
}

// What is found with the material, and how well it was known.
void set_unknowns(const FitOptions& options, RefineOptions& refine) {
  refine.mesh_unit.reset();  // the scenes say it
  v1::RefineSettings& settings = refine.settings;
  auto& known_within = *settings.mutable_known_within();
  settings.add_unknowns(kRoughness);
  const auto find_within = [&](const std::string& name, double deviation) {
    if (deviation == 0) return;
    settings.add_unknowns(name);
    known_within[name] = deviation;
  };
  find_within(kIndex, options.index_error);
  if (is_by_flash(options)) {
    find_within("light[0].sphere.center.x", options.flash_error);
    find_within("light[0].sphere.center.y", options.flash_error);
  }
  settings.set_unknown_exposure(!options.photograph.gray_card || card_error_of(options) > 0);
  if (card_error_of(options) > 0) known_within[kExposure] = card_error_of(options);
  if (!settings.unknown_exposure() && options.shape_error > 0) {
    spdlog::warn("intervals know nothing of --shape-error where --card-error is 0");
  }
}

std::string to_text(const v1::FitResult& result, const fs::path& folder) {
  std::string text;
  for (const v1::FitPose& pose : result.poses()) {
    text += fmt::format(
        "{}: the object stands {:.0f} mm from the camera (within {:.1f} %, turned within {:.1f} "
        "degrees); its silhouette and the mask share {:.1f} % of what either covers\n",
        pose.image(), pose.range(), 100 * pose.range_error(), pose.angle_error(),
        100 * pose.overlap());
    if (pose.ambiguous()) {
      text += fmt::format(
          "{}: {} poses have that silhouette, and light and shade do not tell them apart: if the "
          "shape is not symmetric, the material may be wrong with the pose\n",
          pose.image(), pose.alike());
    }
    if (pose.has_sun_elevation()) {
      text += fmt::format(
          "{}: the sun stands {:.0f} degrees above the horizon, {:.0f} degrees to the left of "
          "where the camera looks\n",
          pose.image(), pose.sun_elevation(), pose.panorama_turn());
    } else if (pose.has_panorama_turn()) {
      text += fmt::format("{}: the panorama is turned by {:.0f} degrees\n", pose.image(),
                          pose.panorama_turn());
    }
    if (pose.turn_ambiguous()) {
      text += fmt::format(
          "{}: another turn of the light fits about as well: if --panorama-turn is known, say so\n",
          pose.image());
    }
  }
  text += to_table(std::vector(result.results().begin(), result.results().end()));
  if (!std::ranges::all_of(result.results(), has_intervals)) {
    return text + "lengths in mm; no material to use, as its intervals are unknown\n";
  }
  text +=
      "lengths in mm, with 95 % intervals, which know nothing of an error of size or focal length, "
      "nor of a larger error of shape than --shape-error\n";
  return text + fmt::format("for renderers: itn materials --refined {} --format openpbr\n",
                            folder.string());
}

// Which files a fit is of: others of the same names are not taken for them.
std::string digests_of(const FitOptions& options) {
  std::string text = "SHA-256 of files:\n";
  std::vector<std::string> files = options.images;
  for (const std::string& image : options.images) {
    const std::string& mask = options.photograph.mask;
    if (fs::is_directory(mask)) files.push_back(mask_in_folder(mask, image));
  }
  files.insert(files.end(), {options.photograph.mask, options.shape, options.light});
  for (const std::string& file : files) {
    if (!fs::is_regular_file(file)) continue;
    text += fmt::format("{} {}\n", to_hex(sha256(read_file(file, "file"))), file);
  }
  return text;
}

// What a fit is of, in words.
std::string in_words(const FitOptions& options) {
  const PhotographOptions& photograph = options.photograph;
  return fmt::format(
             "photographs: {}\nscenes: {}\n"
             "shape: {}, size {}, mesh unit {}, repair {}\n"
             "light: {}, flash {} within {}, panorama {}, sun {}, camera {} within {}\n"
             "shape within {}\n"
             "card: {} of {} at {} within {}\n"
             "focal length: {}\n"
             "index: {} within {}\n"
             "g: {} within {}, of each colour {}\n"
             "resolution: {}, luminance {}\n"
             "mask: {}, linear {}, layer {}\n"
             "start: {}, {} starts, seed {}, spp {}\n",
             fmt::join(options.images, " "), fmt::join(options.scenes, " "), options.shape,
             options.object_size.empty() ? "of its file"
                                         : fmt::format("{}", fmt::join(options.object_size, ",")),
             static_cast<int>(options.refine.mesh_unit.value_or(v1::MM)), options.repair,
             options.light, fmt::join(options.flash_offset, ","), options.flash_error,
             options.panorama_turn.empty()
                 ? "found"
                 : fmt::format("{}", fmt::join(options.panorama_turn, ",")),
             options.sun_elevation.value_or(0), fmt::join(options.camera_down, ","),
             options.turn_error, options.shape_error,
             photograph.gray_card
                 ? fmt::format("{},{},{},{}", photograph.gray_card->x, photograph.gray_card->y,
                               photograph.gray_card->width, photograph.gray_card->height)
                 : "none",
             photograph.gray, options.card_distance.value_or(0), card_error_of(options),
             options.focal_length_35mm.value_or(0), options.index, options.index_error, options.g,
             options.g_error, options.refine.settings.g_of_each_colour(), options.resolution,
             options.luminance, photograph.mask,
             photograph.reading.is_linear ? *photograph.reading.is_linear ? "yes" : "no"
                                          : "by itself",
             photograph.reading.layer, options.refine.init, options.refine.starts,
             options.refine.settings.seed(), options.refine.settings.max_spp()) +
         digests_of(options);
}

// None goes on in the folder of another one.
void require_same(const std::string& now, const fs::path& folder) {
  const fs::path file = folder / kOptionsFile;
  if (!fs::exists(file)) return;
  const std::string before = read_file(file, "options");
  if (before == now) return;
  // The lines that differ.
  std::string differences;
  std::istringstream then_lines(before), now_lines(now);
  for (std::string then_line, now_line; std::getline(now_lines, now_line);) {
    std::getline(then_lines, then_line);
    if (then_line != now_line)
      differences += fmt::format("  there {}\n  now   {}\n", then_line, now_line);
  }
  throw invalid_input(fmt::format("choose another folder: {} has a fit of other options ({}):\n{}",
                                  folder.string(), kOptionsFile, differences));
}

// `scene`: a file that the refinement was of.
void write_report(const FitOptions& options, const std::string& scene, const fs::path& folder,
                  const v1::FitResult& result) {
  constexpr uint32_t kSwatchSpp = 64;
  const double size = longest_side(object_bounds("scene.object", load_scene(scene).object()));
  std::vector<Material> materials;
  for (const v1::RefineResult& one : result.results()) {
    // The materials are those of an object of 1 mm.
    materials.push_back(from_proto(one.material()));
    materials.back().sigma_t *= size;
  }
  RenderPool pool(options.refine.workers.pool_options());
  const std::string title = fs::path(options.images.front()).filename().string();
  write_file_atomically(
      folder / "report.html",
      fit_report_page(title, result, folder, render_swatches(pool, materials, kSwatchSpp, [] {})));
}

}  // namespace

void run_fit(const FitOptions& options) {
  check(options);
  const fs::path folder = options.refine.output;
  check_folder_writable(folder);
  const auto begin = std::chrono::steady_clock::now();
  const FolderLock lock(folder, "fits a material");
  lock.remove_temporary_files();
  const std::string words = in_words(options);
  require_same(words, folder);
  v1::FitResult result;
  RefineOptions refine = options.refine;
  refine.settings.set_expected_g(options.g);
  (*refine.settings.mutable_known_within())[kKnownG] =
      options.g_error > 0 ? options.g_error : kAsGiven;
  const auto seconds = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  if (!options.scenes.empty()) {
    prepare_given_scenes(options, folder, refine);
    write_file_atomically(folder / kOptionsFile, words);
  } else if (!read_posed_scenes(options, folder, refine, result)) {
    fs::remove(folder / kPosesFile);
    try {
      write_posed_scenes(options, folder, refine, result);
    } catch (const Error& error) {
      if (error.kind() != ErrorKind::kCancelled) throw;
      throw Error(
          error.kind(),
          fmt::format(
              "{}: where the object stands is not found yet; the same command searches anew",
              error.what()));
    }
    result.set_search_seconds(seconds());
    write_file_atomically(folder / kOptionsFile, words);
    write_file_atomically(folder / kPosesFile, to_text_proto(result));
  }
  if (options.scenes.empty()) set_unknowns(options, refine);
  refine.seconds_before = std::max(seconds(), result.search_seconds());
  const std::vector<v1::RefineResult> found = find_materials(refine);
  result.mutable_results()->Add(found.begin(), found.end());
  options.refine.json ? print_result("{}\n", to_json(result))
                      : print_result(to_text(result, folder));
  spdlog::info("writing {}", (folder / "report.html").string());
  write_report(options, refine.scenes.front(), folder, result);
}

}  // namespace itn
