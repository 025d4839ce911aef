// Mesh files, apart from mesh.cpp so that a program that reads none does not load Assimp.
#include <fmt/format.h>

#include <assimp/Importer.hpp>
#include <cctype>
#include <fstream>
#include <set>

#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include "common/error.h"
#include "common/mesh.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

void check_kind(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (!std::set<std::string>{".ply", ".obj", ".stl"}.contains(extension)) {
    throw invalid_input(fmt::format("{}: a mesh must be a .ply, .obj or .stl file, not \"{}\"",
                                    path.string(), extension));
  }
}

// Assimp splits polygons without checking their indices, so that has to come first.
void check_indices(const aiScene& scene, const fs::path& path) {
  for (unsigned m = 0; m < scene.mNumMeshes; ++m) {
    const aiMesh& part = *scene.mMeshes[m];
    for (unsigned f = 0; f < part.mNumFaces; ++f) {
      const aiFace& face = part.mFaces[f];
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
  check_kind(path);
  if (!fs::is_regular_file(path) || !std::ifstream(path).good()) {
    throw Error(ErrorKind::kIo, fmt::format("cannot open the mesh {}", path.string()));
  }
  Assimp::Importer importer;
  const aiScene* scene = importer.ReadFile(path.string(), 0);
  if (scene == nullptr) {
    throw invalid_input(
        fmt::format("cannot read the mesh {}: {}", path.string(), importer.GetErrorString()));
  }
  check_indices(*scene, path);
  scene = importer.ApplyPostProcessing(aiProcess_Triangulate);

  Mesh mesh;
  for (unsigned m = 0; m < scene->mNumMeshes; ++m) append(mesh, *scene->mMeshes[m]);
  validate_triangles(mesh, path.string());
  mesh = welded(mesh);
  validate_triangles(mesh, path.string());
  return mesh;
}

}  // namespace itn
