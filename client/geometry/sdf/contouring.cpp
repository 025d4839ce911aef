#include "client/geometry/sdf/contouring.h"

#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/random.h"

namespace itn::sdf {
namespace {

constexpr float kHalfDiagonal = 0.8660254F;  // of a unit cube
constexpr float kOutside = kReach;           // a distance of points that are outside for certain

struct Index3 {
  int x = 0, y = 0, z = 0;
};

// Evaluates a solid at any number of points, calling use(i, distance) for each in turn.
template <typename Point, typename Use>
void evaluate(const Solid& solid, size_t count, Point point, Use use) {
  Points points;
  Values distances;
  for (size_t first = 0; first < count; first += kLanes) {
    const size_t lanes = std::min(kLanes, count - first);
    for (size_t i = 0; i < kLanes; ++i) points.set(i, point(first + std::min(i, lanes - 1)));
    solid.evaluate(points, distances);
    for (size_t i = 0; i < lanes; ++i) use(first + i, distances[i]);
  }
}

// --- The cube and its sheets ---

// Corner c of a cell is at (c & 1, c >> 1 & 1, c >> 2 & 1). Edge 4 axis + k runs along an axis; the
// bits of k are its place along the next two.
constexpr int corner_of_edge(int edge) {
  const int axis = edge / 4, u = (axis + 1) % 3, v = (axis + 2) % 3;
  return (edge & 1) << u | (edge >> 1 & 1) << v;
}

constexpr int edge_between(int corner, int other) {
  const int low = corner < other ? corner : other, along = corner ^ other;
  const int axis = along == 1 ? 0 : along == 2 ? 1 : 2;
  return 4 * axis + (low >> ((axis + 1) % 3) & 1) + 2 * (low >> ((axis + 2) % 3) & 1);
}

// Which sheets of the surface pass through a cell, and which edges each one crosses.
struct Sheets {
  int count = 0;
  std::array<int8_t, 12> of_edge{};  // -1 where there is no crossing
};

// Two crossings are of one sheet if it passes from one to the other through a face. Of four on a
// face, those at either side of a corner that is inside are joined: solids do not touch there, seen
// from both cells of the face.
constexpr Sheets sheets_of(int inside) {
  const auto is_inside = [inside](int corner) { return (inside >> corner & 1) != 0; };
  std::array<int, 12> joined{};
  for (int e = 0; e < 12; ++e) joined[e] = e;
  const auto join = [&joined](int a, int b) {
    const int from = joined[a], to = joined[b];
    for (int& j : joined) j = j == from ? to : j;
  };
  for (int axis = 0; axis < 3; ++axis) {
    for (int side = 0; side < 2; ++side) {
      const int at = side << axis, u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3;
      const std::array<int, 4> around{at, at | u, at | u | v, at | v};
      std::array<int, 4> edges{}, crossed{};
      int crossings = 0;
      for (int i = 0; i < 4; ++i) {
        edges[i] = edge_between(around[i], around[(i + 1) % 4]);
        if (is_inside(around[i]) != is_inside(around[(i + 1) % 4])) crossed[crossings++] = edges[i];
      }
      if (crossings == 2) join(crossed[0], crossed[1]);
      for (int i = 0; crossings == 4 && i < 4; ++i) {
        if (is_inside(around[i])) join(edges[(i + 3) % 4], edges[i]);
      }
    }
  }
  Sheets sheets;
  std::array<int, 12> name{};
  name.fill(-1);
  for (int e = 0; e < 12; ++e) {
    const int corner = corner_of_edge(e);
    sheets.of_edge[e] = -1;
    if (is_inside(corner) == is_inside(corner | 1 << e / 4)) continue;
    if (name[joined[e]] < 0) name[joined[e]] = sheets.count++;
    sheets.of_edge[e] = static_cast<int8_t>(name[joined[e]]);
  }
  return sheets;
}

constexpr auto kSheets = [] {
  std::array<Sheets, 256> table;
  for (int inside = 0; inside < 256; ++inside) table[inside] = sheets_of(inside);
  return table;
}();

// --- Where a sheet's vertex is ---

struct Crossing {
  uint32_t node = 0;  // at the low end of the edge
  int axis = 0;
  bool leaves = false;  // the solid, along the axis
  Vec3f position, normal;
};

// The point nearest to all planes, in the sense of least squares. What they leave undetermined, a
// place along an edge or on a plane, is the crossings' mean.
class Meeting {
 public:
  void add(const Crossing& crossing) {
    sum_ = sum_ + crossing.position;
    crossings_[count_++] = &crossing;
  }

