#include "common/scene/scene_bytes.h"

#include <fmt/format.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <openssl/evp.h>

#include <limits>

#include "common/error.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace {

uint64_t triangle_count(const v1::Mesh& mesh) {
  return mesh.triangles().indices().size() / (3 * sizeof(uint32_t));
}

}  // namespace

void set_triangles(v1::Mesh& proto, const Mesh& mesh) {
  static_assert(sizeof(Vec3f) == 3 * sizeof(float));
  proto.mutable_triangles()->set_positions(to_bytes(mesh.vertices));
  proto.mutable_triangles()->set_indices(to_bytes(mesh.triangles));
}

std::shared_ptr<const SerializedScene> serialize(const v1::Scene& scene) {
  const size_t size = scene.ByteSizeLong();
  if (size > static_cast<size_t>(std::numeric_limits<int>::max())) {
    throw Error(ErrorKind::kLimit,
                fmt::format("the scene takes {} bytes; it must be less than 2 GiB", size));
  }
  auto result = std::make_shared<SerializedScene>();
  result->bytes.reserve(size);
  {
    google::protobuf::io::StringOutputStream stream(&result->bytes);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    scene.SerializeWithCachedSizes(&coded);
  }
  result->digest = sha256(result->bytes);
  result->width = scene.film().width();
  result->height = scene.film().height();
  result->triangles = triangle_count(scene.object().mesh());
  for (const v1::Object& object : scene.other_objects()) {
    result->triangles += triangle_count(object.mesh());
  }
  for (const v1::Surface& surface : scene.surfaces()) {
    result->triangles += triangle_count(surface.mesh());
  }
  return result;
}

std::string sha256(const std::string& bytes) {
  std::string digest(32, '\0');
  unsigned int length = 0;
  if (EVP_Digest(bytes.data(), bytes.size(), reinterpret_cast<unsigned char*>(digest.data()),
                 &length, EVP_sha256(), nullptr) != 1 ||
      length != digest.size()) {
    throw Error(ErrorKind::kInternal, "OpenSSL cannot compute SHA-256");
  }
  return digest;
}

std::string to_hex(const std::string& bytes) {
  std::string hex;
  for (const char c : bytes) hex += fmt::format("{:02x}", static_cast<unsigned char>(c));
  return hex;
}

}  // namespace itn
