// Checks of single fields of a request or scene. All throw Error: kInvalidInput with the path of
// the field, its value and its range ("scene.lights[1].sun_sky.turbidity is 12; it must be in [1,
// 10]"), or kLimit.
#pragma once

#include <fmt/format.h>
#include <google/protobuf/message.h>

#include <cstdint>
#include <string>
#include <vector>

#include "common/error.h"
#include "common/fields.h"
#include "common/scene/wire_array.h"
#include "common/vec.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// What a scene may have.
inline constexpr int kMaxLights = 64;
inline constexpr int kMaxSurfaces = 1024;
inline constexpr int kMaxOtherObjects = 15;
inline constexpr int kMaxMaterials = 3;    // of an object: in red, green and blue
inline constexpr int kMaxTransforms = 64;  // of a mesh

// To be thrown.
Error missing(const std::string& field);

uint32_t integer_in(const std::string& field, uint64_t value, uint64_t low, uint64_t high);

// Throws kLimit.
void within_limit(const std::string& what, uint64_t value, uint64_t limit);

// Checks any message with all that it consists of: no unknown fields, all numbers finite.
void check_message(const google::protobuf::Message& message, const std::string& path);

Vec3d to_vec(const v1::Vec3& v);
Vec3d non_zero(const std::string& field, const v1::Vec3& proto);

// In mm: within 10^6 of the origin, so that squares of distances stay finite in float.
Vec3d check_position(const std::string& field, Vec3d p);

// The numbers that the bytes of a field are.
template <typename T>
std::vector<T> array_of(const std::string& field, const std::string& bytes) {
  if (bytes.empty()) throw missing(field);
  if (bytes.size() % sizeof(T) != 0) {
    throw invalid_input(fmt::format("{} has {} bytes; it must be a multiple of {}", field,
                                    bytes.size(), sizeof(T)));
  }
  return from_bytes<T>(bytes);
}

}  // namespace itn
