#include "server/scene_compiler/object_builder.h"

#include <fmt/format.h>

#include "common/angle.h"
#include "common/error.h"
#include "common/scene/field_check.h"
#include "common/scene/material_proto.h"
#include "common/scene/scene_bytes.h"
#include "server/scene_compiler/field_reader.h"
#include "server/tracer/geometry/object.h"

namespace itn {
namespace {

// The key of all that an object's mesh depends on, but for its pose.
std::string object_key(const v1::Mesh& proto) {
  v1::Mesh rest;
  rest.set_normalize(proto.normalize());
  if (proto.has_builtin()) rest.set_builtin(proto.builtin());
  for (int i = 0; i < first_of_pose(proto); ++i) *rest.add_transforms() = proto.transforms(i);
  return "object" + sha256(rest.SerializeAsString()) + sha256(proto.triangles().positions()) +
         sha256(proto.triangles().indices());
}

Mesh build_rectangle(const std::string& field, const v1::Rectangle& proto) {
  const Vec3d center = to_vec(proto.center());
  const Vec3d u = non_zero(field + ".half_u", proto.half_u());
  const Vec3d v = non_zero(field + ".half_v", proto.half_v());
  if (!(length(cross(u, v)) > 1e-6 * length(u) * length(v))) {
    throw invalid_input(fmt::format("{}: half_u and half_v must not be parallel", field));
  }
  Mesh mesh;
  for (const Vec3d corner : {center - u - v, center + u - v, center + u + v, center - u + v}) {
    mesh.vertices.push_back(static_cast<Vec3f>(check_position(field, corner)));
  }
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

double build_smooth_angle(const std::string& field, double degrees) {
  return in_closed(field + ".smooth_angle_degrees", degrees, 0, 180) * kRadiansPerDegree;
}

tracer::Reflectance build_reflectance(const std::string& field, const v1::Surface& proto) {
  tracer::UniformReflectance uniform;
  const FieldReader reader(field, proto);
  tracer::UniformReflectance::fields(uniform, reader);
  const auto* pattern = set_field(proto, "pattern");
  if (pattern == nullptr) return uniform;
  if (proto.has_reflectance()) {
    throw invalid_input(
        fmt::format("{} has reflectance and {}; it must have one of them", field, pattern->name()));
  }
  return read_kind<tracer::Reflectance>(field, proto, "pattern");
}

}  // namespace

tracer::Boundary build_boundary(const std::string& field, const v1::Object& proto) {
  if (set_field(proto, "refraction") == nullptr) return tracer::IndexMatched{};
  return read_kind<tracer::Boundary>(field, proto, "refraction");
}

void build_object(const std::string& field, const v1::Object& proto, MeshBuilder& meshes,
                  PartCache* parts, tracer::SceneDescription& scene) {
  const std::string name = field + ".mesh";
  const v1::Mesh& shape = proto.mesh();
  scene.pose = pose_of(name, shape);
  if (parts != nullptr) {
    scene.object_key = object_key(shape);
    scene.compiled_object = parts->find<tracer::Object>(scene.object_key);
  }
  if (scene.compiled_object) {
    const size_t held = scene.compiled_object->mesh.triangles.size();
    meshes.count(shape.has_triangles() ? triangle_count(shape.triangles()) : held);
  } else {
    scene.object = meshes.build_unposed(name, shape);
  }
  const Mesh& mesh = scene.compiled_object ? scene.compiled_object->mesh : scene.object;
  check_extent(name, mesh, scene.pose);
  scene.corner_normals = meshes.unposed_corner_normals(name, shape, mesh.triangles.size());
  scene.boundary = build_boundary(field, proto);
  scene.smooth_angle = build_smooth_angle(field, proto.smooth_angle_degrees());
}

tracer::OtherObject build_other_object(const std::string& field, const v1::Object& proto,
                                       MeshBuilder& meshes) {
  if (proto.has_medium()) {
    throw invalid_input(field + " has a medium; a worker needs its material instead");
  }
  if (proto.material().empty()) throw missing(field + ".material");
  if (proto.material_size() > 1) {
    throw invalid_input(
        fmt::format("{} has {} materials; a worker needs one, of the channel that "
                    "the film shows",
                    field, proto.material_size()));
  }
  const Material material = from_proto(proto.material(0));
  validate(material, field + ".material");
  return {meshes.build(field + ".mesh", proto.mesh()), material, build_boundary(field, proto),
          build_smooth_angle(field, proto.smooth_angle_degrees())};
}

tracer::DiffuseSurface build_surface(const std::string& field, const v1::Surface& proto,
                                     MeshBuilder& meshes) {
  tracer::DiffuseSurface surface;
  surface.reflectance = build_reflectance(field, proto);
  surface.smooth_angle = build_smooth_angle(field, proto.smooth_angle_degrees());
  switch (proto.shape_case()) {
    case v1::Surface::kRectangle:
      meshes.count(2);
      surface.mesh = build_rectangle(field + ".rectangle", proto.rectangle());
      return surface;
    case v1::Surface::kMesh:
      surface.mesh = meshes.build(field + ".mesh", proto.mesh());
      return surface;
    case v1::Surface::SHAPE_NOT_SET: break;
  }
  throw missing(field + ": one of rectangle and mesh");
}

}  // namespace itn