  // `aside` moves what is undetermined.
  Vec3f point(Vec3f aside) const {
    // Towards the mean, so weakly that corners stay sharp.
    constexpr float kTowardsMean = 0.02F;
    const Vec3f mean = sum_ * (1 / static_cast<float>(count_)) + aside;
    float xx = kTowardsMean, yy = kTowardsMean, zz = kTowardsMean, xy = 0, xz = 0, yz = 0;
    Vec3f b;
    for (size_t i = 0; i < count_; ++i) {
      const Vec3f n = crossings_[i]->normal;
      xx += n.x * n.x, yy += n.y * n.y, zz += n.z * n.z;
      xy += n.x * n.y, xz += n.x * n.z, yz += n.y * n.z;
      b = b + n * dot(n, crossings_[i]->position - mean);
    }
    // Cramer's rule; the matrix is symmetric and positive.
    const Vec3f r0{xx, xy, xz}, r1{xy, yy, yz}, r2{xz, yz, zz};
    const Vec3f c0 = cross(r1, r2), c1 = cross(r2, r0), c2 = cross(r0, r1);
    return mean + (c0 * b.x + c1 * b.y + c2 * b.z) * (1 / dot(r0, c0));
  }

 private:
  Vec3f sum_;
  std::array<const Crossing*, 12> crossings_{};
  size_t count_ = 0;
};

// --- The grid ---

// What is known of the surface from afar: where it is, and how much of it.
struct Survey {
  Vec3f low, high;
  float area = 0;  // 0: there is none
};

// Distances at the middles of the cells of a coarse grid over all that is within reach.
class CoarseGrid {
 public:
  explicit CoarseGrid(const Solid& solid) : distances_(size_t{kCells} * kCells * kCells) {
    evaluate(
        solid, distances_.size(), [](size_t i) { return middle(i); },
        [&](size_t i, float distance) { distances_[i] = distance; });
  }

  Survey survey() const {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    Survey result{{kInfinity, kInfinity, kInfinity}, {-kInfinity, -kInfinity, -kInfinity}, 0};
    size_t near = 0;
    for (size_t i = 0; i < distances_.size(); ++i) {
      const float distance = std::abs(distances_[i]);
      if (distance > kCell * kHalfDiagonal) continue;
      const Vec3f p = middle(i);
      constexpr float kHalf = kCell / 2;
      result.low = {std::min(result.low.x, p.x - kHalf), std::min(result.low.y, p.y - kHalf),
                    std::min(result.low.z, p.z - kHalf)};
      result.high = {std::max(result.high.x, p.x + kHalf), std::max(result.high.y, p.y + kHalf),
                     std::max(result.high.z, p.z + kHalf)};
      near += distance <= kCell * kHalfDiagonal * slope(i) ? 1 : 0;
    }
    // The near cells fill a layer of twice half a diagonal.
    result.area = static_cast<float>(near) * kCell * kCell / (2 * kHalfDiagonal);
    return result;
  }

 private:
  static constexpr int kCells = 24;  // along a side
  static constexpr float kCell = 2 * kReach / kCells, kFirst = -kReach + kCell / 2;

