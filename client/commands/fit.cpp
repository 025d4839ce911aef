// itn fit: finds where an object stands in a photograph, writes the scene, and refines its
// material.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/commands/fit.h"
#include "client/commands/fit_report.h"
#include "client/fit/disturbances.h"
#include "client/fit/pose_search.h"
#include "client/interrupt.h"
#include "client/json.h"
#include "client/output.h"
#include "client/refine/refine_run.h"
#include "client/render_pool/render_pool.h"
#include "common/angle.h"
#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/folder_lock.h"
#include "common/files/read_file.h"
#include "common/geometry/shapes.h"
#include "common/image/image.h"
#include "common/image/preview.h"
#include "common/rpc/wire_array.h"
#include "common/scene/field_check.h"
#include "common/scene/material_proto.h"
#include "common/scene/scene_file.h"
#include "common/scene/text_proto.h"
#include "server/scene_compiler/mesh_builder.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

// ---- The photograph --------------------------------------------------------------------------

// A square about the object, at the side of the fit and at that of the search for its pose.
struct FitPhotograph {
  std::string name;
  std::vector<std::string> channels;  // Y, or R, G, B
  Image image;                        // of these, side x side
  std::vector<float> mask, clipped;   // likewise
  int side = 0, pose_side = 0;
  std::vector<float> pose_mask;
  std::vector<float> picture;  // of the first channel, for people, pose_side x pose_side
  int width = 0, height = 0;   // of the whole photograph
  Square square;
  double focal = 0;  // in pixels of the whole photograph
};

double focal_of(const PhotographContent& content, const std::string& name,
                const FitOptions& options) {
  constexpr double kDiagonal = 43.2666;  // of 36 x 24 mm
  const std::optional<double> in_35mm =
      options.focal_length_35mm ? options.focal_length_35mm : content.file.focal_length_35mm;
  if (!in_35mm) {
    throw invalid_input(fmt::format(
        "{} does not say with which focal length it was taken (EXIF FocalLengthIn35mmFilm); "
        "--focal-length does, in mm of a 35 mm camera: of a phone's main camera some 26",
        name));
  }
  return *in_35mm / kDiagonal * std::hypot(content.width(), content.height());
}

FitPhotograph load(const std::string& name, const FitOptions& options) {
  PhotographOptions reading = options.photograph;
  reading.framing = Framing::kObject;
  const MarkedPhotograph marked = read_marked(name, reading);
  const PhotographContent& content = marked.content;
  const Photograph view = marked.view();
  if (reaches_edge(view)) {
    throw invalid_input(name + ": the object is cut off by the frame; it must be seen whole");
  }
  FitPhotograph photograph;
  photograph.name = name;
  photograph.channels = content.channels;
  photograph.square = frame(view, Framing::kObject);
  photograph.width = content.width();
  photograph.height = content.height();
  photograph.focal = focal_of(content, name, options);
  constexpr int kLeast = 32;
  if (photograph.square.side < kLeast) {
    throw invalid_input(
        fmt::format("{}: the object is {} pixels large with its margin; {} are the least", name,
                    photograph.square.side, kLeast));
  }
  photograph.side = std::min(options.resolution, photograph.square.side);
  photograph.pose_side = std::min(kMaxFrameSide, photograph.square.side / 4 * 4);
  const auto at_side = [&](std::span<const float> values, int channels, int side) {
    return averaged(values, channels, content.width(), photograph.square, side, interruption());
  };
  const int channels = view.channels;
  const std::vector<double> white = reading.gray_card
                                        ? white_of_card(marked, name, reading)
                                        : std::vector<double>(static_cast<size_t>(channels), 1);
  const std::vector<float> pixels = at_side(marked.pixels, channels, photograph.side);
  photograph.image.width = photograph.image.height = photograph.side;
  for (size_t c = 0; c < white.size(); ++c) {
    std::vector<float>& plane = photograph.image.channels[content.channels[c]];
    for (size_t p = c; p < pixels.size(); p += white.size()) {
      plane.push_back(static_cast<float>(double{pixels[p]} / white[c]));
    }
  }
  photograph.mask = at_side(marked.mask, 1, photograph.side);
  photograph.pose_mask = at_side(marked.mask, 1, photograph.pose_side);
  std::vector<float> clipped(marked.mask.size());
  for (size_t p = 0; p < content.file.clipped.size(); ++p) clipped[p] = content.file.clipped[p];
  photograph.clipped = at_side(clipped, 1, photograph.side);
  const std::vector<float> picture = at_side(marked.pixels, channels, photograph.pose_side);
  for (size_t p = 0; p < picture.size(); p += static_cast<size_t>(channels)) {
    photograph.picture.push_back(picture[p + (channels == 3 ? 1 : 0)]);
  }
  return photograph;
}

