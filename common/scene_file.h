// Scene files (protobuf text format of itn.v1.Scene) and the form in which a scene travels.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "itn/v1/scene.pb.h"

namespace itn {

// Reads a scene file and replaces every mesh and image path (relative to the file) by its contents,
// so that the scene stands alone. Throws Error: kIo; kInvalidInput with file, line and column
// (unknown field, syntax), or with the name of the mesh or image that cannot be used.
v1::Scene load_scene(const std::filesystem::path& path);

// Puts the triangles in the place of the mesh's source.
void set_triangles(v1::Mesh& proto, const struct Mesh& mesh);

// A scene as the bytes that are sent, with their SHA-256 digest (32 bytes).
struct SerializedScene {
  std::string bytes;
  std::string digest;
};

// Deterministic: the same scene gives the same bytes within one program.
std::shared_ptr<const SerializedScene> serialize(const v1::Scene& scene);

// Of any bytes; 32 bytes.
std::string sha256(const std::string& bytes);

}  // namespace itn
