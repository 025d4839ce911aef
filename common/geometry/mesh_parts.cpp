#include "common/geometry/mesh_parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "common/error.h"

namespace itn {
namespace {

using Triangle = std::array<uint32_t, 3>;

struct Part {
  std::vector<uint32_t> triangles;
  double volume = 0, extent = 0;
};

void measure(Part& part, const Mesh& mesh) {
  const Vec3d origin(mesh.vertices[mesh.triangles[part.triangles[0]][0]]);
  Vec3d low = origin, high = origin;
  for (const uint32_t t : part.triangles) {
    part.volume += volume6(mesh, mesh.triangles[t], origin) / 6;
    for (const uint32_t v : mesh.triangles[t]) {
      const Vec3d p(mesh.vertices[v]);
      low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
  }
  part.extent = length(high - low);
}

Bounds united(const Bounds& a, const Bounds& b) {
  return {{std::min(a.min.x, b.min.x), std::min(a.min.y, b.min.y), std::min(a.min.z, b.min.z)},
          {std::max(a.max.x, b.max.x), std::max(a.max.y, b.max.y), std::max(a.max.z, b.max.z)}};
}

bool meet(const Bounds& a, const Bounds& b) {
  return a.min.x <= b.max.x && b.min.x <= a.max.x && a.min.y <= b.max.y && b.min.y <= a.max.y &&
         a.min.z <= b.max.z && b.min.z <= a.max.z;
}

// Whether the half line from p, with the inverses of its direction's components, meets a box.
bool meets(Vec3d p, Vec3d inverse, const Bounds& box) {
  double near = 0, far = std::numeric_limits<double>::infinity();
  const auto clip = [&](double from, double per, float low, float high) {
    const double a = (low - from) * per, b = (high - from) * per;
    near = std::max(near, std::min(a, b));
    far = std::min(far, std::max(a, b));
  };
  clip(p.x, inverse.x, box.min.x, box.max.x);
  clip(p.y, inverse.y, box.min.y, box.max.y);
  clip(p.z, inverse.z, box.min.z, box.max.z);
  return near <= far;
}

// Compares the parts of a mesh: a tree of boxes over its triangles, which knows whose they are.
class Parts {
 public:
  Parts(const Mesh& mesh, const std::vector<Part>& parts, std::string what,
        Cancellation& cancellation)
      : mesh_(mesh),
        parts_(parts),
        what_(std::move(what)),
        cancellation_(cancellation),
        part_of_(mesh.triangles.size()),
        touches_(mesh.triangles.size()),
        patience_(100'000'000 + 1000 * mesh.triangles.size()) {
    const Bounds box = bounds(mesh);
    rounding_ = 4 * FLT_EPSILON *
                std::max({std::abs(box.min.x), std::abs(box.min.y), std::abs(box.min.z),
                          std::abs(box.max.x), std::abs(box.max.y), std::abs(box.max.z)});
    for (uint32_t i = 0; i < parts.size(); ++i) {
      for (const uint32_t t : parts[i].triangles) part_of_[t] = i;
    }
    boxes_.reserve(mesh.triangles.size());
    for (const Triangle& t : mesh.triangles) {
      const Vec3f a = mesh.vertices[t[0]], b = mesh.vertices[t[1]], c = mesh.vertices[t[2]];
      Bounds tight = united({a, a}, united({b, b}, {c, c}));
      const Vec3f by{rounding_, rounding_, rounding_};
      boxes_.push_back({tight.min - by, tight.max + by});
    }
    order_.resize(mesh.triangles.size());
    std::iota(order_.begin(), order_.end(), 0U);
    build(0, static_cast<uint32_t>(order_.size()));
  }

  // Throws if an edge of a part passes through a triangle of another; else notes which triangles
  // come so close to another part that they may touch it.
  void check_crossings() {
    for (uint32_t t = 0; t < mesh_.triangles.size(); ++t) compare(t, 0);
  }

  // No part passes through another now, so what does not touch others lies, as far as it hangs
  // together, on one side of each of them: one of its triangles speaks for it. Those that touch
  // others speak for themselves.
  void check_nesting(DisjointSets& islands) {
    std::vector<bool> spoken(mesh_.triangles.size());
    for (const Part& part : parts_) {
      std::optional<int> around;
      Vec3d first{};
      for (const uint32_t t : part.triangles) {
        cancellation_.turn();
        const uint32_t island = islands.find(t);
        if (!touches_[t] && spoken[island]) continue;
        if (!touches_[t]) spoken[island] = true;
        const int here = others_around(t, middle(t));
        if (!around) check_orientation(part, here);
        // The one that is in more parts is where they overlap.
        if (here != around.value_or(here)) throw overlap(here > *around ? middle(t) : first);
        if (!around) first = middle(t);
        around = here;
      }
    }
  }

  bool touches(uint32_t triangle) const { return touches_[triangle]; }

 private:
  struct Node {
    Bounds box;
    uint32_t first = 0, count = 0;  // of a leaf
    uint32_t second_child = 0;      // the first one follows its parent
    uint32_t low_part = 0, high_part = 0;
  };

  uint32_t build(uint32_t begin, uint32_t end) {
    cancellation_.turn();
    const auto number = static_cast<uint32_t>(nodes_.size());
    Node node;
    node.box = boxes_[order_[begin]];
    node.low_part = node.high_part = part_of_[order_[begin]];
    for (uint32_t i = begin; i < end; ++i) {
      node.box = united(node.box, boxes_[order_[i]]);
      node.low_part = std::min(node.low_part, part_of_[order_[i]]);
      node.high_part = std::max(node.high_part, part_of_[order_[i]]);
    }
    nodes_.push_back(node);
    constexpr uint32_t kFew = 4;
    if (end - begin <= kFew) {
      nodes_[number].first = begin;
      nodes_[number].count = end - begin;
      return number;
    }
    const Vec3f extent = node.box.max - node.box.min;
    const auto along = [&](uint32_t t) {
      const Vec3f twice_middle = boxes_[t].min + boxes_[t].max;
      return extent.x >= extent.y && extent.x >= extent.z ? twice_middle.x
             : extent.y >= extent.z                       ? twice_middle.y
                                                          : twice_middle.z;
    };
    const uint32_t middle = begin + (end - begin) / 2;
    std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                     [&](uint32_t a, uint32_t b) { return along(a) < along(b); });
    build(begin, middle);
    const uint32_t second = build(middle, end);
    nodes_[number].second_child = second;
    return number;
  }

  // A triangle with those of later parts below a node.
  void compare(uint32_t t, uint32_t number) {
    const Node& node = nodes_[number];
    if (node.high_part <= part_of_[t] || !meet(node.box, boxes_[t])) return;
    if (node.count == 0) {
      compare(t, number + 1);
      compare(t, node.second_child);
      return;
    }
    for (uint32_t i = node.first; i < node.first + node.count; ++i) {
      const uint32_t other = order_[i];
      if (part_of_[other] <= part_of_[t] || !meet(boxes_[other], boxes_[t])) continue;
      spend();
      touches_[t] = touches_[other] = true;
      for (size_t k = 0; k < 3; ++k) {
        check_edge(t, k, other);
        check_edge(other, k, t);
      }
    }
  }

  Vec3d vertex(uint32_t v) const { return Vec3d(mesh_.vertices[v]); }

  // Throws if edge k of a triangle passes through another, by more than rounding. Where it passes
  // the other's edge, it may pass through two triangles there, or by both: the part around it must
  // not be inside the other on either side.
  void check_edge(uint32_t t, size_t k, uint32_t other) {
    const Triangle &from = mesh_.triangles[t], &through = mesh_.triangles[other];
    const Vec3d p = vertex(from[k]), q = vertex(from[(k + 1) % 3]);
    const Vec3d corners[] = {vertex(through[0]), vertex(through[1]), vertex(through[2])};
    const Vec3d normal =
        normalized_or_zero(cross(corners[1] - corners[0], corners[2] - corners[0]));
    const double above = dot(p - corners[0], normal), below = dot(q - corners[0], normal);
    if (std::min(std::abs(above), std::abs(below)) <= rounding_ || (above > 0) == (below > 0)) {
      return;
    }
    const double fraction = above / (above - below);
    const Vec3d meeting = p + (q - p) * fraction;
    double within = std::numeric_limits<double>::infinity();  // of the other's edges, in mm
    for (size_t i = 0; i < 3; ++i) {
      const Vec3d a = corners[i], side = corners[(i + 1) % 3] - a;
      within = std::min(within, dot(cross(side, meeting - a), normal) / length(side));
    }
    if (within > rounding_) throw overlap(meeting);
    if (within >= -rounding_) {
      constexpr double kBeside = 1e-3;
      const double aside = kBeside * std::min(fraction, 1 - fraction);
      for (const double along : {-aside, aside}) {
        const Vec3d beside = meeting + (q - p) * along;
        const Vec3d on_triangle = beside + (vertex(from[(k + 2) % 3]) - beside) * (0.1 * aside);
        if (others_around(t, on_triangle) != expected_around(t)) throw overlap(meeting);
      }
    }
  }

  static Vec3d normalized_or_zero(Vec3d v) {
    const double size = length(v);
    return size > 0 ? v * (1 / size) : Vec3d{};
  }

  // How many of the other parts have to enclose the part of a triangle, cavities counting -1.
  int expected_around(uint32_t t) const { return parts_[part_of_[t]].volume > 0 ? 0 : 1; }

  // How many of them do, at a point of the triangle, just behind it. By the crossings of a half
  // line, or, if that finds what may not be, of the median of three: one may happen to pass along
  // an edge.
  int others_around(uint32_t t, Vec3d at) {
    int around = others_around(t, at, {0.4082, 0.7071, 0.5774});
    if (around != expected_around(t)) {
      const int second = others_around(t, at, {-0.5345, 0.2673, 0.8018});
      const int third = others_around(t, at, {0.6767, -0.7194, 0.1564});
      around = std::max(std::min(around, second), std::min(std::max(around, second), third));
    }
    return around;
  }

  // Off the edges of a coarser or finer mesh of the same shape.
  Vec3d middle(uint32_t t) const {
    const Triangle& triangle = mesh_.triangles[t];
    return vertex(triangle[0]) * 0.3719 + vertex(triangle[1]) * 0.3257 +
           vertex(triangle[2]) * 0.3024;
  }

  int others_around(uint32_t t, Vec3d place, Vec3d direction) {
    const Triangle& triangle = mesh_.triangles[t];
    const Vec3d a = vertex(triangle[0]);
    const Vec3d normal =
        normalized_or_zero(cross(vertex(triangle[1]) - a, vertex(triangle[2]) - a));
    const Vec3d p = place - normal * (2 * double{rounding_});
    const Vec3d inverse{1 / direction.x, 1 / direction.y, 1 / direction.z};
    int sum = 0;
    pending_.assign(1, 0);
    while (!pending_.empty()) {
      const uint32_t number = pending_.back();
      const Node& node = nodes_[number];
      pending_.pop_back();
      const bool own = node.low_part == part_of_[t] && node.high_part == part_of_[t];
      if (own || !meets(p, inverse, node.box)) continue;
      if (node.count == 0) {
        pending_.push_back(number + 1);
        pending_.push_back(node.second_child);
      }
      for (uint32_t i = node.first; i < node.first + node.count; ++i) {
        spend();
        if (part_of_[order_[i]] != part_of_[t]) {
          sum += crossing(mesh_.triangles[order_[i]], p, direction);
        }
      }
    }
    return sum;
  }

  // 1 if a half line leaves through a triangle, -1 if it enters, else 0.
  int crossing(const Triangle& triangle, Vec3d p, Vec3d direction) const {
    const Vec3d a = vertex(triangle[0]) - p, b = vertex(triangle[1]) - p,
                c = vertex(triangle[2]) - p;
    const double u = dot(direction, cross(a, b)), v = dot(direction, cross(b, c)),
                 w = dot(direction, cross(c, a));
    const bool leaves = u > 0 && v > 0 && w > 0, enters = u < 0 && v < 0 && w < 0;
    if (!leaves && !enters) return 0;
    const double ahead = dot(a, cross(b - a, c - a));
    if (leaves) return ahead > 0 ? 1 : 0;
    return ahead < 0 ? -1 : 0;
  }

  void check_orientation(const Part& part, int around) const {
    const Vec3f where = mesh_.vertices[mesh_.triangles[part.triangles[0]][0]];
    if (part.volume < 0 && around < 1) {
      throw invalid_input(
          fmt::format("{} is inside out: the part at {} encloses {:.6g} mm^3. Triangles must run "
                      "counter-clockwise seen from outside.",
                      what_, describe(where), part.volume));
    }
    if (part.volume > 0 && around > 0) {
      throw invalid_input(
          fmt::format("{} has a part at {} inside another part. A cavity must have its triangles "
                      "the other way round; a solid inside a solid is not accepted.",
                      what_, describe(where)));
    }
    if (around != (part.volume > 0 ? 0 : 1)) throw overlap(middle(part.triangles[0]));
  }

  Error overlap(Vec3d where) const {
    return invalid_input(
        fmt::format("{} has parts that overlap, near {}. Parts may touch, but not overlap: unite "
                    "them into one surface, or move them apart.",
                    what_, describe(static_cast<Vec3f>(where))));
  }

  // A mesh of interlaced parts could take time quadratic in its triangles.
  void spend() {
    cancellation_.turn();
    if (patience_-- == 0) {
      throw invalid_input(fmt::format(
          "{} has parts that come close to one another in so many places that whether they "
          "overlap cannot be told in reasonable time; unite them into one surface",
          what_));
    }
  }

  const Mesh& mesh_;
  const std::vector<Part>& parts_;
  const std::string what_;
  Cancellation& cancellation_;
  std::vector<uint32_t> part_of_;  // of triangles
  std::vector<bool> touches_;
  size_t patience_;            // comparisons of triangles left
  float rounding_;             // of coordinates, in mm
  std::vector<Bounds> boxes_;  // of triangles, enlarged by rounding
  std::vector<uint32_t> order_, pending_;
  std::vector<Node> nodes_;
};

std::vector<Part> parts_of(const Mesh& mesh, DisjointSets& joined, Cancellation& cancellation) {
  constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
  std::vector<uint32_t> part_of(mesh.triangles.size(), kNone);
  std::vector<Part> parts;
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    cancellation.turn();
    uint32_t& part = part_of[joined.find(t)];
    if (part == kNone) {
      part = static_cast<uint32_t>(parts.size());
      parts.emplace_back();
    }
    parts[part].triangles.push_back(t);
  }
  for (Part& part : parts) {
    cancellation.turn();
    measure(part, mesh);
  }
  return parts;
}

// Triangles that share an edge and do not touch other parts.
DisjointSets islands_of(const Mesh& mesh, const Parts& parts, Cancellation& cancellation) {
  DisjointSets islands(mesh.triangles.size());
  // One of those at each vertex speaks for it: triangles around a vertex hang together there.
  constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
  std::vector<uint32_t> at_vertex(mesh.vertices.size(), kNone);
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    cancellation.turn();
    if (parts.touches(t)) continue;
    for (const uint32_t v : mesh.triangles[t]) {
      if (at_vertex[v] == kNone) at_vertex[v] = t;
      islands.join(t, at_vertex[v]);
    }
  }
  return islands;
}

}  // namespace

