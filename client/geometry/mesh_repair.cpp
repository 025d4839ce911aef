#include "client/geometry/mesh_repair.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <span>
#include <unordered_map>
#include <utility>

#include "common/error.h"
#include "common/geometry/mesh_parts.h"

namespace itn {
namespace {

using Triangle = std::array<uint32_t, 3>;

uint64_t directed(uint32_t from, uint32_t to) {
  return uint64_t{from} << 32 | to;
}
uint64_t undirected(uint32_t a, uint32_t b) {
  return directed(std::min(a, b), std::max(a, b));
}

// The triangles at every edge, whichever way they run along it.
using EdgeTriangles = std::unordered_map<uint64_t, std::vector<uint32_t>>;

EdgeTriangles edges_of(const Mesh& mesh) {
  EdgeTriangles edges;
  edges.reserve(2 * mesh.triangles.size());
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const Triangle& v = mesh.triangles[t];
    for (size_t i = 0; i < 3; ++i) edges[undirected(v[i], v[(i + 1) % 3])].push_back(t);
  }
  return edges;
}

// Facets of no area: their corners lie on a line. What is on the other side of its longest edge is
// cut where the third corner is, so that the mesh stays as closed as it was. Returns how many are
// gone.
size_t drop_flat_triangles(Mesh& mesh) {
  constexpr double kFlat = 1e-12;  // of the square of the longest edge
  std::vector<Triangle>& triangles = mesh.triangles;
  const auto vertex = [&](uint32_t v) { return static_cast<Vec3d>(mesh.vertices[v]); };
  // Turned so that its longest edge is the first, if it is flat.
  const auto flat = [&](Triangle t) -> std::optional<Triangle> {
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) return std::nullopt;
    const auto squared = [&](const Triangle& of) {
      const Vec3d edge = vertex(of[1]) - vertex(of[0]);
      return dot(edge, edge);
    };
    for (int turn = 0; turn < 2; ++turn) {
      if (squared({t[1], t[2], t[0]}) > squared(t)) t = {t[1], t[2], t[0]};
    }
    if (squared({t[2], t[0], t[1]}) > squared(t)) t = {t[2], t[0], t[1]};
    const double area = length(cross(vertex(t[1]) - vertex(t[0]), vertex(t[2]) - vertex(t[0])));
    return area <= kFlat * squared(t) ? std::optional(t) : std::nullopt;
  };
  std::unordered_map<uint64_t, uint32_t> by_edge;
  std::vector<uint32_t> flat_ones;
  for (uint32_t n = 0; n < triangles.size(); ++n) {
    const Triangle& t = triangles[n];
    if (flat(t)) flat_ones.push_back(n);
    for (size_t i = 0; i < 3; ++i) by_edge[directed(t[i], t[(i + 1) % 3])] = n;
  }
  size_t dropped = 0;
  for (const uint32_t n : flat_ones) {
    const auto at = flat(triangles[n]);
    if (!at) continue;
    const auto [a, b, c] = *at;
    const auto beyond = by_edge.find(directed(b, a));
    if (beyond == by_edge.end() || beyond->second == n || flat(triangles[beyond->second])) continue;
    const uint32_t other = beyond->second;
    const Triangle& t = triangles[other];
    const auto place = static_cast<size_t>(std::ranges::find(t, b) - t.begin());
    const uint32_t d = t[(place + 2) % 3];
    // The two halves of the other one take the places of both.
    triangles[other] = {b, c, d};
    triangles[n] = {c, a, d};
    for (const uint32_t changed : {other, n}) {
      const Triangle& half = triangles[changed];
      for (size_t i = 0; i < 3; ++i) by_edge[directed(half[i], half[(i + 1) % 3])] = changed;
    }
    ++dropped;
  }
  return dropped;
}

class Repair {
 public:
  Repair(const Mesh& mesh, const MeshRepairOptions& options) : options_(options) {
    repair_.mesh = mesh;
  }

