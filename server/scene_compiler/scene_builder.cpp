#include "server/scene_compiler/scene_builder.h"

#include <fmt/format.h>

#include "common/angle.h"
#include "common/error.h"
#include "common/part_cache.h"
#include "common/scene/field_check.h"
#include "common/scene/mesh_builder.h"
#include "common/scene/scene_bytes.h"
#include "server/scene_compiler/field_reader.h"
#include "server/scene_compiler/object_builder.h"
#include "server/wire/wire_check.h"

namespace itn {
namespace {

const ElementLimits kSceneElementLimits = {{"itn.v1.Scene.surfaces", kMaxSurfaces},
                                           {"itn.v1.Scene.lights", kMaxLights},
                                           {"itn.v1.Scene.other_objects", kMaxOtherObjects},
                                           {"itn.v1.Object.material", kMaxMaterials},
                                           {"itn.v1.Mesh.transforms", kMaxTransforms}};

std::string other_object(int number) {
  return fmt::format("scene.other_objects[{}]", number);
}

void check_object(const std::string& field, const v1::Object& object) {
  if (!object.has_mesh()) throw missing(field + ".mesh");
  if (object.boundary() != v1::Object::INDEX_MATCHED) {
    throw invalid_input(fmt::format("{}.boundary has the unknown value {}", field,
                                    static_cast<int>(object.boundary())));
  }
}

void check_required(const v1::Scene& scene) {
  if (!scene.has_object()) throw missing("scene.object");
  check_object("scene.object", scene.object());
  integer_in("the number of scene.other_objects", scene.other_objects_size(), 0, kMaxOtherObjects);
  for (int i = 0; i < scene.other_objects_size(); ++i) {
    check_object(other_object(i), scene.other_objects(i));
  }
  if (scene.lights().empty()) throw missing("scene.lights: at least one");
  if (!scene.has_camera()) throw missing("scene.camera");
  if (!scene.has_film()) throw missing("scene.film");
  integer_in("the number of scene.lights", scene.lights_size(), 1, kMaxLights);
}

tracer::CameraDescription build_camera(const v1::Camera& proto) {
  tracer::CameraDescription camera;
  camera.origin = check_position("scene.camera.origin", to_vec(proto.origin()));
  camera.target = check_position("scene.camera.target", to_vec(proto.target()));
  const Vec3d direction = camera.target - camera.origin;
  if (!(length(direction) > 0)) {
    throw invalid_input("scene.camera.target is the origin of the camera; they must differ");
  }
  if (proto.has_up()) camera.up = non_zero("scene.camera.up", proto.up());
  if (!(length(cross(direction, camera.up)) > 1e-6 * length(direction) * length(camera.up))) {
    throw invalid_input("scene.camera.up is parallel to the direction of view; it must not be");
  }
  double fov = 40;
  if (proto.has_fov_degrees()) {
    fov = proto.fov_degrees();
    if (!(fov > 0 && fov < 179)) {
      throw invalid_input(
          fmt::format("scene.camera.fov_degrees is {}; it must be in (0, 179)", fov));
    }
  }
  camera.fov = fov * kRadiansPerDegree;
  constexpr double kFar = 10;
  const FieldReader fields("scene.camera", proto);
  fields.number("principal_x", camera.principal_x, -kFar, kFar);
  fields.number("principal_y", camera.principal_y, -kFar, kFar);
  fields.number("k_1", camera.k_1, -kFar, kFar);
  fields.number("k_2", camera.k_2, -kFar, kFar);
  const FieldReader crop("scene.camera.crop", proto.crop());
  crop.number("left", camera.left, -kFar, kFar);
  crop.number("top", camera.top, -kFar, kFar);
  crop.number("right", camera.right, -kFar, kFar);
  crop.number("bottom", camera.bottom, -kFar, kFar);
  return camera;
}

tracer::FilmDescription build_film(const v1::Film& proto, uint64_t max_pixels) {
  tracer::FilmDescription film;
  film.width = static_cast<int>(integer_in("scene.film.width", proto.width(), 1, 65536));
  film.height = static_cast<int>(integer_in("scene.film.height", proto.height(), 1, 65536));
  within_limit("the number of pixels of scene.film", uint64_t{proto.width()} * proto.height(),
               max_pixels);
  film.channel = build_channel(proto.channel());
  return film;
}

template <typename Messages>
std::string digest_of(const Messages& messages) {
  std::string bytes;
  for (const auto& message : messages) {
    const std::string one = message.SerializeAsString();
    bytes += part_key("", one.size()) + one;
  }
  return sha256(bytes);
}

}  // namespace

tracer::Channel build_channel(v1::Film::Channel channel) {
  switch (channel) {
    case v1::Film::LUMINANCE: return tracer::Channel::kLuminance;
    case v1::Film::RED: return tracer::Channel::kRed;
    case v1::Film::GREEN: return tracer::Channel::kGreen;
    case v1::Film::BLUE: return tracer::Channel::kBlue;
    case v1::Film::RGB: return tracer::Channel::kRgb;
    default: break;
  }
  throw invalid_input(
      fmt::format("scene.film.channel has the unknown value {}", static_cast<int>(channel)));
}

tracer::Rgb build_light_colour(const std::string& field, const v1::Light& proto) {
  tracer::Rgb rgb{1, 1, 1};
  if (!proto.has_color()) return rgb;
  const FieldReader reader(field + ".color", proto.color());
  reader.number("red", rgb[0], 0, 1e6);
  reader.number("green", rgb[1], 0, 1e6);
  reader.number("blue", rgb[2], 0, 1e6);
  if (!(luminance(rgb) > 0)) {
    throw invalid_input(field + ".color: red, green and blue are 0; one of them must shine");
  }
  return rgb;
}

tracer::LightDescription build_light(const std::string& field, const v1::Light& proto) {
  return read_kind<tracer::LightDescription>(field, proto, "kind");
}

v1::Scene parse_scene(const std::string& bytes) {
  v1::Scene scene;
  parse_checked(bytes, "scene", kSceneElementLimits, scene);
  return scene;
}

tracer::SceneDescription build_scene(const v1::Scene& scene, const RenderLimits& limits,
                                     PartCache* parts, const std::stop_token& stop) {
  check_required(scene);
  check_message(scene, "scene");
  tracer::SceneDescription description;
  description.film = build_film(scene.film(), limits.max_pixels);
  description.camera = build_camera(scene.camera());
  MeshBuilder meshes(limits.max_triangles, stop);
  build_object("scene.object", scene.object(), meshes, parts, description);
  for (int i = 0; i < scene.other_objects_size(); ++i) {
    description.other_objects.push_back(
        build_other_object(other_object(i), scene.other_objects(i), meshes));
  }
  for (int i = 0; i < scene.surfaces_size(); ++i) {
    description.surfaces.push_back(
        build_surface(fmt::format("scene.surfaces[{}]", i), scene.surfaces(i), meshes));
  }
  if (parts != nullptr) {
    description.other_objects_digest = digest_of(scene.other_objects());
    description.surfaces_digest = digest_of(scene.surfaces());
  }
  for (int i = 0; i < scene.lights_size(); ++i) {
    const std::string field = fmt::format("scene.lights[{}]", i);
    description.lights.push_back(build_light(field, scene.lights(i)));
    description.light_colours.push_back(build_light_colour(field, scene.lights(i)));
  }
  return description;
}

}  // namespace itn
