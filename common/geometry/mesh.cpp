#include "common/geometry/mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numbers>
#include <numeric>
#include <span>

#include "common/error.h"

namespace itn {
namespace {

using Triangle = std::array<uint32_t, 3>;

// Vertex of a triangle in double, relative to an origin near the mesh.
Vec3d corner(const Mesh& mesh, const Triangle& triangle, int i, Vec3d origin) {
  return Vec3d(mesh.vertices[triangle[i]]) - origin;
}

// 6 times the volume of the tetrahedron between the origin and the triangle.
double volume6(const Mesh& mesh, const Triangle& triangle, Vec3d origin) {
  return dot(corner(mesh, triangle, 0, origin),
             cross(corner(mesh, triangle, 1, origin), corner(mesh, triangle, 2, origin)));
}

// Signed solid angle under which the triangle is seen from p, negative from its front.
// Van Oosterom and Strackee, "The Solid Angle of a Plane Triangle", IEEE Trans. Biomed. Eng. 1983.
double solid_angle(const Mesh& mesh, const Triangle& triangle, Vec3d p) {
  const Vec3d a = corner(mesh, triangle, 0, p);
  const Vec3d b = corner(mesh, triangle, 1, p);
  const Vec3d c = corner(mesh, triangle, 2, p);
  const double la = length(a), lb = length(b), lc = length(c);
  const double denominator = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
  return 2 * std::atan2(dot(a, cross(b, c)), denominator);
}

// The directed edges of all triangles, grouped by their lower vertex (a counting sort: far faster
// than a map, and than sorting all edges at once).
class EdgeTable {
 public:
  explicit EdgeTable(const Mesh& mesh)
      : first_(mesh.vertices.size() + 1, 0), edges_(3 * mesh.triangles.size()) {
    for_each_edge(mesh, [&](uint32_t low, uint32_t, bool) { ++first_[low + 1]; });
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    std::vector<size_t> next(first_.begin(), first_.end() - 1);
    for_each_edge(mesh, [&](uint32_t low, uint32_t high, bool upward) {
      edges_[next[low]++] = {high, upward ? 1 : -1};
    });
  }

  struct Edge {
    uint32_t high;  // the other vertex
    int direction;  // +1 from the lower index to the higher, -1 back
  };

  // Sorted by the other vertex.
  std::span<const Edge> edges_from(uint32_t low) {
    const std::span<Edge> edges(edges_.data() + first_[low], first_[low + 1] - first_[low]);
    std::ranges::sort(edges, {}, &Edge::high);
    return edges;
  }

 private:
  template <typename F>
  static void for_each_edge(const Mesh& mesh, F&& f) {
    for (const Triangle& t : mesh.triangles) {
      for (int i = 0; i < 3; ++i) {
        const uint32_t from = t[i], to = t[(i + 1) % 3];
        f(std::min(from, to), std::max(from, to), from < to);
      }
    }
  }

  std::vector<size_t> first_;
  std::vector<Edge> edges_;
};

std::string describe(Vec3f p) {
  return fmt::format("({:.6g}, {:.6g}, {:.6g})", p.x, p.y, p.z);
}

// An edge of an odd number of triangles is open; one of an even number that does not run there and
// back equally often joins triangles of clashing orientation.
void check_edges(const Mesh& mesh, const std::string& what) {
  struct Fault {
    size_t count = 0;
    uint32_t low = 0, high = 0;
    void add(uint32_t a, uint32_t b) {
      if (count++ == 0) low = a, high = b;
    }
  } open, clashing;
  EdgeTable table(mesh);
  for (uint32_t low = 0; low < mesh.vertices.size(); ++low) {
    const auto edges = table.edges_from(low);
    for (size_t i = 0, j = 0; i < edges.size(); i = j) {
      int sum = 0;
      for (j = i; j < edges.size() && edges[j].high == edges[i].high; ++j) {
        sum += edges[j].direction;
      }
      if (sum != 0) ((j - i) % 2 ? open : clashing).add(low, edges[i].high);
    }
  }
  const auto between = [&](const Fault& fault) {
    return fmt::format("the first is between {} and {}", describe(mesh.vertices[fault.low]),
                       describe(mesh.vertices[fault.high]));
  };
  if (open.count > 0) {
    throw invalid_input(fmt::format(
        "{} is not closed: {} open edge{}; {}. Every edge must belong to two triangles.", what,
        open.count, open.count == 1 ? "" : "s", between(open)));
  }
  if (clashing.count > 0) {
    throw invalid_input(
        fmt::format("{} has triangles of clashing orientation at {} edge{}; {}. Triangles must run "
                    "counter-clockwise seen from outside.",
                    what, clashing.count, clashing.count == 1 ? "" : "s", between(clashing)));
  }
}

// The connected parts of a mesh (triangles that share a vertex).
struct Part {
  std::vector<uint32_t> triangles;
  double volume = 0;
  Vec3d min, max;

