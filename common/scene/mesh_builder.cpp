#include "common/scene/mesh_builder.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <utility>

#include "common/angle.h"
#include "common/error.h"
#include "common/geometry/shapes.h"
#include "common/scene/field_check.h"

namespace itn {
namespace {

constexpr Affine kIdentity = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

// First b, then a.
Affine compose(const Affine& a, const Affine& b) {
  Affine product{};
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) {
      double sum = column == 3 ? a[4 * row + 3] : 0;
      for (int k = 0; k < 3; ++k) sum += a[4 * row + k] * b[4 * k + column];
      product[4 * row + column] = sum;
    }
  }
  return product;
}

double determinant(const Affine& m) {
  return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
         m[2] * (m[4] * m[9] - m[5] * m[8]);
}

// The normal of a surface, outwards, where the surface takes the affine map: by the cofactors of
// its matrix, which turn it inwards in a mirror image.
Vec3d transformed_normal(const Affine& m, Vec3d n) {
  const Vec3d x{m[0], m[1], m[2]}, y{m[4], m[5], m[6]}, z{m[8], m[9], m[10]};
  const double side = determinant(m) < 0 ? -1 : 1;
  return Vec3d{dot(cross(y, z), n), dot(cross(z, x), n), dot(cross(x, y), n)} * side;
}

// Rodrigues' formula, R = cos I + sin [k]x + (1 - cos) k k^T.
Affine rotation(Vec3d axis, double angle) {
  const Vec3d k = normalize(axis);
  const double c = std::cos(angle);
  const double s = std::sin(angle);
  const double t = 1 - c;
  return {c + t * k.x * k.x,       t * k.x * k.y - s * k.z, t * k.x * k.z + s * k.y, 0,
          t * k.x * k.y + s * k.z, c + t * k.y * k.y,       t * k.y * k.z - s * k.x, 0,
          t * k.x * k.z - s * k.y, t * k.y * k.z + s * k.x, c + t * k.z * k.z,       0};
}

Affine build_scale(const std::string& field, const v1::Vec3& proto) {
  const Vec3d s = to_vec(proto);
  if (!(std::abs(s.x * s.y * s.z) > 0)) {
    throw invalid_input(
        fmt::format("{} is ({}, {}, {}); no factor may be 0", field, s.x, s.y, s.z));
  }
  return {s.x, 0, 0, 0, 0, s.y, 0, 0, 0, 0, s.z, 0};
}

Affine build_matrix(const std::string& field, const v1::Matrix& proto) {
  if (proto.m_size() != 16) {
    throw invalid_input(fmt::format("{}.m has {} numbers; it must have 16", field, proto.m_size()));
  }
  if (proto.m(12) != 0 || proto.m(13) != 0 || proto.m(14) != 0 || proto.m(15) != 1) {
    throw invalid_input(fmt::format("the last row of {}.m must be 0 0 0 1", field));
  }
  Affine affine{};
  for (int i = 0; i < 12; ++i) affine[i] = proto.m(i);
  if (!(std::abs(determinant(affine)) > 0)) {
    throw invalid_input(
        fmt::format("the determinant of {}.m is {}; it must not be 0", field, determinant(affine)));
  }
  return affine;
}

Affine build_transform(const std::string& field, const v1::Transform& proto) {
  switch (proto.kind_case()) {
    case v1::Transform::kTranslate: {
      const Vec3d t = to_vec(proto.translate());
      return {1, 0, 0, t.x, 0, 1, 0, t.y, 0, 0, 1, t.z};
    }
    case v1::Transform::kRotate:
      return rotation(non_zero(field + ".rotate.axis", proto.rotate().axis()),
                      proto.rotate().angle_degrees() * kRadiansPerDegree);
    case v1::Transform::kScale: return build_scale(field + ".scale", proto.scale());
    case v1::Transform::kMatrix: return build_matrix(field + ".matrix", proto.matrix());
    case v1::Transform::KIND_NOT_SET: break;
  }
  throw missing(field + ": one of translate, rotate, scale and matrix");
}

// Transforms first .. last - 1, one after the other.
Affine build_transforms(const std::string& field, const v1::Mesh& proto, int first, int last) {
  Affine affine = kIdentity;
  for (int i = first; i < last; ++i) {
    affine = compose(
        build_transform(fmt::format("{}.transforms[{}]", field, i), proto.transforms(i)), affine);
  }
  return affine;
}

Pose to_pose(const Affine& m) {
  return {{{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}}, {m[3], m[7], m[11]}};
}

}  // namespace

int first_of_pose(const v1::Mesh& proto) {
  int first = proto.transforms_size();
  while (first > 0 && (proto.transforms(first - 1).has_rotate() ||
                       proto.transforms(first - 1).has_translate())) {
    --first;
  }
  return first;
}

Pose pose_of(const std::string& field, const v1::Mesh& proto) {
  return to_pose(build_transforms(field, proto, first_of_pose(proto), proto.transforms_size()));
}

uint64_t triangle_count(const v1::Triangles& proto) {
  return proto.indices().size() / sizeof(std::array<uint32_t, 3>);
}

