#include "common/geometry/shapes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/cancellation.h"
#include "common/error.h"
#include "common/printable.h"

namespace itn {
namespace {

constexpr double kPi = std::numbers::pi;

struct Vec2d {
  double x = 0, y = 0;
};

uint32_t add_vertex(Mesh& mesh, Vec3d p) {
  mesh.vertices.push_back(Vec3f(p));
  return static_cast<uint32_t>(mesh.vertices.size() - 1);
}

void add_quad(Mesh& mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
  mesh.triangles.push_back({a, b, c});
  mesh.triangles.push_back({a, c, d});
}

// Joins rings of n vertices, ring k at vertices first + k n ..., each to the next.
void join_rings(Mesh& mesh, uint32_t first, uint32_t rings, uint32_t n) {
  for (uint32_t k = 0; k + 1 < rings; ++k) {
    for (uint32_t j = 0; j < n; ++j) {
      const uint32_t a = first + k * n + j, b = first + k * n + (j + 1) % n;
      add_quad(mesh, a, b, b + n, a + n);
    }
  }
}

// Closes the open end of a tube of rings by a fan around one point.
void close_ring(Mesh& mesh, uint32_t ring, uint32_t n, Vec3d tip, bool at_start) {
  const uint32_t pole = add_vertex(mesh, tip);
  for (uint32_t j = 0; j < n; ++j) {
    const uint32_t a = ring + j, b = ring + (j + 1) % n;
    if (at_start) {
      mesh.triangles.push_back({pole, b, a});
    } else {
      mesh.triangles.push_back({pole, a, b});
    }
  }
}

// The builders care for closed surfaces; whichever way round they come out is put right here.
Mesh outward(Mesh mesh) {
  if (signed_volume(mesh) < 0) {
    for (auto& t : mesh.triangles) std::swap(t[1], t[2]);
  }
  return mesh;
}

// --- Lofts: an outline around the y axis, scaled along a profile -------------------------------

// n points of a curve in polar form: radius(angle).
std::vector<Vec2d> outline(int n, const std::function<double(double)>& radius) {
  std::vector<Vec2d> points;
  for (int j = 0; j < n; ++j) {
    const double angle = 2 * kPi * j / n;
    points.push_back({radius(angle) * std::cos(angle), radius(angle) * std::sin(angle)});
  }
  return points;
}

std::vector<Vec2d> circle(int n = 128) {
  return outline(n, [](double) { return 1.0; });
}

// A profile lists (scale, height) from the axis back to the axis. Its first and last point must
// have scale 0.
Mesh loft(const std::vector<Vec2d>& around, const std::vector<Vec2d>& profile) {
  Mesh mesh;
  const auto n = static_cast<uint32_t>(around.size());
  for (size_t k = 1; k + 1 < profile.size(); ++k) {
    for (const Vec2d& p : around) {
      add_vertex(mesh, {profile[k].x * p.x, profile[k].y, profile[k].x * p.y});
    }
  }
  const auto rings = static_cast<uint32_t>(profile.size() - 2);
  join_rings(mesh, 0, rings, n);
  close_ring(mesh, 0, n, {0, profile.front().y, 0}, true);
  close_ring(mesh, (rings - 1) * n, n, {0, profile.back().y, 0}, false);
  return outward(std::move(mesh));
}

// A smooth curve through the points (Catmull-Rom), `steps` pieces to each span; x is kept >= 0.
std::vector<Vec2d> smooth_profile(const std::vector<Vec2d>& points, int steps = 8) {
  std::vector<Vec2d> curve;
  const auto at = [&](size_t i, size_t back) {
    return points[std::min(i < back ? 0 : i - back, points.size() - 1)];
  };
  for (size_t i = 0; i + 1 < points.size(); ++i) {
    const Vec2d p0 = at(i, 1), p1 = points[i], p2 = points[i + 1], p3 = at(i + 2, 0);
    for (int s = 0; s < steps; ++s) {
      const double t = static_cast<double>(s) / steps;
      const auto blend = [t](double a, double b, double c, double d) {
        return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)));
      };
      curve.push_back(
          {std::max(0.0, blend(p0.x, p1.x, p2.x, p3.x)), blend(p0.y, p1.y, p2.y, p3.y)});
    }
  }
  curve.push_back(points.back());
  return curve;
}

