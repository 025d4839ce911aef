#include "client/geometry/mesh_formats.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <limits>
#include <numeric>
#include <span>

namespace itn {
namespace {

// A face, whose corners are numbered from 0.
class Polygon {
 public:
  Polygon(const std::vector<Vec3f>& vertices, std::span<const uint32_t> corners) {
    for (const uint32_t corner : corners) points_.emplace_back(vertices[corner]);
    for (size_t i = 0; i < points_.size(); ++i) {  // Newell's normal
      normal_ = normal_ + cross(points_[i], points_[(i + 1) % points_.size()]);
    }
  }

  // Whether the corner ring[at] can be cut off the polygon that is left.
  bool is_ear(const std::vector<uint32_t>& ring, size_t at) const {
    const size_t before = (at + ring.size() - 1) % ring.size(), after = (at + 1) % ring.size();
    const uint32_t a = ring[before], b = ring[at], c = ring[after];
    if (!(area(a, b, c) > 0)) return false;
    for (const uint32_t p : ring) {
      if (p == a || p == b || p == c) continue;
      if (area(a, b, p) >= 0 && area(b, c, p) >= 0 && area(c, a, p) >= 0) return false;
    }
    return true;
  }

 private:
  // The area of a triangle as the normal sees it, but for a factor; positive if it is
  // counter-clockwise.
  double area(uint32_t a, uint32_t b, uint32_t c) const {
    return dot(normal_, cross(points_[b] - points_[a], points_[c] - points_[a]));
  }

  std::vector<Vec3d> points_;
  Vec3d normal_;
};

void append_triangles(Mesh& mesh, std::span<const uint32_t> corners) {
  const auto append = [&](uint32_t a, uint32_t b, uint32_t c) {
    mesh.triangles.push_back({corners[a], corners[b], corners[c]});
  };
  if (corners.size() == 3) append(0, 1, 2);
  if (corners.size() <= 3) return;
  const Polygon polygon(mesh.vertices, corners);
  std::vector<uint32_t> ring(corners.size());
  std::iota(ring.begin(), ring.end(), 0U);
  for (size_t corner = 1, tried = 0; ring.size() > 3 && tried < ring.size();) {
    corner %= ring.size();
    if (polygon.is_ear(ring, corner)) {
      append(ring[(corner + ring.size() - 1) % ring.size()], ring[corner],
             ring[(corner + 1) % ring.size()]);
      ring.erase(ring.begin() + static_cast<std::ptrdiff_t>(corner));
      tried = 0;
    } else {
      ++corner;
      ++tried;
    }
  }
  // What has no ear has no area, or cuts through itself.
  for (size_t i = 1; i + 1 < ring.size(); ++i) append(ring[0], ring[i], ring[i + 1]);
}

}  // namespace

Mesh triangulated(const PolygonMesh& mesh, const std::string& what) {
  Mesh result{mesh.vertices, {}};
  std::span<const uint32_t> rest = mesh.corners;
  for (size_t face = 0; face < mesh.sizes.size(); ++face) {
    const auto corners = rest.first(mesh.sizes[face]);
    rest = rest.subspan(corners.size());
    for (const uint32_t corner : corners) {
      if (corner < mesh.vertices.size()) continue;
      throw invalid_input(fmt::format("{}: face {} refers to vertex {}, but there are {}", what,
                                      face, corner, mesh.vertices.size()));
    }
    append_triangles(result, corners);
  }
  return result;
}

std::optional<double> number_in(std::string_view word) {
  constexpr size_t kMaxLength = 64;
  if (word.size() > kMaxLength) return {};
  if (word.starts_with('+')) word.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error == std::errc::invalid_argument || end != word.data() + word.size()) return {};
  return error == std::errc() ? value : std::numeric_limits<double>::infinity();
}

std::string_view take_word(std::string_view& text) {
  constexpr std::string_view kSpaces = " \t\n\v\f\r";
  text.remove_prefix(std::min(text.size(), text.find_first_not_of(kSpaces)));
  const std::string_view word = text.substr(0, text.find_first_of(kSpaces));
  text.remove_prefix(word.size());
  return word;
}

std::string_view take_line(std::string_view& text) {
  std::string_view line = text.substr(0, text.find('\n'));
  text.remove_prefix(std::min(text.size(), line.size() + 1));
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

Error cut_short(const std::string& what, const std::string& reason) {
  return Error(ErrorKind::kDataLoss, fmt::format("{} was cut short: {}", what, reason));
}

}  // namespace itn
