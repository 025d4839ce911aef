#include "client/commands/fit_photograph.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <numbers>
#include <optional>
#include <span>

#include "client/dataset/panorama.h"
#include "client/interrupt.h"
#include "client/predict/photograph_input.h"
#include "client/scene/panorama_file.h"
#include "client/scene/scene_file.h"
#include "common/angle.h"
#include "common/error.h"
#include "common/geometry/shapes.h"
#include "common/scene/field_check.h"
#include "common/scene/mesh_builder.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

// How far before the camera the point is that it looks at, in mm; any distance would do.
constexpr double kAhead = 1000;

// The radius of a phone's flash, in mm. It has one as lights without a size have no derivatives in
// their position.
constexpr float kFlashRadius = 2;

void set(v1::Vec3& to, Vec3d from) {
  to.set_x(static_cast<float>(from.x));
  to.set_y(static_cast<float>(from.y));
  to.set_z(static_cast<float>(from.z));
}

// Writes a rotation as an axis and an angle.
void set_rotation(const Rotation<double>& rotation, v1::Rotation& proto) {
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
  set(*proto.mutable_axis(), normalize(axis));
  proto.set_angle_degrees(static_cast<float>(angle / kRadiansPerDegree));
}

Rotation<double> looking_down(double degrees) {
  const double angle = degrees * kRadiansPerDegree;
  const double c = std::cos(angle), s = std::sin(angle);
  return {{1, 0, 0}, {0, c, s}, {0, -s, c}};
}

// Scales a mesh so that its longest side is `size[0]`, or its sides along x, y and z are `size`, in
// mm.
void set_size(const std::vector<double>& size, v1::Mesh& mesh) {
  mesh.set_normalize(true);
  Vec3d scale{size[0], size[0], size[0]};
  if (size.size() == 3) {
    v1::Scene of_one_mm;
    *of_one_mm.mutable_object()->mutable_mesh() = mesh;
    load_files(of_one_mm, {});
    const Bounds box = object_bounds("object", of_one_mm.object());
    const Vec3d sides = Vec3d(box.max) - Vec3d(box.min);
    scale = {size[0] / sides.x, size[1] / sides.y, size[2] / sides.z};
  }
  set(*mesh.add_transforms()->mutable_scale(), scale);
}

// The radiance of a white card in the light of the scene, by channel: before a flash 1 (place());
// in a panorama that of a card that faces up.
std::vector<double> white_in_light(const std::vector<std::string>& channels,
                                   const FitOptions& options) {
  std::vector<double> white(channels.size(), 1);
  if (is_by_flash(options)) return white;
  const v1::Pixels panorama = load_panorama(options.light);
  for (size_t c = 0; c < white.size(); ++c) {
    const v1::Film::Channel film = white.size() == 3 ? kColours[c] : v1::Film::LUMINANCE;
    white[c] = irradiance_from_above(panorama, film) / std::numbers::pi;
    if (white[c] > 0) continue;
    throw invalid_input(
        fmt::format("{} is black above the horizon: it does not light a gray card that faces up",
                    options.light));
  }
  return white;
}

Exposure exposure_of(const PhotographFile& file) {
  return {
      .seconds = file.exposure_seconds, .f_number = file.f_number, .iso = file.iso, .factors = {}};
}

void require_same_exposure(const Exposure& first, const Exposure& other, const std::string& name) {
  if (first.factors.size() != other.factors.size()) {
    throw invalid_input(name + " has other colours than the first photograph");
  }
  const auto in_words = [](const Exposure& one) {
    return fmt::format("{:.4g} s, f/{:.3g}, ISO {:.0f}", one.seconds.value_or(0),
                       one.f_number.value_or(0), one.iso.value_or(0));
  };
  constexpr double kAlike = 1.05;
  const auto differ = [](std::optional<double> a, std::optional<double> b) {
    return a && b && std::max(*a, *b) > kAlike * std::min(*a, *b);
  };
  if (differ(first.seconds, other.seconds) || differ(first.f_number, other.f_number) ||
      differ(first.iso, other.iso)) {
    throw invalid_input(fmt::format(
        "{} was exposed otherwise than the first photograph ({}; {}): photographs that are fitted "
        "together are by one exposure, set by hand",
        name, in_words(other), in_words(first)));
  }
}

// 1 where a pixel of the object that is not clipped is of such a square of the silhouette; else 0.
std::vector<float> pixels_where(const FitPhotograph& photograph, const Mesh& mesh, const Pose& pose,
                                bool (Silhouette::*is_such)(int left, int top, int side) const) {
  constexpr int kFine = 4;
  const int side = photograph.side;
  const Silhouette silhouette(mesh, pose, view_of(photograph, kFine * side));
  std::vector<float> result(photograph.mask.size());
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const auto p = static_cast<size_t>(y) * static_cast<size_t>(side) + static_cast<size_t>(x);
      if (photograph.mask[p] < kWholePixel || photograph.clipped[p] > kClippedPixel) continue;
      result[p] = (silhouette.*is_such)(kFine * x, kFine * y, kFine) ? 1 : 0;
    }
  }
  return result;
}

}  // namespace

