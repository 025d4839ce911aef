// STL, text and binary: https://en.wikipedia.org/wiki/STL_(file_format)
#include <fmt/format.h>

#include <bit>
#include <cctype>
#include <cstring>

#include "client/geometry/mesh_formats.h"
#include "common/printable.h"

namespace itn {
namespace {

void append_triangle(Mesh& mesh, const Vec3f (&corners)[3]) {
  const auto base = static_cast<uint32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), std::begin(corners), std::end(corners));
  mesh.triangles.push_back({base, base + 1, base + 2});
}

Mesh read_binary(std::string_view content, const std::string& what) {
  static_assert(std::endian::native == std::endian::little && sizeof(Vec3f) == 3 * sizeof(float));
  constexpr size_t kHeader = 84, kTriangle = 50;
  if (content.size() < kHeader) throw cut_short(what, "a binary STL file has at least 84 bytes");
  uint32_t count = 0;
  std::memcpy(&count, content.data() + kHeader - sizeof count, sizeof count);
  if (count > (content.size() - kHeader) / kTriangle) {
    throw cut_short(what, fmt::format("it promises {} triangles, {} bytes; it has {}", count,
                                      kHeader + uint64_t{count} * kTriangle, content.size()));
  }
  Mesh mesh;
  for (size_t i = 0; i < count; ++i) {
    Vec3f corners[3];  // after the normal
    std::memcpy(corners, content.data() + kHeader + i * kTriangle + sizeof(Vec3f), sizeof corners);
    append_triangle(mesh, corners);
  }
  return mesh;
}

std::string lower_case(std::string_view text) {
  std::string result(text);
  for (char& c : result) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return result;
}

Mesh read_text(std::string_view content, const std::string& what) {
  Mesh mesh;
  Vec3f corners[3];
  int corner_count = 0;
  // Keywords are of any case; some programs write the two words that they are made of apart.
  const auto next_keyword = [](std::string_view& line) {
    std::string word = lower_case(take_word(line));
    if (word == "end") word += lower_case(take_word(line));
    return word;
  };
  for (size_t number = 1; !content.empty(); ++number) {
    const auto wrong = [&](const std::string& reason) {
      return invalid_input(fmt::format("{}: line {}: {}", what, number, reason));
    };
    std::string_view line = take_line(content);
    const std::string keyword = next_keyword(line);
    if (keyword == "vertex") {
      if (corner_count == 3) throw wrong("a facet has more than three vertices");
      for (float Vec3f::*axis : {&Vec3f::x, &Vec3f::y, &Vec3f::z}) {
        const std::string_view word = take_word(line);
        const std::optional<double> value = number_in(word);
        if (!value) {
          throw wrong(fmt::format("there is \"{}\" where a number should be", printable(word)));
        }
        corners[corner_count].*axis = static_cast<float>(*value);
      }
      ++corner_count;
    } else if (keyword == "endloop") {
      if (corner_count < 3) throw wrong("a facet has less than three vertices");
      append_triangle(mesh, corners);
      corner_count = 0;
    }
  }
  if (corner_count > 0) throw cut_short(what, "it ends in a facet");
  return mesh;
}

}  // namespace

// A binary file may begin like a text; only a text has no zeros.
Mesh read_stl(std::string_view content, const std::string& what) {
  std::string_view begin = content;
  const bool is_text = lower_case(take_word(begin).substr(0, 5)) == "solid" &&
                       content.find('\0') == std::string_view::npos;
  return is_text ? read_text(content, what) : read_binary(content, what);
}

}  // namespace itn