  bool box_contains(Vec3d p) const {
    return p.x >= min.x && p.y >= min.y && p.z >= min.z && p.x <= max.x && p.y <= max.y &&
           p.z <= max.z;
  }
};

class DisjointSets {
 public:
  explicit DisjointSets(size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0U); }
  uint32_t find(uint32_t a) {
    while (parent_[a] != a) a = parent_[a] = parent_[parent_[a]];
    return a;
  }
  void join(uint32_t a, uint32_t b) { parent_[find(a)] = find(b); }

 private:
  std::vector<uint32_t> parent_;
};

void measure(Part& part, const Mesh& mesh) {
  const Vec3d origin(mesh.vertices[mesh.triangles[part.triangles[0]][0]]);
  part.min = part.max = origin;
  for (const uint32_t t : part.triangles) {
    const Triangle& triangle = mesh.triangles[t];
    part.volume += volume6(mesh, triangle, origin) / 6;
    for (const uint32_t v : triangle) {
      const Vec3f p = mesh.vertices[v];
      part.min = {std::min<double>(part.min.x, p.x), std::min<double>(part.min.y, p.y),
                  std::min<double>(part.min.z, p.z)};
      part.max = {std::max<double>(part.max.x, p.x), std::max<double>(part.max.y, p.y),
                  std::max<double>(part.max.z, p.z)};
    }
  }
}

std::vector<Part> connected_parts(const Mesh& mesh) {
  DisjointSets sets(mesh.vertices.size());
  for (const Triangle& t : mesh.triangles) {
    sets.join(t[0], t[1]);
    sets.join(t[0], t[2]);
  }
  constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
  std::vector<uint32_t> part_of(mesh.vertices.size(), kNone);
  std::vector<Part> parts;
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    uint32_t& part = part_of[sets.find(mesh.triangles[t][0])];
    if (part == kNone) {
      part = static_cast<uint32_t>(parts.size());
      parts.emplace_back();
    }
    parts[part].triangles.push_back(t);
  }
  for (Part& part : parts) measure(part, mesh);
  return parts;
}

// How many of the other parts enclose this one: cavities count -1.
long enclosing(const Mesh& mesh, const std::vector<Part>& parts, const Part& part) {
  const Triangle& triangle = mesh.triangles[part.triangles[0]];
  const Vec3d p = (corner(mesh, triangle, 0, {}) + corner(mesh, triangle, 1, {}) +
                   corner(mesh, triangle, 2, {})) *
                  (1.0 / 3);
  double angle = 0;
  for (const Part& other : parts) {
    if (&other == &part || !other.box_contains(p)) continue;
    for (const uint32_t t : other.triangles) angle += solid_angle(mesh, mesh.triangles[t], p);
  }
  return std::lround(angle / (4 * std::numbers::pi));
}

// Comparing the parts with each other takes time quadratic in their number.
constexpr size_t kMaxParts = 10'000;

void check_parts(const Mesh& mesh, const std::string& what) {
  const std::vector<Part> parts = connected_parts(mesh);
  if (parts.size() > kMaxParts) {
    throw invalid_input(fmt::format("{} has {} separate parts; at most {} are accepted", what,
                                    parts.size(), kMaxParts));
  }
  for (const Part& part : parts) {
    const Vec3f where = mesh.vertices[mesh.triangles[part.triangles[0]][0]];
    const Vec3d extent = part.max - part.min;
    // Rounding of float coordinates leaves a flat part about this much.
    if (std::abs(part.volume) <= 1e-9 * std::pow(length(extent), 3)) {
      throw invalid_input(
          fmt::format("{} has a part that encloses no volume, at {}", what, describe(where)));
    }
    const long around = enclosing(mesh, parts, part);
    if (part.volume < 0 && around < 1) {
      throw invalid_input(
          fmt::format("{} is inside out: the part at {} encloses {:.6g} mm^3. Triangles must run "
                      "counter-clockwise seen from outside.",
                      what, describe(where), part.volume));
    }
    if (part.volume > 0 && around > 0) {
      throw invalid_input(
          fmt::format("{} has a part at {} inside another part. A cavity must have its triangles "
                      "the other way round; a solid inside a solid is not accepted.",
                      what, describe(where)));
    }
  }
}

}  // namespace

