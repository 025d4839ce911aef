// Numbers in files of meshes, and how many there may be. Internal to mesh_file.
#pragma once

#include <charconv>
#include <cstddef>
#include <optional>
#include <string_view>

namespace itn {

// Of a face: cutting it into triangles takes time by their square.
inline constexpr size_t kMaxCorners = 1024;

// A longer number is none.
inline constexpr size_t kMaxNumber = 64;

// The word without a leading "+", if it is a number, which may be too large for a double.
inline std::optional<std::string_view> plain_number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  const bool is_number = word.size() <= kMaxNumber && error != std::errc::invalid_argument &&
                         end == word.data() + word.size();
  return is_number ? std::optional(word) : std::nullopt;
}

}  // namespace itn
