#include "common/geometry/mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <span>
#include <utility>

#include "common/cancellation.h"
#include "common/error.h"
#include "common/geometry/mesh_parts.h"

namespace itn {
namespace {

using Triangle = std::array<uint32_t, 3>;

// Vertex of a triangle in double, relative to an origin near the mesh.
Vec3d corner(const Mesh& mesh, const Triangle& triangle, int i, Vec3d origin) {
  return Vec3d(mesh.vertices[triangle[i]]) - origin;
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
  EdgeTable(const Mesh& mesh, Cancellation& cancellation)
      : first_(mesh.vertices.size() + 1, 0), edges_(3 * mesh.triangles.size()) {
    for (const Triangle& t : mesh.triangles) {
      cancellation.turn();
      for (size_t i = 0; i < 3; ++i) ++first_[std::min(t[i], t[(i + 1) % 3]) + 1];
    }
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    std::vector<size_t> next(first_.begin(), first_.end() - 1);
    for (uint32_t n = 0; n < mesh.triangles.size(); ++n) {
      cancellation.turn();
      const Triangle& t = mesh.triangles[n];
      for (size_t i = 0; i < 3; ++i) {
        const uint32_t from = t[i], to = t[(i + 1) % 3];
        edges_[next[std::min(from, to)]++] = {std::max(from, to), n, from < to ? 1 : -1};
      }
    }
  }

  struct Edge {
    uint32_t high;  // the other vertex
    uint32_t triangle;
    int direction;  // +1 from the lower index to the higher, -1 back
  };

  // Sorted by the other vertex.
  std::span<const Edge> edges_from(uint32_t low) {
    const std::span<Edge> edges(edges_.data() + first_[low], first_[low + 1] - first_[low]);
    std::ranges::sort(edges, {}, &Edge::high);
    return edges;
  }

 private:
  std::vector<size_t> first_;
  std::vector<Edge> edges_;
};

// Which triangles at an edge of more than two bound the same part: going around the edge, one that
// is entered through, and the next, that is left through. Empty if one is entered twice, or left
// twice, in a row: then parts overlap there. Triangles that coincide may come in either order.
std::optional<std::vector<std::pair<uint32_t, uint32_t>>> pairs_at_edge(
    const Mesh& mesh, uint32_t low, std::span<const EdgeTable::Edge> edges) {
  const Vec3d from(mesh.vertices[low]), along = Vec3d(mesh.vertices[edges[0].high]) - from;
  if (!(length(along) > 0)) return {};
  const Basis<double> around(normalize(along));
  struct Sheet {
    double angle;
    int step;  // +1 where the medium is entered as the angle grows, -1 where it is left
    uint32_t triangle;
  };
  std::vector<Sheet> sheets;
  for (const EdgeTable::Edge& edge : edges) {
    for (const uint32_t v : mesh.triangles[edge.triangle]) {
      if (v == low || v == edge.high) continue;
      const Vec3d out = Vec3d(mesh.vertices[v]) - from;
      sheets.push_back(
          {std::atan2(dot(out, around.t), dot(out, around.s)), -edge.direction, edge.triangle});
    }
  }
  std::ranges::sort(sheets, {}, &Sheet::angle);
  // Runs of equal angles: the steps that are left when those of opposite sign cancel must
  // alternate.
  constexpr double kSame = 1e-6;
  struct Run {
    std::vector<uint32_t> entered, left;
    int step() const { return static_cast<int>(entered.size()) - static_cast<int>(left.size()); }
  };
  std::vector<Run> runs;
  for (size_t i = 0; i < sheets.size(); ++i) {
    if (i == 0 || sheets[i].angle - sheets[i - 1].angle > kSame) runs.emplace_back();
    (sheets[i].step > 0 ? runs.back().entered : runs.back().left).push_back(sheets[i].triangle);
  }
  if (runs.size() > 1 &&
      2 * std::numbers::pi + sheets.front().angle - sheets.back().angle <= kSame) {
    std::ranges::copy(runs.back().entered, std::back_inserter(runs.front().entered));
    std::ranges::copy(runs.back().left, std::back_inserter(runs.front().left));
    runs.pop_back();
  }
  const auto first = std::ranges::find_if(runs, [](const Run& run) { return run.step() != 0; });
  bool inside = first != runs.end() && first->step() < 0;
  std::vector<uint32_t> in_turn;  // entered, left, entered ...; begins with left if inside
  const bool begins_inside = inside;
  for (Run& run : runs) {
    while (!run.entered.empty() || !run.left.empty()) {
      std::vector<uint32_t>& next = inside ? run.left : run.entered;
      if (next.empty()) return {};
      in_turn.push_back(next.back());
      next.pop_back();
      inside = !inside;
    }
  }
  if (begins_inside) std::rotate(in_turn.begin(), in_turn.begin() + 1, in_turn.end());
  std::vector<std::pair<uint32_t, uint32_t>> pairs;
  for (size_t i = 0; i + 1 < in_turn.size(); i += 2) pairs.emplace_back(in_turn[i], in_turn[i + 1]);
  return pairs;
}

// An edge of an odd number of triangles is open; one of an even number that does not run there and
// back equally often joins triangles of clashing orientation. Returns which triangles bound the
// same part.
DisjointSets check_edges(const Mesh& mesh, const std::string& what, Cancellation& cancellation) {
  struct Fault {
    size_t count = 0;
    uint32_t low = 0, high = 0;
    void add(uint32_t a, uint32_t b) {
      if (count++ == 0) low = a, high = b;
    }
  } open, clashing, overlapping;
  DisjointSets joined(mesh.triangles.size());
  EdgeTable table(mesh, cancellation);
  for (uint32_t low = 0; low < mesh.vertices.size(); ++low) {
    cancellation.turn();
    const auto edges = table.edges_from(low);
    for (size_t i = 0, j = 0; i < edges.size(); i = j) {
      int sum = 0;
      for (j = i; j < edges.size() && edges[j].high == edges[i].high; ++j) {
        sum += edges[j].direction;
      }
      const uint32_t high = edges[i].high;
      if (sum != 0) {
        ((j - i) % 2 ? open : clashing).add(low, high);
      } else if (j - i == 2) {
        joined.join(edges[i].triangle, edges[i + 1].triangle);
      } else if (const auto pairs = pairs_at_edge(mesh, low, edges.subspan(i, j - i))) {
        for (const auto& [a, b] : *pairs) joined.join(a, b);
      } else {
        overlapping.add(low, high);
      }
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
  if (overlapping.count > 0) {
    throw invalid_input(fmt::format(
        "{} has triangles that overlap, or are there twice, at {} edge{} of more than two; {}. "
        "Parts may touch, but not overlap: unite them into one surface, or move them apart.",
        what, overlapping.count, overlapping.count == 1 ? "" : "s", between(overlapping)));
  }
  return joined;
}

}  // namespace

std::string describe(Vec3f p) {
  return fmt::format("({:.6g}, {:.6g}, {:.6g})", p.x, p.y, p.z);
}

double volume6(const Mesh& mesh, const Triangle& triangle, Vec3d origin) {
  return dot(corner(mesh, triangle, 0, origin),
             cross(corner(mesh, triangle, 1, origin), corner(mesh, triangle, 2, origin)));
}

Bounds bounds(const Mesh& mesh) {
  Bounds box{mesh.vertices.at(0), mesh.vertices.at(0)};
  for (const Vec3f p : mesh.vertices) {
    box.min = {std::min(box.min.x, p.x), std::min(box.min.y, p.y), std::min(box.min.z, p.z)};
    box.max = {std::max(box.max.x, p.x), std::max(box.max.y, p.y), std::max(box.max.z, p.z)};
  }
  return box;
}

Vec3d middle_of(const Bounds& box) {
  return (static_cast<Vec3d>(box.min) + static_cast<Vec3d>(box.max)) * 0.5;
}

double longest_side(const Bounds& box) {
  const Vec3d extent = Vec3d(box.max) - Vec3d(box.min);
  return std::max({extent.x, extent.y, extent.z});
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
  const double longest = longest_side(box);
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

void validate_closed(const Mesh& mesh, const std::string& what, const std::stop_token& stop) {
  validate_triangles(mesh, what);
  Cancellation cancellation(stop);
  DisjointSets joined = check_edges(mesh, what, cancellation);
  check_parts(mesh, joined, what, cancellation);
}

double signed_volume(const Mesh& mesh) {
  if (mesh.vertices.empty()) return 0;
  const Vec3d origin(mesh.vertices[0]);
  double sum = 0;
  for (const Triangle& t : mesh.triangles) sum += volume6(mesh, t, origin);
  return sum / 6;
}

double area(const Mesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const auto corner = static_cast<Vec3d>(mesh.vertices[a]);
    sum += length(cross(static_cast<Vec3d>(mesh.vertices[b]) - corner,
                        static_cast<Vec3d>(mesh.vertices[c]) - corner)) /
           2;
  }
  return sum;
}

double thickness(const Mesh& mesh) {
  const double whole = area(mesh);
  return whole > 0 ? 2 * std::abs(signed_volume(mesh)) / whole : 0;
}

double winding_number(const Mesh& mesh, Vec3d p) {
  double angle = 0;
  for (const Triangle& t : mesh.triangles) angle += solid_angle(mesh, t, p);
  return angle / (4 * std::numbers::pi);
}

}  // namespace itn
