// Arrays of numbers as the protos carry them: bytes, little-endian.
#pragma once

#include <bit>
#include <cstring>
#include <span>
#include <string>
#include <vector>

namespace itn {

static_assert(std::endian::native == std::endian::little, "the wire's arrays are little-endian");

template <typename T>
std::string to_bytes(std::span<const T> values) {
  return {reinterpret_cast<const char*>(values.data()), values.size_bytes()};
}
template <typename T>
std::string to_bytes(const std::vector<T>& values) {
  return to_bytes(std::span<const T>(values));
}

// Reads as many numbers as the bytes make in full.
template <typename T>
std::vector<T> from_bytes(const std::string& bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  std::memcpy(values.data(), bytes.data(), values.size() * sizeof(T));
  return values;
}

}  // namespace itn