DisjointSets::DisjointSets(size_t n) : parent_(n) {
  std::iota(parent_.begin(), parent_.end(), 0U);
}

uint32_t DisjointSets::find(uint32_t a) {
  while (parent_[a] != a) a = parent_[a] = parent_[parent_[a]];
  return a;
}

void check_parts(const Mesh& mesh, DisjointSets& joined, const std::string& what,
                 Cancellation& cancellation) {
  const std::vector<Part> parts = parts_of(mesh, joined, cancellation);
  for (const Part& part : parts) {
    const Vec3f where = mesh.vertices[mesh.triangles[part.triangles[0]][0]];
    // Rounding of float coordinates leaves a flat part about this much.
    if (std::abs(part.volume) <= 1e-9 * std::pow(part.extent, 3)) {
      throw invalid_input(
          fmt::format("{} has a part that encloses no volume, at {}", what, describe(where)));
    }
    if (parts.size() == 1 && part.volume < 0) {
      throw invalid_input(
          fmt::format("{} is inside out: the part at {} encloses {:.6g} mm^3. Triangles must run "
                      "counter-clockwise seen from outside.",
                      what, describe(where), part.volume));
    }
  }
  if (parts.size() > 1) {
    Parts compared(mesh, parts, what, cancellation);
    compared.check_crossings();
    DisjointSets islands = islands_of(mesh, compared, cancellation);
    compared.check_nesting(islands);
  }
}

}  // namespace itn