  MeshRepair run() {
    weld_open_edges();
    drop_repeated();
    const std::vector<Triangle> before = mesh().triangles;
    make_neighbours_agree();
    fill_holes();
    turn_outwards();
    for (size_t t = 0; t < before.size(); ++t) {
      // Turned by an even number of swaps, a triangle is as it was, but for where it begins.
      const Triangle& v = mesh().triangles[t];
      const auto at = std::ranges::find(v, before[t][0]) - v.begin();
      repair_.turned_triangles += v[(at + 1) % 3] != before[t][1] ? 1 : 0;
    }
    return std::move(repair_);
  }

 private:
  Mesh& mesh() { return repair_.mesh; }

  // A vertex of an open edge takes the place of others near it: found in cubes as large as the
  // distance, and their neighbours.
  void weld_open_edges() {
    const Bounds box = bounds(mesh());
    const Vec3f extent = box.max - box.min;
    const double distance = options_.weld_distance * std::max({extent.x, extent.y, extent.z});
    if (!(distance > 0)) return;
    std::set<uint32_t> open;
    for (const auto& [edge, triangles] : edges_of(mesh())) {
      if (triangles.size() % 2 == 0) continue;
      open.insert(static_cast<uint32_t>(edge >> 32));
      open.insert(static_cast<uint32_t>(edge));
    }
    using Cube = std::array<int64_t, 3>;
    std::map<Cube, std::vector<uint32_t>> kept;
    std::vector<uint32_t> stands_for(mesh().vertices.size());
    std::iota(stands_for.begin(), stands_for.end(), 0U);
    for (const uint32_t v : open) {
      const Vec3d p(mesh().vertices[v]);
      const auto cube = [&](double x, double low) {
        return static_cast<int64_t>(std::floor((x - low) / distance));
      };
      const Cube home{cube(p.x, box.min.x), cube(p.y, box.min.y), cube(p.z, box.min.z)};
      for (int i = 0; i < 27 && stands_for[v] == v; ++i) {
        const auto found =
            kept.find({home[0] + i % 3 - 1, home[1] + i / 3 % 3 - 1, home[2] + i / 9 - 1});
        if (found == kept.end()) continue;
        for (const uint32_t other : found->second) {
          if (length(Vec3d(mesh().vertices[other]) - p) <= distance) stands_for[v] = other;
        }
      }
      if (stands_for[v] == v) {
        kept[home].push_back(v);
      } else {
        ++repair_.welded_vertices;
      }
    }
    for (Triangle& t : mesh().triangles) {
      for (uint32_t& v : t) v = stands_for[v];
    }
  }

  void drop_repeated() {
    std::set<Triangle> seen;
    const size_t before = mesh().triangles.size();
    std::erase_if(mesh().triangles, [&](Triangle t) {
      std::ranges::sort(t);
      return t[0] == t[1] || t[1] == t[2] || !seen.insert(t).second;
    });
    repair_.dropped_triangles = before - mesh().triangles.size();
  }

  bool runs_along(uint32_t t, uint32_t from, uint32_t to) {
    const Triangle& v = mesh().triangles[t];
    return (v[0] == from && v[1] == to) || (v[1] == from && v[2] == to) ||
           (v[2] == from && v[0] == to);
  }
  void turn(uint32_t t) { std::swap(mesh().triangles[t][1], mesh().triangles[t][2]); }

  // From a first triangle of each part on, across edges of two.
  void make_neighbours_agree() {
    const EdgeTriangles edges = edges_of(mesh());
    std::vector<bool> reached(mesh().triangles.size());
    for (uint32_t first = 0; first < mesh().triangles.size(); ++first) {
      if (reached[first]) continue;
      reached[first] = true;
      std::vector<uint32_t> pending = {first};
      while (!pending.empty()) {
        const uint32_t t = pending.back();
        pending.pop_back();
        const Triangle v = mesh().triangles[t];
        for (size_t i = 0; i < 3; ++i) {
          const uint32_t from = v[i], to = v[(i + 1) % 3];
          const std::vector<uint32_t>& here = edges.at(undirected(from, to));
          if (here.size() != 2) continue;
          const uint32_t other = here[0] == t ? here[1] : here[0];
          if (reached[other]) continue;
          reached[other] = true;
          if (runs_along(other, from, to)) turn(other);
          pending.push_back(other);
        }
      }
    }
  }