double focal_in_pixels(const PhotographContent& content, const std::string& name,
                       std::optional<double> length_35mm) {
  constexpr double kDiagonal = 43.2666;  // of 36 x 24 mm
  const std::optional<double> in_35mm = length_35mm ? length_35mm : content.file.focal_length_35mm;
  if (!in_35mm) {
    throw invalid_input(fmt::format(
        "{} does not say with which focal length it was taken (EXIF FocalLengthIn35mmFilm); "
        "--focal-length does, in mm of a 35 mm camera: of a phone's main camera some 26",
        name));
  }
  return *in_35mm / kDiagonal * std::hypot(content.width(), content.height());
}

FitPhotograph load_fit_photograph(const std::string& name, const FitOptions& options,
                                  const std::optional<Exposure>& first) {
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
  photograph.focal = focal_in_pixels(content, name, options.focal_length_35mm);
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
  photograph.exposure = exposure_of(content.file);
  std::vector<double>& factors = photograph.exposure.factors;
  factors.assign(static_cast<size_t>(channels), 1);
  if (first) {
    require_same_exposure(*first, photograph.exposure, name);
    factors = first->factors;
  } else if (reading.gray_card) {
    factors = white_in_light(content.channels, options);
    const std::vector<double> white = white_of_card(marked, name, reading);
    for (size_t c = 0; c < white.size(); ++c) factors[c] /= white[c];
  }
  const std::vector<float> pixels = at_side(marked.pixels, channels, photograph.side);
  photograph.image.width = photograph.image.height = photograph.side;
  for (size_t c = 0; c < factors.size(); ++c) {
    std::vector<float>& plane = photograph.image.channels[content.channels[c]];
    for (size_t p = c; p < pixels.size(); p += factors.size()) {
      plane.push_back(static_cast<float>(double{pixels[p]} * factors[c]));
    }
  }
  if (options.luminance) {
    Image luminance;
    luminance.width = luminance.height = photograph.side;
    luminance.channels["Y"] =
        radiance_of(photograph.image, photograph.channels, v1::Film::LUMINANCE);
    photograph.image = luminance;
    photograph.channels = {"Y"};
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

fs::path file_of(const fs::path& folder, const std::string& stem, const std::string& extension,
                 const FitOptions& options, size_t i) {
  return folder / (options.images.size() == 1 ? stem + extension
                                              : fmt::format("{}_{}{}", stem, i, extension));
}

fs::path photograph_file(const fs::path& folder, const FitOptions& options, size_t i) {
  return file_of(folder, "photograph", ".exr", options, i);
}

PinholeView view_of(const FitPhotograph& photograph, int side) {
  const double by = static_cast<double>(side) / photograph.square.side;
  return {photograph.focal * by, (0.5 * photograph.width - photograph.square.left) * by,
          (0.5 * photograph.height - photograph.square.top) * by, side};
}

namespace {

uint32_t block_of(const std::vector<float>& mask, int width, const std::string& name) {
  constexpr int kBlocksPerSide = 24;
  constexpr double kLeast = 60;
  const auto pixels = static_cast<double>(std::ranges::count_if(mask, is_on_object));
  if (pixels < kLeast) {
    throw invalid_input(fmt::format(
        "{}: only {} pixels, of {} a row, show the object alone, away from its edge and unclipped; "
        "{} are the least. Photograph it larger and darker, or see --resolution",
        name, pixels, width, kLeast));
  }
  const int side = std::min(width / kBlocksPerSide, static_cast<int>(std::sqrt(pixels / kLeast)));
  return static_cast<uint32_t>(std::max(1, side));
}

// Pixels of the longer side of what bounds the object.
int extent(const std::vector<float>& mask, int width) {
  constexpr int kNone = std::numeric_limits<int>::max();
  int left = kNone, right = 0, top = kNone, bottom = 0;
  for (int p = 0; p < static_cast<int>(mask.size()); ++p) {
    if (!is_on_object(mask[static_cast<size_t>(p)])) continue;
    left = std::min(left, p % width);
    right = std::max(right, p % width);
    top = std::min(top, p / width);
    bottom = std::max(bottom, p / width);
  }
  return std::max(right - left, bottom - top);
}

}  // namespace

void allow_for_likeness(const std::vector<float>& mask, int width, const std::string& name,
                        double shape_error, RefineOptions& refine) {
  // By renders of four objects that are finer than their meshes, and moved by 0.2 % of their size
  // (RMS) in waves of a quarter of the size to all of it: the radiance, the mean of 5 x 5 pixels of
  // 90 across the object, changes by 2.1, 1.4, 1.5 and 3.2 %, alike over about a fifteenth.
  constexpr double kByShape = 9, kParts = 15;
  v1::RefineSettings& settings = refine.settings;
  const bool is_first = settings.model_error_length() == 0;
  const uint32_t block = block_of(mask, width, name);
  settings.set_block(is_first ? block : std::min(settings.block(), block));
  settings.set_model_error(kByShape * shape_error);
  settings.set_model_error_length(
      std::max({settings.model_error_length(), extent(mask, width) / kParts, 1.0}));
}

bool is_builtin(const std::string& shape) {
  const auto shapes = builtin_shapes();
  return std::ranges::find(shapes, shape, &ShapeInfo::name) != shapes.end();
}

bool is_by_flash(const FitOptions& options) {
  return options.light == "flash";
}

bool is_in_sun(const FitOptions& options) {
  return options.light == "sun";
}

double card_error_of(const FitOptions& options) {
  if (!options.photograph.gray_card) return 0;
  return options.card_error.value_or(is_by_flash(options) ? 0.03 : 0.06);
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
  if (!options.object_size.empty()) set_size(options.object_size, mesh);
  object.mutable_rough_dielectric()->set_index(static_cast<float>(options.index));
  object.mutable_rough_dielectric()->set_roughness(0.25F);
  object.set_smooth_angle_degrees(30);

  v1::Camera& camera = *scene.mutable_camera();
  set(*camera.mutable_origin(), {});
  set(*camera.mutable_target(), {0, 0, -kAhead});
  set(*camera.mutable_up(), {0, 1, 0});
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
  scene.mutable_film()->set_channel(photograph.channels.size() == 3 ? v1::Film::RGB
                                                                    : v1::Film::LUMINANCE);

  v1::Light& light = *scene.add_lights();
  if (is_by_flash(options)) {
    const auto& offset = options.flash_offset;
    set(*light.mutable_sphere()->mutable_center(), {offset[0], offset[1], offset[2]});
    light.mutable_sphere()->set_radius(kFlashRadius);
  } else if (is_in_sun(options)) {
    light.mutable_sun_sky();
  } else {
    light.mutable_environment_map()->set_path(fs::absolute(options.light).string());
  }
  return scene;
}

double flash_range(const Stand& stand, const Mesh& shape, const FitOptions& options) {
  const auto& offset = options.flash_offset;
  return length(stand.pose.to_scene(middle_of(bounds(shape))) -
                Vec3d{offset[0], offset[1], offset[2]});
}

void place(const Stand& stand, const Mesh& shape, const FitOptions& options, v1::Scene& scene) {
  const Pose& pose = stand.pose;
  const Rotation<double> rotation = looking_down(stand.camera_down);
  set(*scene.mutable_camera()->mutable_target(), rotation(Vec3d{0, 0, -kAhead}));
  set(*scene.mutable_camera()->mutable_up(), rotation(Vec3d{0, 1, 0}));
  v1::Mesh& mesh = *scene.mutable_object()->mutable_mesh();
  set_rotation(rotation.after(pose.rotation), *mesh.add_transforms()->mutable_rotate());
  set(*mesh.add_transforms()->mutable_translate(), rotation(pose.translation));
  for (v1::Light& light : *scene.mutable_lights()) {
    if (light.has_environment_map()) {
      // The left edge of a panorama lies along -z, where the camera looks; its middle is to do so.
      light.mutable_environment_map()->set_rotate_y_degrees(
          static_cast<float>(180 + stand.panorama_turn));
    }
    if (light.has_sun_sky()) {
      light.mutable_sun_sky()->set_sun_azimuth_degrees(static_cast<float>(-stand.panorama_turn));
      light.mutable_sun_sky()->set_sun_elevation_degrees(
          static_cast<float>(std::clamp(stand.sun_elevation, 0.0, 90.0)));
    }
    if (!light.has_sphere()) continue;
    const double range = options.card_distance.value_or(flash_range(stand, shape, options));
    const double seen = kFlashRadius / range;
    light.mutable_sphere()->set_radiance(static_cast<float>(1 / (seen * seen)));
  }
}

std::vector<float> pixels_of_object(const FitPhotograph& photograph, const Mesh& mesh,
                                    const Pose& pose) {
  return pixels_where(photograph, mesh, pose, &Silhouette::covers_square);
}

std::vector<float> pixels_of_surfaces(const FitPhotograph& photograph, const Mesh& mesh,
                                      const Pose& pose) {
  return pixels_where(photograph, mesh, pose, &Silhouette::shows_one_surface);
}

}  // namespace itn