  static Vec3f middle(size_t i) {
    const size_t x = i % kCells, y = i / kCells % kCells, z = i / kCells / kCells;
    const auto at = [](size_t n) { return kFirst + kCell * static_cast<float>(n); };
    return {at(x), at(y), at(z)};
  }

  // The slope of distances that are bounds, which may be less than 1. Along each axis the larger of
  // the differences on both sides: thin solids lie between.
  float slope(size_t i) const {
    float squares = 0;
    for (const size_t step : {1, kCells, kCells * kCells}) {
      const size_t at = i / step % kCells;
      const float before = at > 0 ? distances_[i] - distances_[i - step] : 0;
      const float after = at < kCells - 1 ? distances_[i + step] - distances_[i] : 0;
      const float most = std::max(std::abs(before), std::abs(after)) / kCell;
      squares += most * most;
    }
    return std::min(std::sqrt(squares), 1.0F);
  }

  std::vector<float> distances_;
};

class Contouring {
 public:
  Contouring(const Solid& solid, const Survey& found, float cell) : solid_(solid), cell_(cell) {
    const Vec3f extent = found.high - found.low;
    const auto blocks = [cell](float length) {
      return static_cast<int>(std::ceil(length / (cell * kBlock))) + 1;
    };
    blocks_ = {blocks(extent.x), blocks(extent.y), blocks(extent.z)};
    nodes_ = {kBlock * blocks_.x, kBlock * blocks_.y, kBlock * blocks_.z};
    step_ = {1, static_cast<uint32_t>(nodes_.x),
             static_cast<uint32_t>(nodes_.x) * static_cast<uint32_t>(nodes_.y)};
    // Half a block of margin all around.
    const float margin = cell * kBlock / 2;
    low_ = found.low - Vec3f{margin, margin, margin};
    distances_.assign(size_t{step_[2]} * nodes_.z, kOutside);
  }

  Mesh mesh() {
    evaluate_nodes();
    find_crossings();
    refine_crossings();
    place_vertices();
    form_quadrilaterals();
    unfold();
    form_triangles();
    return std::move(mesh_);
  }

 private:
  static constexpr int kBlock = 4;  // nodes along a side
  // How far out of its cell a vertex may be, and how far in it is if that does not do; in cells.
  static constexpr float kBeyond = 0.6F, kWithin = 0.03F;
  static_assert(size_t{kBlock} * kBlock * kBlock == kLanes);

  Vec3f position(Index3 n) const {
    return low_ +
           Vec3f{static_cast<float>(n.x), static_cast<float>(n.y), static_cast<float>(n.z)} * cell_;
  }
  Vec3f position(uint32_t node) const {
    return position(Index3{static_cast<int>(node % step_[1]),
                           static_cast<int>(node % step_[2] / step_[1]),
                           static_cast<int>(node / step_[2])});
  }
  uint32_t node(Index3 n) const { return n.x + n.y * step_[1] + n.z * step_[2]; }
  bool inside(uint32_t node) const { return distances_[node] < 0; }

  // Calls use(index) for all of a grid.
  template <typename Use>
  static void for_all(Index3 size, Use use) {
    Index3 i;
    for (i.z = 0; i.z < size.z; ++i.z) {
      for (i.y = 0; i.y < size.y; ++i.y) {
        for (i.x = 0; i.x < size.x; ++i.x) use(i);
      }
    }
  }

  // In blocks whose middle is too far from the surface, that is the distance of all nodes. On the
  // sides of the grid everything is outside, so that the surface is closed.
  void evaluate_nodes() {
    std::vector<Index3> blocks;
    for_all(blocks_, [&](Index3 b) {
      blocks.push_back({kBlock * b.x, kBlock * b.y, kBlock * b.z});
    });
    // The middle of a block's nodes and of the edges that go on to the next ones.
    constexpr float kMiddle = kBlock / 2.0F;
    const float radius = kMiddle * 2 * kHalfDiagonal * cell_;
    evaluate(
        solid_, blocks.size(),
        [&](size_t i) {
          return position(blocks[i]) + Vec3f{kMiddle, kMiddle, kMiddle} * cell_;
        },
        [&](size_t i, float distance) {
          if (std::abs(distance) <= radius) {
            evaluate_block(blocks[i]);
          } else if (distance < 0) {
            for_all({kBlock, kBlock, kBlock}, [&](Index3 n) { set(blocks[i], n, distance); });
          }
        });
  }