  void fill_holes() {
    // Open edges, against the direction that their triangle runs along them: from each vertex on.
    const EdgeTriangles edges = edges_of(mesh());
    std::multimap<uint32_t, uint32_t> next;
    for (const auto& [edge, triangles] : edges) {
      if (triangles.size() != 1) continue;
      const auto a = static_cast<uint32_t>(edge >> 32), b = static_cast<uint32_t>(edge);
      const bool along = runs_along(triangles[0], a, b);
      next.emplace(along ? b : a, along ? a : b);
    }
    while (!next.empty()) {
      // Follow the edge of a hole until it comes back to any vertex: that is a loop.
      std::vector<uint32_t> path = {next.begin()->first};
      for (;;) {
        const auto edge = next.find(path.back());
        if (edge == next.end()) break;  // not a loop: edges of three or more triangles meet it
        const uint32_t corner = edge->second;
        next.erase(edge);
        const auto begin = std::ranges::find(path, corner);
        if (begin != path.end()) {
          fill({begin, path.end()}, edges);
          path.erase(begin + 1, path.end());
          if (path.size() == 1) break;
        } else {
          path.push_back(corner);
        }
      }
    }
  }

  // Fills the loop with the triangulation of least area, by those of its parts; none that has an
  // edge which the mesh has already.
  void fill(const std::vector<uint32_t>& loop, const EdgeTriangles& edges) {
    const size_t n = loop.size();
    if (n < 3 || n > options_.max_hole_edges) return;
    constexpr double kNever = std::numeric_limits<double>::infinity();
    const auto point = [&](size_t i) { return Vec3d(mesh().vertices[loop[i]]); };
    const auto usable = [&](size_t i, size_t k) {
      return k == i + 1 || (i == 0 && k + 1 == n) || !edges.contains(undirected(loop[i], loop[k]));
    };
    std::vector<double> least(n * n);  // of the part from corner i to k
    std::vector<size_t> apex(n * n);
    for (size_t span = 2; span < n; ++span) {
      for (size_t i = 0; i + span < n; ++i) {
        const size_t k = i + span;
        double& best = least[i * n + k] = kNever;
        if (!usable(i, k)) continue;
        for (size_t j = i + 1; j < k; ++j) {
          const double area = length(cross(point(j) - point(i), point(k) - point(i))) / 2 +
                              least[i * n + j] + least[j * n + k];
          if (area < best) {
            best = area;
            apex[i * n + k] = j;
          }
        }
      }
    }
    if (least[n - 1] == kNever) return;
    std::vector<std::pair<size_t, size_t>> pending = {{0, n - 1}};
    while (!pending.empty()) {
      const auto [i, k] = pending.back();
      pending.pop_back();
      if (k - i < 2) continue;
      const size_t j = apex[i * n + k];
      mesh().triangles.push_back({loop[i], loop[j], loop[k]});
      pending.emplace_back(i, j);
      pending.emplace_back(j, k);
    }
    repair_.filled_hole_edges.push_back(n);
  }

