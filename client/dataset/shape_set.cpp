#include "client/dataset/shape_set.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <spdlog/spdlog.h>

#include "client/files/folder_files.h"
#include "client/geometry/mesh_file.h"
#include "client/geometry/mesh_repair.h"
#include "client/geometry/random_shape.h"
#include "common/error.h"
#include "common/geometry/shapes.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

// `say`: what was repaired, if anything was.
Mesh load_shape(const fs::path& file, bool repair, bool say) {
  Mesh mesh = load_mesh(file);
  const std::string name = file.string();
  if (repair) {
    MeshRepair done = repaired(mesh, name);
    if (say && done.changed()) spdlog::warn("{} is repaired: {}", name, done.describe());
    mesh = std::move(done.mesh);
  } else {
    require_closed(mesh, name, "--repair");
  }
  return normalized(mesh);
}

// What a shape keeps when it is turned, scaled or mirrored.
struct Invariants {
  size_t triangles;
  double roundness;  // the cube of the area over the square of the volume

  bool operator==(const Invariants& other) const {
    constexpr double kRounding = 1e-4;
    return triangles == other.triangles &&
           std::abs(roundness - other.roundness) < kRounding * roundness;
  }
};

Invariants invariants_of(const Mesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Vec3d p(mesh.vertices[a]), q(mesh.vertices[b]), r(mesh.vertices[c]);
    area += length(cross(q - p, r - p)) / 2;
  }
  const double volume = signed_volume(mesh);
  return {mesh.triangles.size(), area * area * area / (volume * volume)};
}

// The bytes of its file in a dataset.
std::string serialized(const Mesh& mesh) {
  v1::Mesh proto;
  set_triangles(proto, mesh);
  return proto.triangles().SerializeAsString();
}

Shape described(std::string name, const std::string& bytes, std::function<std::string()> to_file) {
  return {.name = std::move(name), .sha256 = to_hex(sha256(bytes)), .to_file = std::move(to_file)};
}

}  // namespace

Shape describe_shape(std::string name, const Mesh& mesh) {
  const auto bytes = std::make_shared<const std::string>(serialized(mesh));
  return described(std::move(name), *bytes, [bytes] { return *bytes; });
}

ShapeSet builtin_shape_set(std::span<const std::string> names) {
  for (const std::string& name : names) check_shape_name(name);
  ShapeSet set;
  for (const ShapeInfo& info : builtin_shapes()) {
    if (!names.empty() && std::ranges::find(names, info.name) == names.end()) continue;
    set.shapes.push_back(describe_shape(std::string(info.name), make_shape(info.name)));
  }
  std::ranges::sort(set.shapes, {}, &Shape::name);
  return set;
}

ShapeSet load_shape_set(const fs::path& folder, bool repair) {
  ShapeSet set;
  std::vector<Invariants> invariants;  // by shape
  for (const fs::path& file : files_with({".ply", ".obj", ".stl"}, folder)) {
    try {
      const Mesh mesh = load_shape(file, repair, true);
      const Invariants signature = invariants_of(mesh);
      if (const auto same = std::ranges::find(invariants, signature); same != invariants.end()) {
        set.alike.push_back(fmt::format(
            "{} is the shape of {} again, as it is, turned, scaled or mirrored: a test that has "
            "one "
            "of them while training has the other is too easy",
            file.string(), set.shapes[static_cast<size_t>(same - invariants.begin())].name));
      }
      invariants.push_back(signature);
      const auto load = [file, repair] { return serialized(load_shape(file, repair, false)); };
      set.shapes.push_back(described(file.stem().string(), serialized(mesh), load));
    } catch (const Error& error) {
      set.refused.emplace_back(error.what());
    }
  }
  if (set.shapes.empty()) {
    throw invalid_input(set.refused.empty()
                            ? fmt::format("{} holds no PLY, OBJ or STL file", folder.string())
                            : fmt::format("no mesh in {} can be used:\n  {}", folder.string(),
                                          fmt::join(set.refused, "\n  ")));
  }
  return set;
}

ShapeSet random_shape_set(uint32_t count, uint64_t seed) {
  ShapeSet set;
  for (uint64_t i = 0; i < count; ++i) {
    const auto to_file = [shape_seed = random_shape_seed(seed, i)] {
      return serialized(random_shape(shape_seed));
    };
    set.shapes.push_back({.name = random_shape_name(seed, i), .sha256 = "", .to_file = to_file});
  }
  std::ranges::sort(set.shapes, {}, &Shape::name);
  return set;
}

ShapeSet shape_set(const v1::ShapeSource& source) {
  switch (source.kind_case()) {
    case v1::ShapeSource::kFolder:
      try {
        return load_shape_set(source.folder().path(), source.folder().repair());
      } catch (const Error& error) {
        throw Error(error.kind(), fmt::format("shapes.folder: {}", error.what()));
      }
    case v1::ShapeSource::kRandom:
      return random_shape_set(source.random().count(), source.random().seed());
    default: {
      const auto& names = source.builtin().names();
      return builtin_shape_set(std::vector<std::string>(names.begin(), names.end()));
    }
  }
}

ShapeSet shape_set(const v1::Dataset& manifest) {
  ShapeSet set;
  for (const v1::DatasetShape& shape : manifest.shapes()) {
    set.shapes.push_back({.name = shape.name(), .sha256 = shape.sha256(), .to_file = {}});
  }
  return set;
}

}  // namespace itn