void check_extent(const std::string& field, const Mesh& mesh, const Pose& pose) {
  for (const Vec3f v : mesh.vertices) {
    check_position(field + ", after its transforms,", pose.to_scene(static_cast<Vec3d>(v)));
  }
}

Mesh MeshBuilder::build(const std::string& field, const v1::Mesh& proto) {
  Mesh mesh = transformed_source(field, proto, proto.transforms_size());
  if (!proto.triangles().corner_normals().empty()) {
    throw invalid_input(field +
                        ".triangles.corner_normals is set; only scene.object may have them");
  }
  check_extent(field, mesh);
  return mesh;
}

Mesh MeshBuilder::build_unposed(const std::string& field, const v1::Mesh& proto) {
  return transformed_source(field, proto, first_of_pose(proto));
}

Bounds object_bounds(const std::string& field, const v1::Object& object) {
  return bounds(MeshBuilder(UINT64_MAX).build(field + ".mesh", object.mesh()));
}

double unposed_size(const std::string& field, const v1::Object& object) {
  return longest_side(
      bounds(MeshBuilder(UINT64_MAX).build_unposed(field + ".mesh", object.mesh())));
}

std::vector<std::array<Vec3f, 3>> MeshBuilder::unposed_corner_normals(const std::string& field,
                                                                      const v1::Mesh& proto,
                                                                      size_t triangles) {
  if (proto.triangles().corner_normals().empty()) return {};
  const std::string name = field + ".triangles.corner_normals";
  auto normals = array_of<std::array<Vec3f, 3>>(name, proto.triangles().corner_normals());
  if (normals.size() != triangles || triangles != triangle_count(proto.triangles())) {
    throw invalid_input(
        fmt::format("{} is of {} triangles; the mesh has {}, of which {} repeat no vertex: all of "
                    "these numbers must be the same",
                    name, normals.size(), triangle_count(proto.triangles()), triangles));
  }
  const Affine affine = build_transforms(field, proto, 0, first_of_pose(proto));
  for (auto& corners : normals) {
    for (Vec3f& n : corners) {
      const double size = length(static_cast<Vec3d>(n));
      if (!(size > 0 && std::isfinite(size))) {
        throw invalid_input(fmt::format(
            "{} has a normal ({}, {}, {}); each must be finite and not 0", name, n.x, n.y, n.z));
      }
      n = static_cast<Vec3f>(
          normalize(transformed_normal(affine, static_cast<Vec3d>(n) * (1 / size))));
    }
    if (determinant(affine) < 0) std::swap(corners[1], corners[2]);
  }
  return normals;
}

void MeshBuilder::count(uint64_t triangles) {
  triangles_ += triangles;
  within_limit("the number of triangles of the scene", triangles_, max_triangles_);
}

// After normalisation and the transforms before number `end`.
Mesh MeshBuilder::transformed_source(const std::string& field, const v1::Mesh& proto, int end) {
  Mesh mesh = source(field, proto);
  if (proto.normalize()) mesh = normalized(mesh);
  if (end == 0) return mesh;
  const Affine affine = build_transforms(field, proto, 0, end);
  mesh = transformed(mesh, affine);
  // The triangles of a mirror image face outwards again.
  if (determinant(affine) < 0) {
    for (auto& [a, b, c] : mesh.triangles) std::swap(b, c);
  }
  return mesh;
}

Mesh MeshBuilder::source(const std::string& field, const v1::Mesh& proto) {
  if (proto.unit() != v1::MM) {
    throw invalid_input(fmt::format(
        "{}.unit is set; a worker takes millimetres alone: send the triangles in mm", field));
  }
  if (proto.repair()) {
    throw invalid_input(fmt::format(
        "{}.repair is set; a worker repairs nothing: send the repaired triangles", field));
  }
  switch (proto.source_case()) {
    case v1::Mesh::kTriangles: return from_triangles(field + ".triangles", proto.triangles());
    case v1::Mesh::kBuiltin: return shape(proto.builtin());
    case v1::Mesh::kPath:
      throw invalid_input(
          fmt::format("{}.path is set; a worker opens no files: send the triangles", field));
    case v1::Mesh::SOURCE_NOT_SET: break;
  }
  throw missing(field + ": one of triangles, path and builtin");
}

// Made once for a scene, however many places it has in it: that costs most. It is as small as the
// shapes are, and counts for each place.
const Mesh& MeshBuilder::shape(const std::string& name) {
  auto made = shapes_.find(name);
  if (made == shapes_.end()) made = shapes_.emplace(name, make_shape(name, stop_)).first;
  count(made->second.triangles.size());
  return made->second;
}

Mesh MeshBuilder::from_triangles(const std::string& field, const v1::Triangles& proto) {
  count(triangle_count(proto));
  Mesh mesh{array_of<Vec3f>(field + ".positions", proto.positions()),
            array_of<std::array<uint32_t, 3>>(field + ".indices", proto.indices())};
  validate_triangles(mesh, field);
  mesh = welded(mesh);
  if (mesh.triangles.empty()) {
    throw invalid_input(fmt::format("{} has only triangles that repeat a vertex", field));
  }
  return mesh;
}

}  // namespace itn