// Straight sides between two flat ends; the ends are ringed so that a warp can bend them.
std::vector<Vec2d> slab_profile(double height, int end_rings, int layers) {
  std::vector<Vec2d> profile{{0, 0}};
  for (int k = 1; k < end_rings; ++k) profile.push_back({static_cast<double>(k) / end_rings, 0});
  for (int k = 0; k <= layers; ++k) profile.push_back({1, height * k / layers});
  for (int k = end_rings - 1; k > 0; --k) {
    profile.push_back({static_cast<double>(k) / end_rings, height});
  }
  profile.push_back({0, height});
  return profile;
}

Mesh warped(Mesh mesh, const std::function<Vec3d(Vec3d)>& warp) {
  for (Vec3f& p : mesh.vertices) p = Vec3f(warp(Vec3d(p)));
  return mesh;
}

// --- Tubes: a circle swept along a curve ---

// Carries `normal` along from one tangent to the next without twist (parallel transport).
Vec3d transported(Vec3d normal, Vec3d tangent) {
  return normalize(normal - tangent * dot(normal, tangent));
}

// Turns a vector at right angles to the unit axis.
Vec3d turned(Vec3d v, Vec3d axis, double angle) {
  return v * std::cos(angle) + cross(axis, v) * std::sin(angle);
}

std::vector<Vec3d> tangents(const std::vector<Vec3d>& curve, bool closed) {
  const size_t n = curve.size();
  std::vector<Vec3d> result;
  for (size_t i = 0; i < n; ++i) {
    const size_t before = closed ? (i + n - 1) % n : (i == 0 ? 0 : i - 1);
    const size_t after = closed ? (i + 1) % n : std::min(i + 1, n - 1);
    result.push_back(normalize(curve[after] - curve[before]));
  }
  return result;
}

void add_ring(Mesh& mesh, Vec3d center, Vec3d tangent, Vec3d normal, double radius,
              uint32_t sides) {
  const Vec3d binormal = cross(tangent, normal);
  for (uint32_t j = 0; j < sides; ++j) {
    const double angle = 2 * kPi * j / sides;
    add_vertex(
        mesh, center + normal * (radius * std::cos(angle)) + binormal * (radius * std::sin(angle)));
  }
}

Mesh closed_tube(const std::vector<Vec3d>& curve, double radius, uint32_t sides) {
  Mesh mesh;
  const std::vector<Vec3d> along = tangents(curve, true);
  const auto n = static_cast<uint32_t>(curve.size());
  std::vector<Vec3d> normals{Basis<double>(along[0]).s};
  for (uint32_t i = 1; i <= n; ++i) normals.push_back(transported(normals.back(), along[i % n]));
  // Around the loop the frame comes back turned: spread the difference over it.
  const double excess =
      std::atan2(dot(cross(normals[0], normals[n]), along[0]), dot(normals[0], normals[n]));
  for (uint32_t i = 0; i < n; ++i) {
    add_ring(mesh, curve[i], along[i], turned(normals[i], along[i], -excess * i / n), radius,
             sides);
  }
  join_rings(mesh, 0, n, sides);
  for (uint32_t j = 0; j < sides; ++j) {
    const uint32_t next = (j + 1) % sides, last = (n - 1) * sides;
    add_quad(mesh, last + j, last + next, next, j);
  }
  return outward(std::move(mesh));
}

// With round ends.
Mesh open_tube(const std::vector<Vec3d>& curve, double radius, uint32_t sides) {
  constexpr int kEndRings = 6;
  Mesh mesh;
  const std::vector<Vec3d> along = tangents(curve, false);
  const auto end_ring = [&](size_t at, Vec3d normal, double angle, double side) {
    add_ring(mesh, curve[at] + along[at] * (side * radius * std::sin(angle)), along[at], normal,
             radius * std::cos(angle), sides);
  };
  Vec3d normal = Basis<double>(along[0]).s;
  for (int k = kEndRings - 1; k > 0; --k) end_ring(0, normal, k * kPi / (2 * kEndRings), -1);
  for (size_t i = 0; i < curve.size(); ++i) {
    normal = transported(normal, along[i]);
    add_ring(mesh, curve[i], along[i], normal, radius, sides);
  }
  const size_t last = curve.size() - 1;
  for (int k = 1; k < kEndRings; ++k) end_ring(last, normal, k * kPi / (2 * kEndRings), 1);
  const auto rings = static_cast<uint32_t>(mesh.vertices.size()) / sides;
  join_rings(mesh, 0, rings, sides);
  close_ring(mesh, 0, sides, curve[0] - along[0] * radius, true);
  close_ring(mesh, (rings - 1) * sides, sides, curve[last] + along[last] * radius, false);
  return outward(std::move(mesh));
}