  void evaluate_block(Index3 first) {
    const auto offset = [](size_t i) {
      return Index3{static_cast<int>(i % kBlock), static_cast<int>(i / kBlock % kBlock),
                    static_cast<int>(i / kBlock / kBlock)};
    };
    const Vec3f origin = position(first);
    Points points;
    Values distances;
    for (size_t i = 0; i < kLanes; ++i) {
      const Index3 n = offset(i);
      points.set(i, origin + Vec3f{static_cast<float>(n.x), static_cast<float>(n.y),
                                   static_cast<float>(n.z)} *
                                 cell_);
    }
    solid_.evaluate(points, distances);
    for (size_t i = 0; i < kLanes; ++i) set(first, offset(i), distances[i]);
  }

  void set(Index3 first, Index3 n, float distance) {
    const Index3 at{first.x + n.x, first.y + n.y, first.z + n.z};
    const bool at_side = at.x == 0 || at.y == 0 || at.z == 0 || at.x == nodes_.x - 1 ||
                         at.y == nodes_.y - 1 || at.z == nodes_.z - 1;
    distances_[node(at)] = at_side ? kOutside : distance;
  }

  void find_crossings() {
    crossing_of_edge_.assign(3 * distances_.size(), -1);
    // Nodes on the sides are outside: an edge from one crosses no side.
    const auto nodes = static_cast<uint32_t>(distances_.size());
    for (uint32_t n = 0; n < nodes - step_[2]; ++n) {
      for (int axis = 0; axis < 3; ++axis) {
        const bool leaves = inside(n);
        if (leaves == inside(n + step_[axis])) continue;
        crossing_of_edge_[3 * size_t{n} + axis] = static_cast<int32_t>(crossings_.size());
        crossings_.push_back({n, axis, leaves, {}, {}});
      }
    }
  }

  // By the rule of false position, with a bisection in between for fields that bend, and the normal
  // by differences.
  void refine_crossings() {
    struct Bracket {
      Vec3f low, along;
      float from = 0, to = 1, at_from, at_to;
      float fraction() const { return from + (to - from) * at_from / (at_from - at_to); }
    };
    std::vector<Bracket> brackets;
    brackets.reserve(crossings_.size());
    for (const Crossing& c : crossings_) {
      Vec3f along;
      (c.axis == 0 ? along.x : c.axis == 1 ? along.y : along.z) = cell_;
      brackets.push_back(
          {position(c.node), along, 0, 1, distances_[c.node], distances_[c.node + step_[c.axis]]});
    }
    const auto shrink = [&](const auto& fraction) {
      evaluate(
          solid_, brackets.size(),
          [&](size_t i) { return brackets[i].low + brackets[i].along * fraction(brackets[i]); },
          [&](size_t i, float distance) {
            Bracket& b = brackets[i];
            const float at = fraction(b);
            const bool beyond = (distance < 0) != (b.at_from < 0);
            (beyond ? b.to : b.from) = at;
            (beyond ? b.at_to : b.at_from) = distance;
          });
    };
    shrink([](const Bracket& b) { return b.fraction(); });
    shrink([](const Bracket& b) { return (b.from + b.to) / 2; });
    for (size_t i = 0; i < crossings_.size(); ++i) {
      const Bracket& b = brackets[i];
      crossings_[i].position = b.low + b.along * std::clamp(b.fraction(), 0.0F, 1.0F);
    }
    set_normals();
  }

