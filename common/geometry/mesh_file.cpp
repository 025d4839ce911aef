#include "common/geometry/mesh_file.h"

#include <fmt/format.h>

#include <assimp/Importer.hpp>
#include <cctype>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>

#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include "common/error.h"

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

// The number of faces that the header of a PLY file promises. Assimp does not see that a text file
// ends before its last face, and does not return at all where the header has no end.
size_t promised_faces(const fs::path& path) {
  constexpr int kMaxHeaderLines = 10'000;
  std::ifstream in(path, std::ios::binary);
  size_t faces = 0;
  std::string line;
  for (int i = 0; i < kMaxHeaderLines && std::getline(in, line); ++i) {
    if (i == 0 && !line.starts_with("ply")) {
      throw invalid_input(path.string() + " is not a PLY file: it does not begin with \"ply\"");
    }
    if (line.starts_with("end_header")) return faces;
    std::istringstream words(line);
    std::string element, face;
    size_t count = 0;
    if (words >> element >> face >> count && element == "element" && face == "face") faces = count;
  }
  throw cut_short(path, "its header has no end_header");
}

// The content of a PLY file, such that Assimp reads it right. Assimp takes a first byte of binary
// data that looks like a line feed for a remainder of the header, and drops it: it is given one to
// drop.
std::string ply_content(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string content{std::istreambuf_iterator<char>(in), {}};
  const size_t end = content.find("\nend_header\n");
  if (end != std::string::npos &&
      content.substr(0, end).find("\nformat binary") != std::string::npos) {
    const size_t data = content.find('\n', end + 1) + 1;
    if (data < content.size() && content[data] == '\n') {
      content.insert(data, 1, '\n');
    }
  }
  return content;
}

// Assimp splits polygons without checking their indices, and aborts at a face without any (which it
// makes up where a text file ends early), so that has to come first.
// Returns the number of faces.
size_t check_faces(const aiScene& scene, const fs::path& path) {
  size_t faces = 0;
  for (unsigned m = 0; m < scene.mNumMeshes; ++m) {
    const aiMesh& part = *scene.mMeshes[m];
    faces += part.mNumFaces;
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
  return faces;
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
  if (!fs::is_regular_file(path) || !std::ifstream(path).good()) {
    throw Error(ErrorKind::kIo, fmt::format("cannot open the mesh {}", path.string()));
  }
  const size_t promised = extension == ".ply" ? promised_faces(path) : 0;
  Assimp::Importer importer;
  const aiScene* scene = nullptr;
  if (extension == ".ply") {
    const std::string content = ply_content(path);
    scene = importer.ReadFileFromMemory(content.data(), content.size(), 0, "ply");
  } else {
    scene = importer.ReadFile(path.string(), 0);
  }
  if (scene == nullptr) {
    throw invalid_input(
        fmt::format("cannot read the mesh {}: {}", path.string(), importer.GetErrorString()));
  }
  const size_t faces = check_faces(*scene, path);
  if (faces < promised) {
    throw cut_short(path, fmt::format("{} of {} faces are there", faces, promised));
  }
  scene = importer.ApplyPostProcessing(aiProcess_Triangulate);

  Mesh mesh;
  for (unsigned m = 0; m < scene->mNumMeshes; ++m) append(mesh, *scene->mMeshes[m]);
  validate_triangles(mesh, path.string());
  mesh = welded(mesh);
  validate_triangles(mesh, path.string());
  return mesh;
}

}  // namespace itn