Bounds bounds(const Mesh& mesh) {
  Bounds box{mesh.vertices.at(0), mesh.vertices.at(0)};
  for (const Vec3f p : mesh.vertices) {
    box.min = {std::min(box.min.x, p.x), std::min(box.min.y, p.y), std::min(box.min.z, p.z)};
    box.max = {std::max(box.max.x, p.x), std::max(box.max.y, p.y), std::max(box.max.z, p.z)};
  }
  return box;
}

Mesh transformed(const Mesh& mesh, const Affine& m) {
  Mesh result = mesh;
  for (Vec3f& p : result.vertices) {
    const Vec3d q(p);
    p = Vec3f(Vec3d{m[0] * q.x + m[1] * q.y + m[2] * q.z + m[3],
                    m[4] * q.x + m[5] * q.y + m[6] * q.z + m[7],
                    m[8] * q.x + m[9] * q.y + m[10] * q.z + m[11]});
  }
  return result;
}

Mesh normalized(const Mesh& mesh) {
  const Bounds box = bounds(mesh);
  const Vec3d low(box.min), extent = Vec3d(box.max) - low;
  const double longest = std::max({extent.x, extent.y, extent.z});
  if (!(longest > 0)) throw invalid_input("a mesh of no extent cannot be normalized");
  const double s = 1 / longest;
  return transformed(mesh, {s, 0, 0, -s * (low.x + extent.x / 2),  //
                            0, s, 0, -s * low.y,                   //
                            0, 0, s, -s * (low.z + extent.z / 2)});
}

Mesh welded(const Mesh& mesh) {
  const auto& vertices = mesh.vertices;
  // Sort by position; the first of equals (lowest index) stands for all.
  std::vector<uint32_t> order(vertices.size());
  std::iota(order.begin(), order.end(), 0U);
  std::ranges::sort(order, [&](uint32_t a, uint32_t b) {
    const Vec3f p = vertices[a], q = vertices[b];
    if (p.x != q.x) return p.x < q.x;
    if (p.y != q.y) return p.y < q.y;
    if (p.z != q.z) return p.z < q.z;
    return a < b;
  });
  std::vector<uint32_t> representative(vertices.size());
  for (size_t i = 0; i < order.size(); ++i) {
    const bool repeats = i > 0 && vertices[order[i]] == vertices[order[i - 1]];
    representative[order[i]] = repeats ? representative[order[i - 1]] : order[i];
  }

  // Keep what triangles use, in the order of first use.
  constexpr uint32_t kUnused = std::numeric_limits<uint32_t>::max();
  std::vector<uint32_t> index(vertices.size(), kUnused);
  Mesh result;
  result.triangles.reserve(mesh.triangles.size());
  for (Triangle t : mesh.triangles) {
    for (uint32_t& v : t) v = representative[v];
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) continue;
    for (uint32_t& v : t) {
      if (index[v] == kUnused) {
        index[v] = static_cast<uint32_t>(result.vertices.size());
        result.vertices.push_back(vertices[v]);
      }
      v = index[v];
    }
    result.triangles.push_back(t);
  }
  return result;
}

void validate_triangles(const Mesh& mesh, const std::string& what) {
  if (mesh.triangles.empty()) throw invalid_input(what + " has no triangles");
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    if (!is_finite(mesh.vertices[i])) {
      throw invalid_input(fmt::format("{}: vertex {} is {}; every coordinate must be finite", what,
                                      i, describe(mesh.vertices[i])));
    }
  }
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (const uint32_t v : mesh.triangles[i]) {
      if (v >= mesh.vertices.size()) {
        throw invalid_input(fmt::format("{}: triangle {} refers to vertex {}, but there are {}",
                                        what, i, v, mesh.vertices.size()));
      }
    }
  }
}

void validate_closed(const Mesh& mesh, const std::string& what) {
  validate_triangles(mesh, what);
  check_edges(mesh, what);
  check_parts(mesh, what);
}

double signed_volume(const Mesh& mesh) {
  if (mesh.vertices.empty()) return 0;
  const Vec3d origin(mesh.vertices[0]);
  double sum = 0;
  for (const Triangle& t : mesh.triangles) sum += volume6(mesh, t, origin);
  return sum / 6;
}

double winding_number(const Mesh& mesh, Vec3d p) {
  double angle = 0;
  for (const Triangle& t : mesh.triangles) angle += solid_angle(mesh, t, p);
  return angle / (4 * std::numbers::pi);
}

}  // namespace itn