  // Parts that lie inside an odd number of others are cavities.
  void turn_outwards() {
    DisjointSets joined(mesh().triangles.size());
    for (const auto& [edge, triangles] : edges_of(mesh())) {
      for (const uint32_t t : triangles) joined.join(t, triangles[0]);
    }
    std::map<uint32_t, std::vector<uint32_t>> parts;
    for (uint32_t t = 0; t < mesh().triangles.size(); ++t) parts[joined.find(t)].push_back(t);
    std::vector<Mesh> meshes;
    std::vector<uint32_t> place(mesh().vertices.size());  // of vertices, in the part at hand
    for (const auto& [root, triangles] : parts) {
      Mesh& part = meshes.emplace_back();
      for (const uint32_t t : triangles) {
        Triangle& here = part.triangles.emplace_back(mesh().triangles[t]);
        for (uint32_t& v : here) {
          const bool known =
              place[v] < part.vertices.size() && part.vertices[place[v]] == mesh().vertices[v];
          if (!known) {
            place[v] = static_cast<uint32_t>(part.vertices.size());
            part.vertices.push_back(mesh().vertices[v]);
          }
          v = place[v];
        }
      }
    }
    size_t number = 0;
    for (const auto& [root, triangles] : parts) {
      const Mesh& part = meshes[number++];
      const Triangle& first = part.triangles[0];
      const Vec3d p = (Vec3d(part.vertices[first[0]]) + Vec3d(part.vertices[first[1]]) +
                       Vec3d(part.vertices[first[2]])) *
                      (1.0 / 3);
      size_t around = 0;
      for (const Mesh& other : meshes) {
        around += &other != &part && std::abs(winding_number(other, p)) > 0.5 ? 1 : 0;
      }
      if ((signed_volume(part) < 0) != (around % 2 == 1)) {
        for (const uint32_t t : triangles) turn(t);
      }
    }
  }

  const MeshRepairOptions& options_;
  MeshRepair repair_;
};

}  // namespace

bool MeshRepair::changed() const {
  return welded_vertices + dropped_triangles + flat_triangles + turned_triangles +
             filled_hole_edges.size() >
         0;
}

std::string MeshRepair::describe() const {
  std::vector<std::string> done;
  const auto say = [&](size_t count, const char* one, const char* many, const char* what) {
    if (count > 0) done.push_back(fmt::format("{} {} {}", count, count == 1 ? one : many, what));
  };
  say(welded_vertices, "vertex", "vertices", "welded");
  say(dropped_triangles, "triangle", "triangles", "dropped");
  say(flat_triangles, "facet of no area", "facets of no area", "dropped");
  say(filled_hole_edges.size(), "hole", "holes", "filled");
  if (!filled_hole_edges.empty()) {
    constexpr size_t kNamed = 8;
    const std::span named(filled_hole_edges.data(), std::min(kNamed, filled_hole_edges.size()));
    done.back() += fmt::format(" (of {}{} edges)", fmt::join(named, ", "),
                               filled_hole_edges.size() > kNamed ? ", ..." : "");
  }
  say(turned_triangles, "triangle", "triangles", "turned");
  return done.empty() ? "nothing to repair" : fmt::format("{}", fmt::join(done, ", "));
}

MeshRepair repaired(const Mesh& mesh, const std::string& what, const MeshRepairOptions& options) {
  validate_triangles(mesh, what);
  MeshRepair unchanged{.mesh = welded(mesh), .filled_hole_edges = {}};
  unchanged.flat_triangles = drop_flat_triangles(unchanged.mesh);
  try {
    validate_closed(unchanged.mesh, what);
    return unchanged;
  } catch (const Error&) {
    // That is what is to be repaired.
  }
  MeshRepair repair = Repair(unchanged.mesh, options).run();
  repair.flat_triangles = unchanged.flat_triangles;
  repair.mesh = welded(repair.mesh);
  try {
    validate_closed(repair.mesh, what);
  } catch (const Error& error) {
    throw invalid_input(
        fmt::format("{} cannot be repaired (tried: {}; holes of at most {} edges are filled): {}",
                    what, repair.describe(), options.max_hole_edges, error.what()));
  }
  return repair;
}

void require_closed(const Mesh& mesh, const std::string& what, const std::string& how_to_repair) {
  try {
    validate_closed(mesh, what);
  } catch (const Error& error) {
    const std::string message = error.what();
    throw Error(error.kind(),
                fmt::format("{}{} A mesh that is nearly closed can be repaired: {}", message,
                            message.ends_with('.') ? "" : ".", how_to_repair));
  }
}

}  // namespace itn
