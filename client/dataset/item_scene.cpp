#include "client/dataset/item_scene.h"

#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <vector>

#include "client/dataset/ground_texture.h"
#include "client/dataset/panorama.h"
#include "client/dataset/studio.h"
#include "client/image/spectrum.h"
#include "common/angle.h"
#include "common/error.h"
#include "common/scene/field_check.h"
#include "common/scene/material_proto.h"
#include "common/vec.h"
#include "server/renderer.h"

namespace itn {
namespace {

v1::Vec3 vec3_of(Vec3d v) {
  v1::Vec3 proto;
  proto.set_x(static_cast<float>(v.x));
  proto.set_y(static_cast<float>(v.y));
  proto.set_z(static_cast<float>(v.z));
  return proto;
}

Vec3d rotated(Vec3d v, const v1::Rotation& rotation) {
  const Vec3d axis =
      normalize(Vec3d{rotation.axis().x(), rotation.axis().y(), rotation.axis().z()});
  return turned_about(v, axis, rotation.angle_degrees() * kRadiansPerDegree);
}

struct Heights {
  double min = std::numeric_limits<double>::infinity(), max = -min;
};

// The least and the largest height of the mesh, turned about the point `centre`.
Heights heights_of(const v1::Triangles& triangles, const v1::Rotation& rotation, Vec3d centre) {
  static_assert(std::endian::native == std::endian::little);
  Heights heights;
  const std::string& bytes = triangles.positions();
  for (size_t at = 0; at + sizeof(float[3]) <= bytes.size(); at += sizeof(float[3])) {
    float p[3];
    std::memcpy(p, &bytes[at], sizeof p);
    const double y = (rotated(Vec3d{p[0], p[1], p[2]} - centre, rotation) + centre).y;
    heights.min = std::min(heights.min, y);
    heights.max = std::max(heights.max, y);
  }
  return heights;
}

void add_translation(v1::Mesh& mesh, Vec3d offset) {
  *mesh.add_transforms()->mutable_translate() = vec3_of(offset);
}

// Puts the object into the scene. Returns its middle: of the mesh's box, turned with it.
Vec3d add_object(v1::Scene& scene, const v1::DatasetItem& item, const v1::Triangles& triangles) {
  v1::Mesh& mesh = *scene.mutable_object()->mutable_mesh();
  *mesh.mutable_triangles() = triangles;
  if (item.has_boundary()) *scene.mutable_object()->mutable_rough_dielectric() = item.boundary();
  scene.mutable_object()->set_smooth_angle_degrees(item.smooth_angle_degrees());
  v1::Rotation rotation;  // none
  rotation.mutable_axis()->set_y(1);
  const Vec3d centre{0, heights_of(triangles, rotation, {}).max / 2, 0};
  if (!item.has_rotation()) return centre;
  rotation = item.rotation();
  const bool about_y = rotation.axis().x() == 0 && rotation.axis().z() == 0;
  if (about_y) {
    *mesh.add_transforms()->mutable_rotate() = rotation;
    return centre;
  }
  const double lift = -heights_of(triangles, rotation, centre).min;
  const Vec3d set_down = centre + Vec3d{0, lift, 0};
  add_translation(mesh, -centre);
  *mesh.add_transforms()->mutable_rotate() = rotation;
  add_translation(mesh, set_down);
  return set_down;
}

v1::ImageReflectance image_of(const v1::GroundTexture& texture) {
  const double turn = texture.turn_degrees() * kRadiansPerDegree, side = texture.image_size();
  v1::ImageReflectance image;
  *image.mutable_pixels() = mottled(texture);
  *image.mutable_edge_u() = vec3_of({side * std::cos(turn), 0, side * std::sin(turn)});
  *image.mutable_edge_v() = vec3_of({-side * std::sin(turn), 0, side * std::cos(turn)});
  return image;
}

void add_ground(v1::Scene& scene, const v1::DatasetItem& item) {
  if (!item.has_ground_reflectance() && !item.has_ground_checkerboard() &&
      !item.has_ground_texture() && !item.has_ground_color()) {
    return;
  }
  v1::Surface& ground = *scene.add_surfaces();
  ground.mutable_rectangle()->mutable_center();
  ground.mutable_rectangle()->mutable_half_u()->set_x(20);
  ground.mutable_rectangle()->mutable_half_v()->set_z(-20);
  if (item.has_ground_checkerboard()) {
    *ground.mutable_checkerboard() = item.ground_checkerboard();
  } else if (item.has_ground_texture()) {
    *ground.mutable_image() = image_of(item.ground_texture());
  } else if (item.has_ground_color()) {
    *ground.mutable_color() = item.ground_color();
  } else {
    ground.set_reflectance(item.ground_reflectance());
  }
}

// From the object to the camera.
Vec3d camera_direction(const v1::ItemCamera& camera) {
  const double pitch = camera.pitch_degrees() * kRadiansPerDegree;
  return {0, std::sin(pitch), -std::cos(pitch)};
}

using Colour = std::array<double, 3>;

// Of the room about a lamp or a flash, beside which that is gray.
template <typename Light>
Colour colour_of_room(const Light& light) {
  Colour colour = colour_of_black_body(light.ambient_temperature());
  const Colour lamp = colour_of_black_body(light.temperature());
  for (size_t c = 0; c < 3; ++c) colour[c] /= lamp[c];
  return with_unit_luminance(colour);
}

// Light from everywhere, `ambient` of what brings the light's irradiance.
template <typename Light>
void add_room(v1::Scene& scene, const Light& light) {
  const double radiance = light.ambient() * light.irradiance() / std::numbers::pi;
  if (!(radiance > 0)) return;
  if (light.temperature() == light.ambient_temperature()) {
    scene.add_lights()->mutable_constant()->set_radiance(static_cast<float>(radiance));
    return;
  }
  constexpr uint32_t kWidth = 4, kHeight = 2;
  const Colour colour = colour_of_room(light);
  std::vector<float> rgb;
  for (uint32_t i = 0; i < kWidth * kHeight; ++i) {
    for (const double c : colour) rgb.push_back(static_cast<float>(c * radiance));
  }
  *scene.add_lights()->mutable_environment_map()->mutable_pixels() =
      panorama_of(kWidth, kHeight, rgb);
}

// A flash is where the camera is, and infinitely far away.
void add_flash(v1::Scene& scene, const v1::Flash& flash, const v1::ItemCamera& camera) {
  v1::DirectionalLight& light = *scene.add_lights()->mutable_directional();
  *light.mutable_direction() = vec3_of(camera_direction(camera));
  light.set_irradiance(flash.irradiance());
  add_room(scene, flash);
}

// About the middle of the object.
void add_lamp(v1::Scene& scene, const v1::Lamp& lamp, Vec3d middle) {
  const Vec3d direction = direction_at(lamp.azimuth_degrees(), lamp.elevation_degrees());
  const v1::Vec3 position = vec3_of(middle + direction * lamp.distance());
  if (lamp.radius() > 0) {
    v1::SphereLight& light = *scene.add_lights()->mutable_sphere();
    *light.mutable_center() = position;
    light.set_radius(lamp.radius() * lamp.distance());
    light.set_radiance(
        static_cast<float>(lamp.irradiance() / (std::numbers::pi * lamp.radius() * lamp.radius())));
  } else {
    const double metres = lamp.distance() / 1000;
    v1::PointLight& light = *scene.add_lights()->mutable_point();
    *light.mutable_position() = position;
    light.set_intensity(static_cast<float>(lamp.irradiance() * metres * metres));
  }
  add_room(scene, lamp);
}

// The luminance of `pixels` is of irradiance 1; `channel` is what is shown.
void add_panorama(v1::Scene& scene, const v1::Panorama& panorama, const v1::Pixels* pixels,
                  v1::Film::Channel channel) {
  if (pixels == nullptr) throw Error(ErrorKind::kInternal, "the panorama of an item is missing");
  v1::EnvironmentMap& map = *scene.add_lights()->mutable_environment_map();
  *map.mutable_pixels() = *pixels;
  map.set_scale(panorama.irradiance());
  if (channel != v1::Film::LUMINANCE && channel != v1::Film::RGB) {
    const double irradiance = irradiance_from_above(*pixels, channel);
    if (!(irradiance > 0)) {
      throw invalid_input(fmt::format("the panorama {} is black above the horizon in {}",
                                      panorama.name(), v1::Film::Channel_Name(channel)));
    }
    map.set_scale(static_cast<float>(panorama.irradiance() / irradiance));
  }
  map.set_rotate_y_degrees(panorama.azimuth_degrees());
}

void add_lights(v1::Scene& scene, const v1::DatasetItem& item, const v1::Pixels* panorama,
                Vec3d middle) {
  const v1::ItemLight& light = item.light();
  switch (light.kind_case()) {
    case v1::ItemLight::kFlash: return add_flash(scene, light.flash(), item.camera());
    case v1::ItemLight::kLamp: return add_lamp(scene, light.lamp(), middle);
    case v1::ItemLight::kPanorama:
      return add_panorama(scene, light.panorama(), panorama, item.channel());
    case v1::ItemLight::kStudio:
      *scene.add_lights()->mutable_environment_map()->mutable_pixels() =
          studio_panorama(light.studio());
      return;
    default: *scene.add_lights()->mutable_sun_sky() = light.sun_sky();
  }
}

void add_camera(v1::Scene& scene, const v1::ItemCamera& item, Vec3d middle) {
  const Vec3d direction = camera_direction(item);
  const double frame = 1 / item.object_size();  // side of the frame at the object, in mm
  const Vec3d right = normalize(cross(-direction, Vec3d{0, 1, 0}));
  const Vec3d up = cross(right, -direction);
  v1::Camera& camera = *scene.mutable_camera();
  *camera.mutable_origin() = vec3_of(middle + direction * item.distance());
  // What it looks at is moved the other way.
  *camera.mutable_target() =
      vec3_of(middle - right * (item.offset_x() * frame) - up * (item.offset_y() * frame));
  camera.set_fov_degrees(
      static_cast<float>(2 * std::atan(frame / 2 / item.distance()) / kRadiansPerDegree));
}

void check_temperature(const std::string& name, float kelvin) {
  if (kelvin != 0) in_closed(name, kelvin, kMinTemperature, kMaxTemperature);
}

template <typename Light>
void check_temperatures(const Light& light, const std::string& path) {
  check_temperature(path + ".temperature", light.temperature());
  check_temperature(path + ".ambient_temperature", light.ambient_temperature());
}

// The size of a panorama follows from its smallest emitter.
void check_studio(const v1::Studio& studio, const std::string& path) {
  integer_in("the number of " + path + ".emitters", static_cast<uint64_t>(studio.emitters_size()),
             1, 16);
  check_temperature(path + ".walls_temperature", studio.walls_temperature());
  for (int i = 0; i < studio.emitters_size(); ++i) {
    const v1::Emitter& emitter = studio.emitters(i);
    const std::string field = fmt::format("{}.emitters[{}]", path, i);
    in_closed(field + ".elevation_degrees", emitter.elevation_degrees(), 0, 90);
    in_closed(field + ".size_degrees", emitter.size_degrees(), 4, 120);
    check_temperature(field + ".temperature", emitter.temperature());
    if (!emitter.is_lamp()) in_closed(field + ".aspect", emitter.aspect(), 0.25, 1);
  }
}

}  // namespace

bool may_be_seen(const v1::Lamp& lamp, const v1::ItemCamera& camera) {
  const Vec3d to_lamp =
      direction_at(lamp.azimuth_degrees(), lamp.elevation_degrees()) * lamp.distance();
  const Vec3d to_camera = camera_direction(camera);
  const double along = dot(to_lamp, to_camera), radius = lamp.radius() * lamp.distance();
  const double from_axis = length(to_lamp - to_camera * along);
  const double from_camera = camera.distance() - along;
  // From the axis to the farthest corner of the frame, at the object.
  const double corner =
      (std::sqrt(0.5) + std::hypot(camera.offset_x(), camera.offset_y())) / camera.object_size();
  const double reach = corner * std::max(0.0, from_camera + radius) / camera.distance();
  return from_camera > -radius && from_axis < reach + radius;
}

void check_item(const v1::DatasetItem& item, const std::string& path) {
  check_message(item, path);
  if (item.has_rotation()) non_zero(path + ".rotation.axis", item.rotation().axis());
  if (item.light().has_studio()) check_studio(item.light().studio(), path + ".light.studio");
  if (item.light().has_flash()) check_temperatures(item.light().flash(), path + ".light.flash");
  if (item.light().has_lamp()) check_temperatures(item.light().lamp(), path + ".light.lamp");
  if (!v1::Film::Channel_IsValid(item.channel())) {
    throw invalid_input(
        fmt::format("{}.channel is {}; it must be LUMINANCE, RED, GREEN, BLUE or RGB", path,
                    static_cast<int>(item.channel())));
  }
  const bool in_colour = item.channel() == v1::Film::RGB;
  if (item.colours_size() != (in_colour ? kMaxMaterials : 0) ||
      (in_colour && item.has_material())) {
    throw invalid_input(fmt::format(
        "{} has the channel {} and {} colours; RGB goes with three and no material, any other "
        "with none",
        path, v1::Film::Channel_Name(item.channel()), item.colours_size()));
  }
  for (const v1::Material& colour : item.colours()) {
    validate(from_proto(colour), path + ".colours");
    if (colour.g() != item.colours(0).g()) {
      throw invalid_input(fmt::format("{}.colours have the g {} and {}; they must have one", path,
                                      item.colours(0).g(), colour.g()));
    }
  }
}

namespace {

// On a surface that faces the light.
template <typename Light>
Colour white_of_room(const Light& light) {
  Colour white = colour_of_room(light);
  for (double& value : white) value = 1 + light.ambient() * value;
  return white;
}

// As if each emitter was faced.
Colour white_of_studio(const v1::Studio& studio) {
  double sum = 0;
  for (const v1::Emitter& emitter : studio.emitters()) sum += emitter.strength();
  Colour white{};
  const auto add = [&](double part, float kelvin) {
    const Colour colour = colour_of_black_body(kelvin);
    for (size_t c = 0; c < 3; ++c) white[c] += part * colour[c];
  };
  add(studio.walls(), studio.walls_temperature());
  for (const v1::Emitter& emitter : studio.emitters()) {
    add((1 - studio.walls()) * emitter.strength() / sum, emitter.temperature());
  }
  return white;
}

}  // namespace

std::array<double, 3> white_of(const v1::DatasetItem& item, const v1::Pixels* panorama) {
  const auto over_luminance = [&](const auto& light) {
    const double luminance = irradiance_from_above(light, v1::Film::LUMINANCE);
    std::array<double, 3> white{};
    for (const v1::Film::Channel colour : {v1::Film::RED, v1::Film::GREEN, v1::Film::BLUE}) {
      const double irradiance = irradiance_from_above(light, colour);
      if (!(irradiance > 0)) {
        throw invalid_input(fmt::format("the light of {} is black above the horizon in {}",
                                        item.file(), v1::Film::Channel_Name(colour)));
      }
      white.at(static_cast<size_t>(colour - v1::Film::RED)) = irradiance / luminance;
    }
    return white;
  };
  if (item.light().has_sun_sky()) return over_luminance(item.light().sun_sky());
  if (item.light().has_panorama() && panorama != nullptr) return over_luminance(*panorama);
  if (item.light().has_flash()) return white_of_room(item.light().flash());
  if (item.light().has_lamp()) return white_of_room(item.light().lamp());
  if (item.light().has_studio()) return white_of_studio(item.light().studio());
  return {1, 1, 1};
}

v1::Scene scene_of(const v1::DatasetItem& item, const v1::Triangles& triangles, uint32_t resolution,
                   const v1::Pixels* panorama) {
  v1::Scene scene;
  const Vec3d middle = add_object(scene, item, triangles);
  add_ground(scene, item);
  add_lights(scene, item, panorama, middle);
  add_camera(scene, item.camera(), middle);
  scene.mutable_film()->set_width(resolution);
  scene.mutable_film()->set_height(resolution);
  scene.mutable_film()->set_channel(item.channel());
  return scene;
}

}  // namespace itn
