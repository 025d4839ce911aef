#include "client/geometry/mesh_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <string>

#include "client/geometry/mesh_formats.h"
#include "common/error.h"
#include "common/files/read_file.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

struct MeshFormat {
  const char* extension;
  Mesh (*read)(std::string_view content, const std::string& what);
};
constexpr MeshFormat kFormats[] = {{".ply", read_ply}, {".obj", read_obj}, {".stl", read_stl}};

std::string lower_case_extension(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

}  // namespace

Mesh load_mesh(const fs::path& path) {
  const std::string extension = lower_case_extension(path), what = path.string();
  const auto* const format = std::ranges::find(kFormats, extension, &MeshFormat::extension);
  if (format == std::end(kFormats)) {
    throw invalid_input(
        fmt::format("{}: a mesh must be a .ply, .obj or .stl file, not \"{}\"", what, extension));
  }
  const std::string content = read_file(path, "mesh");
  std::string_view text = content;
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";  // that editors put before UTF-8
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  Mesh mesh = format->read(text, what);
  validate_triangles(mesh, what);
  mesh = welded(mesh);
  validate_triangles(mesh, what);
  return mesh;
}

std::string encode_ply(const Mesh& mesh) {
  return encode_ply(mesh, {});
}

std::string encode_ply(const Mesh& mesh, std::span<const std::array<Vec3f, 3>> corner_normals) {
  static_assert(std::endian::native == std::endian::little && sizeof(Vec3f) == 3 * sizeof(float));
  const bool flat = corner_normals.empty();
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment lengths in mm\nelement vertex {}\n"
      "property float x\nproperty float y\nproperty float z\n{}element face {}\n"
      "property list uchar uint vertex_indices\nend_header\n",
      flat ? mesh.vertices.size() : 3 * mesh.triangles.size(),
      flat ? "" : "property float nx\nproperty float ny\nproperty float nz\n",
      mesh.triangles.size());
  const auto append = [&bytes](const void* values, size_t size) {
    bytes.append(static_cast<const char*>(values), size);
  };
  if (flat) append(mesh.vertices.data(), mesh.vertices.size() * sizeof(Vec3f));
  for (size_t t = 0; t < corner_normals.size(); ++t) {
    for (size_t k = 0; k < 3; ++k) {
      append(&mesh.vertices[mesh.triangles[t][k]], sizeof(Vec3f));
      append(&corner_normals[t][k], sizeof(Vec3f));
    }
  }
  uint32_t next = 0;
  for (std::array<uint32_t, 3> triangle : mesh.triangles) {
    if (!flat) triangle = {next, next + 1, next + 2};
    next += 3;
    bytes += '\3';
    append(triangle.data(), sizeof triangle);
  }
  return bytes;
}

}  // namespace itn