  void set_normals() {
    // Differences along the diagonals of a cube: four points instead of six.
    constexpr std::array<Vec3f, 4> kUnreachable{Vec3f{1, -1, -1}, Vec3f{-1, -1, 1},
                                                Vec3f{-1, 1, -1}, Vec3f{1, 1, 1}};
    const float step = 0.01F * cell_;
    evaluate(
        solid_, 4 * crossings_.size(),
        [&](size_t i) { return crossings_[i / 4].position + kUnreachable[i % 4] * step; },
        [&](size_t i, float distance) {
          Vec3f& normal = crossings_[i / 4].normal;
          normal = normal + kUnreachable[i % 4] * distance;
        });
    for (Crossing& c : crossings_) {
      const float size = length(c.normal);
      // The normal is that of the edge where differences cancel.
      Vec3f along;
      (c.axis == 0 ? along.x : c.axis == 1 ? along.y : along.z) = c.leaves ? 1.0F : -1.0F;
      c.normal = size > 1e-3F * step ? c.normal * (1 / size) : along;
    }
  }

  uint8_t inside_corners(uint32_t cell) const {
    int corners = 0;
    for (int c = 0; c < 8; ++c) {
      const uint32_t at = cell + (c & 1) + (c >> 1 & 1) * step_[1] + (c >> 2) * step_[2];
      corners |= (inside(at) ? 1 : 0) << c;
    }
    return static_cast<uint8_t>(corners);
  }

  const Crossing& crossing(uint32_t cell, int edge) const {
    const int c = corner_of_edge(edge);
    const uint32_t at = cell + (c & 1) + (c >> 1 & 1) * step_[1] + (c >> 2) * step_[2];
    return crossings_[crossing_of_edge_[3 * size_t{at} + edge / 4]];
  }

  void place_vertices() {
    first_vertex_.assign(distances_.size(), 0);
    sheets_.assign(distances_.size(), 0);
    for_all({nodes_.x - 1, nodes_.y - 1, nodes_.z - 1}, [&](Index3 cube) {
      const uint32_t cell = node(cube);
      const uint8_t corners = inside_corners(cell);
      if (corners == 0 || corners == 255) return;
      sheets_[cell] = corners;
      first_vertex_[cell] = static_cast<uint32_t>(mesh_.vertices.size());
      for (int sheet = 0; sheet < kSheets[corners].count; ++sheet) {
        Meeting meeting;
        for (int edge = 0; edge < 12; ++edge) {
          if (kSheets[corners].of_edge[edge] == sheet) meeting.add(crossing(cell, edge));
        }
        const Vec3f low = position(cube), point = meeting.point(aside(cell));
        mesh_.vertices.push_back(near_cell(low, point, kBeyond));
        safe_.push_back(near_cell(low, point, -kWithin));
      }
    });
  }

  // Vertices in a row, as a flat side would have them otherwise, leave whoever simplifies the mesh
  // with triangles of no area, which are easily turned over.
  Vec3f aside(uint32_t cell) const {
    constexpr float kFarthest = 0.25F;  // in cells
    const uint64_t random = SplitMix(cell).next();
    const auto part = [&](int bit) {
      return (static_cast<float>(random >> bit & 0xffff) / 0x8000 - 1) * kFarthest * cell_;
    };
    return {part(0), part(16), part(32)};
  }

  // The nearest point that is no farther outside of a cell, in cells.
  Vec3f near_cell(Vec3f low, Vec3f p, float outside) const {
    const float least = -outside * cell_, most = (1 + outside) * cell_;
    return low + Vec3f{std::clamp(p.x - low.x, least, most), std::clamp(p.y - low.y, least, most),
                       std::clamp(p.z - low.z, least, most)};
  }