PinholeView view_of(const FitPhotograph& photograph, int side) {
  const double by = static_cast<double>(side) / photograph.square.side;
  return {photograph.focal * by, (0.5 * photograph.width - photograph.square.left) * by,
          (0.5 * photograph.height - photograph.square.top) * by, side};
}

// ---- The scene -------------------------------------------------------------------------------

// How far g may be from what it is taken for: that of nearly all that is translucent.
constexpr double kDoubtOfG = 0.4;
// The deviation of a g that is given.
constexpr double kAsGiven = 1e-4;

constexpr const char* kRoughness = "rough_dielectric.roughness";

// Of a lamp of a phone, in mm. A lamp that has a size has a derivative in its place.
constexpr float kFlashRadius = 2;

void set(v1::Vec3& to, Vec3d from) {
  to.set_x(static_cast<float>(from.x));
  to.set_y(static_cast<float>(from.y));
  to.set_z(static_cast<float>(from.z));
}

bool is_builtin(const std::string& shape) {
  const auto shapes = builtin_shapes();
  return std::ranges::find(shapes, shape, &ShapeInfo::name) != shapes.end();
}

bool is_by_flash(const FitOptions& options) {
  return options.light == "flash";
}

// The camera is at the origin and looks along -z, or below the horizon of a panorama.
Rotation<double> camera_rotation(const FitOptions& options) {
  const double angle = is_by_flash(options) ? 0 : options.camera_down * kRadiansPerDegree;
  const double c = std::cos(angle), s = std::sin(angle);
  return {{1, 0, 0}, {0, c, s}, {0, -s, c}};
}

v1::Scene scene_of(const FitPhotograph& photograph, const FitOptions& options) {
  v1::Scene scene;
  v1::Object& object = *scene.mutable_object();
  v1::Mesh& mesh = *object.mutable_mesh();
  if (is_builtin(options.shape)) {
    mesh.set_builtin(options.shape);
  } else {
    mesh.set_path(fs::absolute(options.shape).string());
    mesh.set_repair(options.repair);
    mesh.set_unit(options.refine.mesh_unit.value_or(v1::MM));
  }
  if (options.photograph.object_size) {
    mesh.set_normalize(true);
    const double size = *options.photograph.object_size;
    set(*mesh.add_transforms()->mutable_scale(), {size, size, size});
  }
  object.mutable_rough_dielectric()->set_index(static_cast<float>(options.index));
  object.mutable_rough_dielectric()->set_roughness(0.25F);
  object.set_smooth_angle_degrees(30);

  v1::Camera& camera = *scene.mutable_camera();
  set(*camera.mutable_origin(), {});
  const Rotation<double> rotation = camera_rotation(options);
  constexpr double kAhead = 1000;
  set(*camera.mutable_target(), rotation(Vec3d{0, 0, -kAhead}));
  set(*camera.mutable_up(), rotation(Vec3d{0, 1, 0}));
  camera.set_fov_degrees(static_cast<float>(
      2 * std::atan(0.5 * photograph.width / photograph.focal) / kRadiansPerDegree));
  v1::Crop& crop = *camera.mutable_crop();
  const Square& square = photograph.square;
  crop.set_left(static_cast<float>(square.left) / static_cast<float>(photograph.width));
  crop.set_right(static_cast<float>(square.left + square.side) /
                 static_cast<float>(photograph.width));
  crop.set_top(static_cast<float>(square.top) / static_cast<float>(photograph.height));
  crop.set_bottom(static_cast<float>(square.top + square.side) /
                  static_cast<float>(photograph.height));
  scene.mutable_film()->set_width(static_cast<uint32_t>(photograph.side));
  scene.mutable_film()->set_height(static_cast<uint32_t>(photograph.side));
  scene.mutable_film()->set_channel(
      photograph.channels.size() == 3 && !options.luminance ? v1::Film::RGB : v1::Film::LUMINANCE);

  v1::Light& light = *scene.add_lights();
  if (is_by_flash(options)) {
    const auto& offset = options.flash_offset;
    set(*light.mutable_sphere()->mutable_center(),
        rotation(Vec3d{offset[0], offset[1], offset[2]}));
    light.mutable_sphere()->set_radius(kFlashRadius);
  } else {
    light.mutable_environment_map()->set_path(fs::absolute(options.light).string());
    // The left edge of a panorama lies along -z, where the camera looks; its middle is to do so.
    light.mutable_environment_map()->set_rotate_y_degrees(
        static_cast<float>(180 + options.panorama_turn));
  }
  return scene;
}

