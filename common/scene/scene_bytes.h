// The form in which a scene travels: bytes and their digest.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "common/geometry/mesh.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// Puts the triangles in the place of the mesh's source.
void set_triangles(v1::Mesh& proto, const Mesh& mesh);

// A scene as the bytes that are sent, with their SHA-256 digest (32 bytes).
struct SerializedScene {
  std::string bytes;
  std::string digest;
  uint32_t width = 0, height = 0;  // of the film, in pixels
  uint64_t triangles = 0;          // of all meshes that are there as triangles
};

// Deterministic: the same scene gives the same bytes within one program. Throws Error (kLimit) if
// they would be 2 GiB or more.
std::shared_ptr<const SerializedScene> serialize(const v1::Scene& scene);

// The SHA-256 digest of any bytes; 32 bytes.
std::string sha256(const std::string& bytes);

// Writes two lower-case digits a byte.
std::string to_hex(const std::string& bytes);

}  // namespace itn
