#include "common/geometry/mesh_file.h"

#include <fmt/format.h>

#include <assimp/IOSystem.hpp>
#include <assimp/Importer.hpp>
#include <bit>
#include <cctype>
#include <cstring>
#include <string>

#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include "common/error.h"
#include "common/files/read_file.h"
#include "common/geometry/obj_check.h"
#include "common/geometry/ply_check.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

std::string lower_case_extension(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

Error cut_short(const fs::path& path, const std::string& reason) {
  return Error(ErrorKind::kDataLoss, fmt::format("{} was cut short: {}", path.string(), reason));
}

// Assimp computes the size of a binary STL file in 32 bits: a count that is a lie makes it allocate
// gigabytes.
void check_stl(const std::string& content, const fs::path& path) {
  constexpr size_t kHeader = 80, kTriangle = 50;
  uint32_t count = 0;
  const size_t begin = kHeader + sizeof count;
  const bool is_text = content.starts_with("solid");
  if (content.size() < begin) {
    if (is_text) return;
    throw cut_short(path, "a binary STL file has at least 84 bytes");
  }
  std::memcpy(&count, content.data() + kHeader, sizeof count);
  const uint64_t expected = begin + uint64_t{count} * kTriangle;
  const bool taken_for_binary = static_cast<uint32_t>(expected) == content.size();
  if ((!is_text || taken_for_binary) && expected > content.size()) {
    throw cut_short(path, fmt::format("it promises {} triangles, {} bytes; it has {}", count,
                                      expected, content.size()));
  }
}

// A mesh is one file: what others it names, as OBJ files name materials, are not opened.
class NoOtherFiles : public Assimp::IOSystem {
 public:
  bool Exists(const char*) const override { return false; }
  char getOsSeparator() const override { return '/'; }
  Assimp::IOStream* Open(const char*, const char*) override { return nullptr; }
  void Close(Assimp::IOStream*) override {}
};

// Assimp splits polygons without checking their indices, and aborts at a face without any (which it
// makes up where a text file ends early), so that has to come first.
void check_faces(const aiScene& scene, const fs::path& path) {
  for (unsigned m = 0; m < scene.mNumMeshes; ++m) {
    const aiMesh& part = *scene.mMeshes[m];
    for (unsigned f = 0; f < part.mNumFaces; ++f) {
      const aiFace& face = part.mFaces[f];
      if (face.mNumIndices == 0) {
        throw cut_short(path, fmt::format("face {} of {} has no vertices", f, part.mNumFaces));
      }
      for (unsigned i = 0; i < face.mNumIndices; ++i) {
        if (face.mIndices[i] < part.mNumVertices) continue;
        throw invalid_input(fmt::format("{}: face {} refers to vertex {}, but there are {}",
                                        path.string(), f, face.mIndices[i], part.mNumVertices));
      }
    }
  }
}

void append(Mesh& mesh, const aiMesh& part) {
  const auto base = static_cast<uint32_t>(mesh.vertices.size());
  for (unsigned v = 0; v < part.mNumVertices; ++v) {
    const aiVector3D& p = part.mVertices[v];
    mesh.vertices.push_back({p.x, p.y, p.z});
  }
  for (unsigned f = 0; f < part.mNumFaces; ++f) {
    const aiFace& face = part.mFaces[f];
    if (face.mNumIndices != 3) continue;  // points and lines
    mesh.triangles.push_back(
        {base + face.mIndices[0], base + face.mIndices[1], base + face.mIndices[2]});
  }
}

}  // namespace

Mesh load_mesh(const fs::path& path) {
  const std::string extension = lower_case_extension(path);
  if (extension != ".ply" && extension != ".obj" && extension != ".stl") {
    throw invalid_input(fmt::format("{}: a mesh must be a .ply, .obj or .stl file, not \"{}\"",
                                    path.string(), extension));
  }
  std::string content = read_file(path, "mesh");
  if (extension == ".ply") {
    content = checked_ply(content, path.string());
  } else if (extension == ".obj") {
    content = checked_obj(content, path.string());
  } else if (extension == ".stl") {
    check_stl(content, path);
  }
  Assimp::Importer importer;
  importer.SetIOHandler(new NoOtherFiles);  // it becomes the importer's
  const aiScene* scene =
      importer.ReadFileFromMemory(content.data(), content.size(), 0, extension.c_str() + 1);
  if (scene == nullptr) {
    throw invalid_input(
        fmt::format("cannot read the mesh {}: {}", path.string(), importer.GetErrorString()));
  }
  check_faces(*scene, path);
  scene = importer.ApplyPostProcessing(aiProcess_Triangulate);

  Mesh mesh;
  for (unsigned m = 0; m < scene->mNumMeshes; ++m) append(mesh, *scene->mMeshes[m]);
  validate_triangles(mesh, path.string());
  mesh = welded(mesh);
  validate_triangles(mesh, path.string());
  return mesh;
}

std::string encode_ply(const Mesh& mesh) {
  static_assert(std::endian::native == std::endian::little && sizeof(Vec3f) == 3 * sizeof(float));
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment lengths in mm\nelement vertex {}\n"
      "property float x\nproperty float y\nproperty float z\nelement face {}\n"
      "property list uchar uint vertex_indices\nend_header\n",
      mesh.vertices.size(), mesh.triangles.size());
  const auto append = [&bytes](const auto& values) {
    bytes.append(reinterpret_cast<const char*>(values.data()),
                 values.size() * sizeof(values.data()[0]));
  };
  append(mesh.vertices);
  for (const auto& triangle : mesh.triangles) {
    bytes += '\3';
    append(triangle);
  }
  return bytes;
}

}  // namespace itn
