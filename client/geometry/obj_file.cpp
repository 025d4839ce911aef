// Wavefront OBJ: its vertices and faces. What it says of materials, normals and textures is left
// out. http://paulbourke.net/dataformats/obj/
#include <fmt/format.h>

#include <charconv>
#include <utility>

#include "client/geometry/mesh_formats.h"
#include "common/printable.h"

namespace itn {
namespace {

class ObjReader {
 public:
  ObjReader(std::string_view content, const std::string& what) : rest_(content), what_(what) {}

  Mesh run() {
    while (!rest_.empty()) {
      read_words();
      if (words_.empty()) continue;
      if (words_.front() == "v") read_vertex();
      if (words_.front() == "f") read_face();
    }
    if (greatest_ == 0) throw invalid_input(what_ + ": it has no faces");
    if (greatest_ > vertex_count()) throw missing_vertex(greatest_at_, greatest_);
    return triangulated(mesh_, what_);
  }

 private:
  Error wrong(size_t line, const std::string& reason) const {
    return invalid_input(fmt::format("{}: line {}: {}", what_, line, reason));
  }
  Error missing_vertex(size_t line, int64_t vertex) const {
    return wrong(line,
                 fmt::format("the face refers to vertex {}; there are {}", vertex, vertex_count()));
  }
  int64_t vertex_count() const { return std::ssize(mesh_.vertices); }

  // Reads the words of the next line up to a comment, and of those that a backslash at its end
  // joins to it. One at the end of a comment, as of a path of Windows, joins nothing: a vertex
  // would vanish.
  void read_words() {
    words_.clear();
    for (bool joined = true; joined && !rest_.empty();) {
      ++line_;
      std::string_view text = take_line(rest_);
      const size_t comment = text.find('#');
      joined = comment == std::string_view::npos && text.ends_with('\\');
      if (joined) text.remove_suffix(1);
      text = text.substr(0, comment);
      for (std::string_view word = take_word(text); !word.empty(); word = take_word(text)) {
        words_.push_back(word);
      }
    }
  }

  // x, y, z; or with a fourth, by which they are divided. More are a colour.
  void read_vertex() {
    const size_t count = words_.size() == 5 ? 4 : 3;
    if (words_.size() <= count) throw wrong(line_, "the vertex has less than three coordinates");
    double values[4] = {0, 0, 0, 1};
    for (size_t i = 0; i < count; ++i) {
      const std::optional<double> number = number_in(words_[i + 1]);
      if (!number) {
        throw wrong(line_, fmt::format("there is \"{}\" where a number should be",
                                       printable(words_[i + 1])));
      }
      values[i] = *number;
    }
    mesh_.vertices.emplace_back(Vec3d{values[0], values[1], values[2]} * (1 / values[3]));
  }

  void read_face() {
    const size_t count = words_.size() - 1;
    if (count > kMaxCorners) {
      throw wrong(line_, fmt::format("the face has {} corners; it may have at most {}", count,
                                     kMaxCorners));
    }
    if (count < 3) return;  // a point or a line
    for (size_t i = 1; i <= count; ++i) mesh_.corners.push_back(vertex(words_[i]));
    mesh_.sizes.push_back(static_cast<uint32_t>(count));
  }

  // The index of a corner v, v/vt, v//vn or v/vt/vn: v is counted from 1, or backwards from -1, the
  // latest. It may follow.
  uint32_t vertex(std::string_view corner) {
    const std::string_view word = corner.substr(0, corner.find('/'));
    int64_t given = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), given);
    if (error == std::errc::invalid_argument || end != word.data() + word.size()) {
      throw wrong(line_, fmt::format("the face has the corner \"{}\"", printable(corner)));
    }
    if (error != std::errc() || given == 0 || given < -vertex_count() || given > kMaxIndex) {
      throw missing_vertex(line_, given);
    }
    const int64_t number = given > 0 ? given : vertex_count() + 1 + given;
    if (number > greatest_) {
      greatest_ = number;
      greatest_at_ = line_;
    }
    return static_cast<uint32_t>(number - 1);
  }

  static constexpr int64_t kMaxIndex = int64_t{1} << 32;

  std::string_view rest_;
  const std::string& what_;
  size_t line_ = 0;
  std::vector<std::string_view> words_;
  PolygonMesh mesh_;
  int64_t greatest_ = 0;  // of the vertices that faces refer to, counted from 1
  size_t greatest_at_ = 0;
};

}  // namespace

Mesh read_obj(std::string_view content, const std::string& what) {
  return ObjReader(content, what).run();
}

}  // namespace itn