std::vector<Vec3d> sampled(const std::function<Vec3d(double)>& curve, int points) {
  std::vector<Vec3d> result;
  result.reserve(static_cast<size_t>(points));
  for (int i = 0; i < points; ++i) result.push_back(curve(2 * kPi * i / points));
  return result;
}

// --- Stars: a radius for every direction ---------------------------------------------------------

// A unit icosahedron, each triangle split in four `levels` times.
Mesh icosphere(int levels) {
  const double a = 1, b = (1 + std::sqrt(5.0)) / 2;
  Mesh mesh;
  for (const Vec3d p : {Vec3d{-a, b, 0},
                        {a, b, 0},
                        {-a, -b, 0},
                        {a, -b, 0},
                        {0, -a, b},
                        {0, a, b},
                        {0, -a, -b},
                        {0, a, -b},
                        {b, 0, -a},
                        {b, 0, a},
                        {-b, 0, -a},
                        {-b, 0, a}}) {
    add_vertex(mesh, normalize(p));
  }
  mesh.triangles = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                    {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                    {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                    {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  for (int level = 0; level < levels; ++level) {
    std::unordered_map<uint64_t, uint32_t> middles;
    const auto middle = [&](uint32_t p, uint32_t q) {
      const uint64_t key = uint64_t{std::min(p, q)} << 32 | std::max(p, q);
      const auto [it, is_new] = middles.try_emplace(key);
      if (is_new) {
        it->second = add_vertex(mesh, normalize(Vec3d(mesh.vertices[p]) + Vec3d(mesh.vertices[q])));
      }
      return it->second;
    };
    std::vector<std::array<uint32_t, 3>> finer;
    for (const auto& [p, q, r] : mesh.triangles) {
      const uint32_t pq = middle(p, q), qr = middle(q, r), rp = middle(r, p);
      finer.insert(finer.end(), {{p, pq, rp}, {q, qr, pq}, {r, rp, qr}, {pq, qr, rp}});
    }
    mesh.triangles = std::move(finer);
  }
  return mesh;
}

Mesh star(const std::function<double(Vec3d)>& radius, int levels = 5) {
  return warped(icosphere(levels), [&](Vec3d p) {
    const Vec3d d = normalize(p);
    return d * radius(d);
  });
}

// --- Implicit solids: where a function is negative -----------------------------------------------

using Field = std::function<double(Vec3d)>;

// Triangulates {field < 0} inside a box by marching tetrahedra: every cell of the grid is cut into
// six tetrahedra along its diagonal, the same way in all cells, so that the surface is closed
// wherever the field is positive on the sides of the box.
class MarchingTetrahedra {
 public:
  MarchingTetrahedra(const Field& field, Vec3d low, Vec3d high, double cell,
                     Cancellation& cancellation)
      : low_(low),
        cell_(cell),
        nx_(cells(high.x - low.x) + 1),
        ny_(cells(high.y - low.y) + 1),
        nz_(cells(high.z - low.z) + 1),
        values_(size_t{nx_} * ny_ * nz_) {
    for (uint32_t i = 0; i < values_.size(); ++i) {
      cancellation.turn();
      values_[i] = field(position(i));
    }
  }

  Mesh triangulate() {
    for (uint32_t z = 0; z + 1 < nz_; ++z) {
      for (uint32_t y = 0; y + 1 < ny_; ++y) {
        for (uint32_t x = 0; x + 1 < nx_; ++x) cut_cell((z * ny_ + y) * nx_ + x);
      }
    }
    return std::move(mesh_);
  }

 private:
  uint32_t cells(double extent) const { return static_cast<uint32_t>(std::ceil(extent / cell_)); }

  Vec3d position(uint32_t node) const {
    const uint32_t x = node % nx_, y = node / nx_ % ny_, z = node / nx_ / ny_;
    return low_ + Vec3d{double(x), double(y), double(z)} * cell_;
  }

  void cut_cell(uint32_t corner) {
    const std::array<uint32_t, 3> step{1, nx_, nx_ * ny_};
    constexpr std::array<std::array<int, 3>, 6> kOrders{
        {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}}};
    for (const auto& order : kOrders) {
      std::array<uint32_t, 4> nodes{corner};
      for (int i = 0; i < 3; ++i) nodes[i + 1] = nodes[i] + step[order[i]];
      cut_tetrahedron(nodes);
    }
  }

  void cut_tetrahedron(const std::array<uint32_t, 4>& nodes) {
    std::vector<uint32_t> in, out;
    for (const uint32_t node : nodes) (values_[node] < 0 ? in : out).push_back(node);
    if (in.empty() || out.empty()) return;
    const Vec3d direction = position(out[0]) - position(in[0]);
    if (in.size() == 2) {
      const uint32_t a = crossing(in[0], out[0]), b = crossing(in[0], out[1]);
      const uint32_t c = crossing(in[1], out[1]), d = crossing(in[1], out[0]);
      add_facing(a, b, c, direction);
      add_facing(a, c, d, direction);
    } else if (in.size() == 1) {
      add_facing(crossing(in[0], out[0]), crossing(in[0], out[1]), crossing(in[0], out[2]),
                 direction);
    } else {
      add_facing(crossing(in[0], out[0]), crossing(in[1], out[0]), crossing(in[2], out[0]),
                 direction);
    }
  }

  // The vertex where the surface cuts the edge between two nodes; kept off the nodes so that no
  // triangle degenerates.
  uint32_t crossing(uint32_t in, uint32_t out) {
    const uint64_t key = uint64_t{std::min(in, out)} << 32 | std::max(in, out);
    const auto [it, is_new] = crossings_.try_emplace(key);
    if (is_new) {
      const double t = std::clamp(values_[in] / (values_[in] - values_[out]), 0.05, 0.95);
      it->second = add_vertex(mesh_, position(in) * (1 - t) + position(out) * t);
    }
    return it->second;
  }

  // The plane of the triangle has the inner nodes behind it.
  void add_facing(uint32_t a, uint32_t b, uint32_t c, Vec3d direction) {
    const Vec3d p(mesh_.vertices[a]), q(mesh_.vertices[b]), r(mesh_.vertices[c]);
    if (dot(cross(q - p, r - p), direction) < 0) std::swap(b, c);
    mesh_.triangles.push_back({a, b, c});
  }

  Vec3d low_;
  double cell_;
  uint32_t nx_, ny_, nz_;
  std::vector<double> values_;
  std::unordered_map<uint64_t, uint32_t> crossings_;
  Mesh mesh_;
};

double ball(Vec3d p, Vec3d center, double radius) {
  return length(p - center) - radius;
}

// Around a segment, with a radius at each end.
double capsule(Vec3d p, Vec3d a, Vec3d b, double radius_a, double radius_b) {
  const Vec3d axis = b - a;
  const double t = std::clamp(dot(p - a, axis) / dot(axis, axis), 0.0, 1.0);
  return length(p - a - axis * t) - (radius_a * (1 - t) + radius_b * t);
}

// About the y axis, between two heights.
double cylinder_field(Vec3d p, double radius, double bottom, double top) {
  return std::max({std::hypot(p.x, p.z) - radius, bottom - p.y, p.y - top});
}

// Union with a fillet of about the given radius (polynomial smooth minimum).
double blend(double a, double b, double fillet) {
  const double h = std::max(fillet - std::abs(a - b), 0.0) / fillet;
  return std::min(a, b) - h * h * fillet / 4;
}

// --- The shapes ---

Mesh make_sphere() {
  return star([](Vec3d) { return 1.0; });
}

Mesh make_cube() {
  Mesh mesh;
  for (int i = 0; i < 8; ++i) add_vertex(mesh, {double(i & 1), double(i >> 1 & 1), double(i >> 2)});
  add_quad(mesh, 0, 2, 3, 1);
  add_quad(mesh, 4, 5, 7, 6);
  add_quad(mesh, 0, 1, 5, 4);
  add_quad(mesh, 2, 6, 7, 3);
  add_quad(mesh, 0, 4, 6, 2);
  add_quad(mesh, 1, 3, 7, 5);
  return mesh;
}

Mesh make_rounded_cube() {
  return star([](Vec3d d) {
    constexpr double kPower = 6;
    return std::pow(std::pow(std::abs(d.x), kPower) + std::pow(std::abs(d.y), kPower) +
                        std::pow(std::abs(d.z), kPower),
                    -1 / kPower);
  });
}

Mesh make_cylinder() {
  return loft(circle(), {{0, 0}, {0.25, 0}, {0.25, 1}, {0, 1}});
}

Mesh make_cone() {
  return loft(circle(), {{0, 0}, {0.4, 0}, {0, 1}});
}

Mesh make_torus() {
  const auto ring = [](double t) { return Vec3d{std::cos(t), 0, std::sin(t)}; };
  return closed_tube(sampled(ring, 160), 0.3, 48);
}

Mesh make_smooth_star() {
  return star([](Vec3d d) {
    return 1 + 0.25 *
                   (std::sin(4 * kPi * d.x) + std::sin(4 * kPi * d.y) + std::sin(4 * kPi * d.z)) /
                   1.5;
  });
}

Mesh make_urchin() {
  const Mesh spikes = icosphere(1);
  return star([&spikes](Vec3d d) {
    double radius = 0.45;
    for (const Vec3f s : spikes.vertices) {
      const double cos_angle = dot(d, normalize(Vec3d(s)));
      radius += 0.55 * std::exp(60 * (cos_angle - 1));
    }
    return radius;
  });
}

Mesh make_leaf() {
  const auto edge = [](double angle) {
    return (0.35 + 0.65 * std::abs(std::cos(angle))) * (1 + 0.04 * std::cos(18 * angle));
  };
  return warped(loft(outline(216, edge), slab_profile(0.05, 20, 2)), [](Vec3d p) {
    return Vec3d{p.x, p.y + 0.25 * (1 - std::cos(1.6 * p.x)) + 0.35 * p.z * p.z, p.z};
  });
}

Mesh make_bowl() {
  return loft(circle(), smooth_profile({{0, 0},
                                        {0.2, 0},
                                        {0.25, 0.02},
                                        {0.38, 0.1},
                                        {0.47, 0.24},
                                        {0.5, 0.4},
                                        {0.48, 0.42},
                                        {0.46, 0.4},
                                        {0.43, 0.26},
                                        {0.345, 0.14},
                                        {0.2, 0.075},
                                        {0, 0.06}}));
}

Mesh make_goblet() {
  return loft(circle(96), smooth_profile({{0, 0},
                                          {0.26, 0},
                                          {0.27, 0.02},
                                          {0.1, 0.06},
                                          {0.045, 0.2},
                                          {0.045, 0.36},
                                          {0.2, 0.48},
                                          {0.3, 0.68},
                                          {0.29, 0.98},
                                          {0.27, 1},
                                          {0.25, 0.98},
                                          {0.26, 0.7},
                                          {0.16, 0.53},
                                          {0, 0.47}}));
}

Mesh make_mushroom() {
  return loft(circle(96), smooth_profile({{0, 0},
                                          {0.13, 0},
                                          {0.15, 0.03},
                                          {0.1, 0.2},
                                          {0.09, 0.4},
                                          {0.12, 0.5},
                                          {0.3, 0.47},
                                          {0.44, 0.45},
                                          {0.46, 0.49},
                                          {0.38, 0.68},
                                          {0.2, 0.8},
                                          {0, 0.84}}));
}

Mesh make_dumbbell() {
  return loft(circle(96), smooth_profile({{0, 0},
                                          {0.12, 0.01},
                                          {0.24, 0.1},
                                          {0.27, 0.22},
                                          {0.2, 0.36},
                                          {0.07, 0.45},
                                          {0.06, 0.5},
                                          {0.07, 0.55},
                                          {0.16, 0.64},
                                          {0.21, 0.78},
                                          {0.16, 0.93},
                                          {0.08, 0.99},
                                          {0, 1}}));
}

Mesh make_gear() {
  const auto teeth = [](double angle) { return 0.82 + 0.18 * std::tanh(4 * std::sin(14 * angle)); };
  const Mesh lying = loft(outline(14 * 24, teeth), slab_profile(0.3, 1, 6));
  return warped(lying, [](Vec3d p) { return Vec3d{p.x, p.z, -p.y}; });
}

Mesh make_fins() {
  const auto blades = [](double angle) {
    return 0.16 + 0.34 * std::pow(std::abs(std::cos(4 * angle)), 12.0);
  };
  return loft(outline(8 * 40, blades), slab_profile(0.9, 1, 12));
}

Mesh make_twist() {
  const auto lobes = [](double angle) { return 0.24 + 0.08 * std::cos(4 * angle); };
  return warped(loft(outline(128, lobes), slab_profile(1, 4, 64)), [](Vec3d p) {
    const double c = std::cos(2.2 * p.y), s = std::sin(2.2 * p.y);
    return Vec3d{c * p.x + s * p.z, p.y, c * p.z - s * p.x};
  });
}

Mesh make_knot() {
  const auto trefoil = [](double t) {
    return Vec3d{std::sin(t) + 2 * std::sin(2 * t), std::cos(t) - 2 * std::cos(2 * t),
                 -std::sin(3 * t)};
  };
  return closed_tube(sampled(trefoil, 320), 0.42, 28);
}

Mesh make_spring() {
  std::vector<Vec3d> helix;
  for (int i = 0; i <= 360; ++i) {
    const double turns = 4.5 * i / 360, angle = 2 * kPi * turns;
    helix.push_back({0.3 * std::cos(angle), 0.2 * turns, 0.3 * std::sin(angle)});
  }
  return open_tube(helix, 0.055, 24);
}

Mesh make_frame(Cancellation& cancellation) {
  const auto field = [](Vec3d p) {
    // By symmetry only the nearest of the four parallel edges counts in each direction.
    const Vec3d q{std::abs(p.x), std::abs(p.y), std::abs(p.z)};
    double d = capsule(q, {1, 1, 0}, {1, 1, 1}, 0.12, 0.12);
    d = blend(d, capsule(q, {1, 0, 1}, {1, 1, 1}, 0.12, 0.12), 0.1);
    return blend(d, capsule(q, {0, 1, 1}, {1, 1, 1}, 0.12, 0.12), 0.1);
  };
  return MarchingTetrahedra(field, {-1.25, -1.25, -1.25}, {1.25, 1.25, 1.25}, 0.0571, cancellation)
      .triangulate();
}

Mesh make_mug(Cancellation& cancellation) {
  const auto field = [](Vec3d p) {
    const double ring = std::hypot(p.x - 0.36, p.y - 0.45) - 0.24;
    const double handle = std::hypot(ring, p.z) - 0.055;
    const double solid = blend(cylinder_field(p, 0.36, 0, 0.9), handle, 0.06);
    return std::max(solid, -cylinder_field(p, 0.29, 0.09, 2));
  };
  return MarchingTetrahedra(field, {-0.41, -0.05, -0.41}, {0.71, 0.95, 0.41}, 0.0257, cancellation)
      .triangulate();
}

Mesh make_figure(Cancellation& cancellation) {
  const auto field = [](Vec3d p) {
    const Vec3d q{std::abs(p.x), p.y, p.z};                       // left and right alike
    double d = capsule(q, {0, 0.42, 0}, {0, 0.6, 0}, 0.2, 0.15);  // body
    d = blend(d, ball(q, {0, 0.9, -0.03}, 0.15), 0.08);           // head
    d = blend(d, capsule(q, {0, 0.88, -0.14}, {0, 0.86, -0.25}, 0.07, 0.05), 0.05);       // snout
    d = blend(d, capsule(q, {0.07, 1.0, 0}, {0.17, 1.28, 0.03}, 0.045, 0.025), 0.04);     // ears
    d = blend(d, capsule(q, {0.15, 0.66, 0}, {0.42, 0.55, -0.12}, 0.07, 0.045), 0.06);    // arms
    d = blend(d, capsule(q, {0.1, 0.35, 0}, {0.17, 0.08, 0}, 0.1, 0.07), 0.06);           // legs
    d = blend(d, capsule(q, {0.17, 0.06, 0.02}, {0.19, 0.05, -0.12}, 0.06, 0.05), 0.04);  // feet
    return blend(d, capsule(q, {0, 0.35, 0.15}, {0, 0.18, 0.42}, 0.07, 0.025), 0.08);     // tail
  };
  return MarchingTetrahedra(field, {-0.52, -0.05, -0.36}, {0.52, 1.36, 0.5}, 0.0203, cancellation)
      .triangulate();
}

Mesh make_tree(Cancellation& cancellation) {
  struct Branch {
    Vec3d from, to;
    double thickness;
  };
  std::vector<Branch> branches;
  const std::function<void(Vec3d, Vec3d, double, double, int)> grow =
      [&](Vec3d from, Vec3d direction, double size, double thickness, int depth) {
        const Vec3d to = from + direction * size;
        branches.push_back({from, to, thickness});
        if (depth == 0) return;
        const Basis<double> around(direction);
        for (int i = 0; i < 3; ++i) {
          const double angle = 2 * kPi * i / 3 + 0.9 * depth;
          const Vec3d turn = around.to_world(0.75 * std::cos(angle), 0.75 * std::sin(angle), 1);
          grow(to, normalize(turn), 0.68 * size, 0.72 * thickness, depth - 1);
        }
      };
  grow({0, 0, 0}, {0, 1, 0}, 0.42, 0.085, 3);
  const auto field = [&](Vec3d p) {
    double d = capsule(p, {0, 0, 0}, {0, 0.06, 0}, 0.18, 0.1);
    for (const Branch& b : branches) {
      d = blend(d, capsule(p, b.from, b.to, b.thickness, 0.8 * b.thickness), 0.03);
    }
    return d;
  };
  return MarchingTetrahedra(field, {-0.8, -0.25, -0.8}, {0.8, 1.3, 0.8}, 0.0211, cancellation)
      .triangulate();
}

struct Builder {
  ShapeInfo info;
  Mesh (*make)(Cancellation&);
};

// Makes a shape that takes no time.
template <Mesh (*make)()>
Mesh at_once(Cancellation& /*cancellation*/) {
  return make();
}

constexpr std::array kBuilders{
    Builder{{"sphere", "a ball"}, at_once<make_sphere>},
    Builder{{"cube", "a box of 12 triangles"}, at_once<make_cube>},
    Builder{{"rounded_cube", "a box with soft edges"}, at_once<make_rounded_cube>},
    Builder{{"cylinder", "a column, twice as high as wide"}, at_once<make_cylinder>},
    Builder{{"cone", "a cone with a sharp tip"}, at_once<make_cone>},
    Builder{{"torus", "a thick ring"}, at_once<make_torus>},
    Builder{{"smooth_star", "a ball with soft bumps"}, at_once<make_smooth_star>},
    Builder{{"urchin", "a ball with thin spikes"}, at_once<make_urchin>},
    Builder{{"leaf", "a thin bent plate with a scalloped edge"}, at_once<make_leaf>},
    Builder{{"bowl", "a thick shell, open at the top"}, at_once<make_bowl>},
    Builder{{"goblet", "a thin-walled cup on a stem"}, at_once<make_goblet>},
    Builder{{"mushroom", "a cap with a thin rim on a stem"}, at_once<make_mushroom>},
    Builder{{"dumbbell", "two balls and a thin neck"}, at_once<make_dumbbell>},
    Builder{{"gear", "a toothed wheel, upright"}, at_once<make_gear>},
    Builder{{"fins", "a core with eight thin blades"}, at_once<make_fins>},
    Builder{{"twist", "a twisted column of four lobes"}, at_once<make_twist>},
    Builder{{"knot", "a tube along a trefoil knot"}, at_once<make_knot>},
    Builder{{"spring", "a thin coiled tube"}, at_once<make_spring>},
    Builder{{"frame", "the twelve edges of a box"}, make_frame},
    Builder{{"mug", "a cup with a handle"}, make_mug},
    Builder{{"figure", "an animal with ears, limbs and a tail"}, make_figure},
    Builder{{"tree", "branches of falling thickness"}, make_tree},
};

constexpr auto kInfos = [] {
  std::array<ShapeInfo, kBuilders.size()> infos;
  std::ranges::transform(kBuilders, infos.begin(), &Builder::info);
  return infos;
}();

const Builder& find_builder(std::string_view name) {
  const auto it = std::ranges::find(kBuilders, name, [](const Builder& b) { return b.info.name; });
  if (it != kBuilders.end()) return *it;
  std::string names;
  for (const ShapeInfo& info : kInfos) {
    names += names.empty() ? "" : ", ";
    names += info.name;
  }
  throw invalid_input(
      fmt::format("there is no built-in shape \"{}\"; there are: {}", printable(name), names));
}

}  // namespace

std::span<const ShapeInfo> builtin_shapes() {
  return kInfos;
}

void check_shape_name(std::string_view name) {
  find_builder(name);
}

Mesh make_shape(std::string_view name, const std::stop_token& stop) {
  Cancellation cancellation(stop);
  return normalized(find_builder(name).make(cancellation));
}

}  // namespace itn