  // One around each crossing, counter-clockwise seen from outside.
  void form_quadrilaterals() {
    for (const Crossing& c : crossings_) {
      const uint32_t u = step_[(c.axis + 1) % 3], v = step_[(c.axis + 2) % 3];
      const auto vertex = [&](int before_u, int before_v) {
        const uint32_t cell = c.node - before_u * u - before_v * v;
        const int edge = 4 * c.axis + before_u + 2 * before_v;
        return first_vertex_[cell] + static_cast<uint32_t>(kSheets[sheets_[cell]].of_edge[edge]);
      };
      quadrilaterals_.push_back({vertex(1, 1), vertex(0, 1), vertex(0, 0), vertex(1, 0)});
      if (!c.leaves) std::swap(quadrilaterals_.back()[1], quadrilaterals_.back()[3]);
    }
  }

  // A quadrilateral's two triangles, and the cosine of the larger angle between one of them and the
  // surface: cut along the diagonal where that angle is smaller.
  struct Cut {
    std::array<std::array<uint32_t, 3>, 2> triangles;
    float facing;
  };
  Cut cut(size_t i) const {
    const auto& q = quadrilaterals_[i];
    Cut a{{{{q[0], q[1], q[2]}, {q[0], q[2], q[3]}}}, 0};
    Cut b{{{{q[1], q[2], q[3]}, {q[1], q[3], q[0]}}}, 0};
    a.facing = facing(a, crossings_[i].normal);
    b.facing = facing(b, crossings_[i].normal);
    return a.facing >= b.facing ? a : b;
  }

  float facing(const Cut& c, Vec3f normal) const {
    float least = 1;
    for (const auto& [p, q, r] : c.triangles) {
      const Vec3f n =
          cross(mesh_.vertices[q] - mesh_.vertices[p], mesh_.vertices[r] - mesh_.vertices[p]);
      least = std::min(least, dot(n, normal) / std::max(length(n), FLT_MIN));
    }
    return least;
  }

  // Vertices beyond their cells make edges sharp that the grid sees but a part of. Where the
  // surface folds over because of them, they go back.
  void unfold() {
    constexpr float kFolded = 0.5F;
    for (int pass = 0; pass < 3; ++pass) {
      for (size_t i = 0; i < quadrilaterals_.size(); ++i) {
        if (cut(i).facing > kFolded) continue;
        for (const uint32_t v : quadrilaterals_[i]) mesh_.vertices[v] = safe_[v];
      }
    }
  }

  void form_triangles() {
    for (size_t i = 0; i < quadrilaterals_.size(); ++i) {
      const Cut c = cut(i);
      mesh_.triangles.insert(mesh_.triangles.end(), c.triangles.begin(), c.triangles.end());
    }
  }

  const Solid& solid_;
  float cell_;
  Index3 blocks_, nodes_;
  std::array<uint32_t, 3> step_{};  // between nodes, along each axis
  Vec3f low_;
  std::vector<float> distances_;           // of nodes
  std::vector<int32_t> crossing_of_edge_;  // by node and axis; -1: none
  std::vector<Crossing> crossings_;
  std::vector<uint8_t> sheets_;         // of cells, by the node at their low corner: corners inside
  std::vector<uint32_t> first_vertex_;  // of cells
  std::vector<Vec3f> safe_;             // where each vertex is within its cell
  std::vector<std::array<uint32_t, 4>> quadrilaterals_;  // of crossings
  Mesh mesh_;
};

}  // namespace

Mesh contoured(const Solid& solid, size_t about_triangles) {
  const Survey found = CoarseGrid(solid).survey();
  if (!(found.area > 0)) return {};
  // The edges of a grid cross a plane 1.5 times for each square of the cell's side, on average over
  // its directions; each crossing makes two triangles.
  const float finest = std::max({found.high.x - found.low.x, found.high.y - found.low.y,
                                 found.high.z - found.low.z}) /
                       100;
  const float cell = std::sqrt(3 * found.area / static_cast<float>(about_triangles));
  return Contouring(solid, found, std::max(cell, finest)).mesh();
}

}  // namespace itn::sdf