// As an axis and an angle.
void set_rotation(const Rotation<double>& rotation, v1::Rotation& to) {
  const double trace = rotation.x.x + rotation.y.y + rotation.z.z;
  const double angle = std::acos(std::clamp((trace - 1) / 2, -1.0, 1.0));
  Vec3d axis{rotation.z.y - rotation.y.z, rotation.x.z - rotation.z.x, rotation.y.x - rotation.x.y};
  if (length(axis) < 1e-6) {
    // Half a turn, or none: the columns of R + 1 lie along the axis.
    const std::array<Vec3d, 3> columns{Vec3d{rotation.x.x + 1, rotation.y.x, rotation.z.x},
                                       Vec3d{rotation.x.y, rotation.y.y + 1, rotation.z.y},
                                       Vec3d{rotation.x.z, rotation.y.z, rotation.z.z + 1}};
    axis = *std::ranges::max_element(columns, {}, [](Vec3d v) { return length(v); });
  }
  set(*to.mutable_axis(), normalize(axis));
  to.set_angle_degrees(static_cast<float>(angle / kRadiansPerDegree));
}

// `pose` is in front of the camera. The flash is so bright that a white card has radiance 1 which
// faces it, as far away as the object or as was said.
void place(const Pose& pose, const Mesh& shape, const FitOptions& options, v1::Scene& scene) {
  const Rotation<double> rotation = camera_rotation(options);
  v1::Mesh& mesh = *scene.mutable_object()->mutable_mesh();
  set_rotation(rotation.after(pose.rotation), *mesh.add_transforms()->mutable_rotate());
  set(*mesh.add_transforms()->mutable_translate(), rotation(pose.translation));
  for (v1::Light& light : *scene.mutable_lights()) {
    if (!light.has_sphere()) continue;
    const Vec3d flash = rotation.inverse()(to_vec(light.sphere().center()));
    const double range =
        options.card_distance.value_or(length(pose.to_scene(middle_of(bounds(shape))) - flash));
    const double seen = kFlashRadius / range;
    light.mutable_sphere()->set_radiance(static_cast<float>(1 / (seen * seen)));
  }
}

// ---- The pixels that count -------------------------------------------------------------------

// Those that show the object alone in the photograph and in the scene, and nothing that is clipped.
std::vector<float> counted(const FitPhotograph& photograph, const Mesh& mesh, const Pose& pose) {
  constexpr float kWhole = 0.99F, kClipped = 0.001F;
  constexpr int kFine = 4;
  const int side = photograph.side;
  const Silhouette silhouette(mesh, pose, view_of(photograph, kFine * side));
  std::vector<float> result(photograph.mask.size());
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const auto p = static_cast<size_t>(y) * static_cast<size_t>(side) + static_cast<size_t>(x);
      if (photograph.mask[p] < kWhole || photograph.clipped[p] > kClipped) continue;
      bool whole = true;
      for (int j = -1; j <= kFine && whole; ++j) {
        for (int i = -1; i <= kFine && whole; ++i) {
          const int fx = kFine * x + i, fy = kFine * y + j;
          whole = fx >= 0 && fy >= 0 && fx < kFine * side && fy < kFine * side &&
                  silhouette.covers(fx, fy);
        }
      }
      result[p] = whole ? 1 : 0;
    }
  }
  return result;
}

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
       .mask = counted(photograph, mesh, pose),
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
    const std::vector<float> mask = counted(photograph, mesh, one.pose);
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
  return disturbances_of(changes, counted(photograph, mesh, found.pose), photograph.side);
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
    FitPhotograph photograph = load(options.images[i], options);
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
    photograph.image.channels["mask.Y"] = counted(photograph, mesh, found.pose);
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

void write_report(const FitOptions& options, const fs::path& folder, const v1::FitResult& result) {
  constexpr uint32_t kSwatchSpp = 64;
  v1::Scene scene;
  parse_text_proto(read_file(result.poses(0).scene(), "scene"), result.poses(0).scene(), scene);
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
  v1::FitResult result;
  RefineOptions refine = options.refine;
  write_posed_scenes(options, folder, refine, result);
  set_unknowns(options, refine);
  const std::vector<v1::RefineResult> found = find_materials(refine);
  result.mutable_results()->Add(found.begin(), found.end());
  write_report(options, folder, result);
  options.refine.json ? print_result("{}\n", to_json(result))
                      : print_result(to_text(result, folder));
}

}  // namespace itn
