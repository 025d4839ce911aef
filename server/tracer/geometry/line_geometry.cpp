#include "server/tracer/geometry/line_geometry.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

#include "server/tracer/geometry/rays.h"

namespace itn::tracer {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
// More crossings than this on one line mean that rounding has trapped it.
constexpr int kMaxCrossings = 100000;

float max_abs(Vec3f v) {
  return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

}  // namespace

Line::Line(Vec3f position, Vec3f unit, SurfaceTriangle on, float extent)
    : direction(unit), slack(4 * FLT_EPSILON * std::max(extent, max_abs(position))), excluded(on) {
  start = 2 * slack;
  origin = position - unit * start;
}

Geometry::Geometry(const Mesh& object, const std::vector<DiffuseSurface>& surfaces)
    : bounds_(bounds(object)) {
  for (const DiffuseSurface& surface : surfaces) {
    surfaces_.push_back(surface.mesh);
    std::vector<Vec3f>& normals = surface_normals_.emplace_back();
    for (const auto& [a, b, c] : surface.mesh.triangles) {
      const auto vertex = [&](uint32_t i) { return static_cast<Vec3d>(surface.mesh.vertices[i]); };
      normals.push_back(
          static_cast<Vec3f>(itn::normalize(cross(vertex(b) - vertex(a), vertex(c) - vertex(a)))));
    }
  }
  extent_ = std::max(max_abs(bounds_.min), max_abs(bounds_.max));
  intersector_ = make_embree_intersector(object, surfaces_);
}

Geometry::~Geometry() = default;

size_t Geometry::memory() const {
  size_t sum = sizeof(*this) + intersector_->memory();
  for (size_t i = 0; i < surfaces_.size(); ++i) {
    sum += (surfaces_[i].vertices.size() + surfaces_[i].triangles.size() +
            surface_normals_[i].size()) *
           sizeof(Vec3f);
  }
  return sum;
}

RayResult Geometry::follow(const Interaction& from, Vec3f direction, float max_medium_length,
                           bool stops_at_boundary, float distance) const {
  const Line line(from.position, direction, from.on, extent_);
  RayResult ray;
  bool inside = from.inside;
  ray.entered = inside;
  float t = line.start;
  const float reach = line.start + distance;
  float last_exit = 0, last_entry = 0;  // distances; crossings of a kind lie beyond the last one
  const float beside = from.at_boundary ? line.start + line.slack : 0;  // up to here rule 4 holds
  const auto from_distance = [&](float last) {
    return std::max(t - line.slack, std::nextafter(last, kInfinity));
  };
  // Whether the line goes on at a crossing.
  const auto passes = [&](const Hit& hit) {
    if (!stops_at_boundary) return true;
    const auto [point, normal] = intersector_->crossing(hit);
    ray.at = {point, inside, {}};
    ray.normal = normal;
    ray.triangle = hit.triangle;
    ray.v = hit.v;
    ray.w = hit.w;
    ray.end = RayResult::End::kCrossing;
    return false;
  };
  for (int crossings = 0; crossings < kMaxCrossings; ++crossings) {
    if (inside) {
      const float end = std::min(reach, t + (max_medium_length - ray.medium_length));
      Hit hit;
      if (from.at_boundary) {
        hit = intersector_->closest(line, from_distance(last_exit), std::min(beside, end),
                                    Wanted::kExitOnly);
      }
      if (hit.found && dot(intersector_->crossing(hit).normal, from.normal) < kOtherWay) {
        last_exit = hit.t;
        continue;
      }
      if (!hit.found) {
        hit = intersector_->closest(line, std::max(from_distance(last_exit), beside), end,
                                    Wanted::kExit);
      }
      if (stops_at_boundary && hit.on_surface()) {
        const Hit exit = intersector_->closest(line, from_distance(last_exit), hit.t + line.slack,
                                               Wanted::kExitOnly);
        if (exit.found) hit = exit;
      }
      if (!hit.found && end == reach && reach < kInfinity) {
        ray.medium_length += end - t;
        return ray;
      }
      if (!hit.found) {
        ray.medium_length = max_medium_length;
        ray.at = {line.at(end), true, {}};
        ray.end =
            may_contain(ray.at.position) ? RayResult::End::kInMedium : RayResult::End::kLeaked;
        return ray;
      }
      const float exit = std::max(t, hit.t);
      ray.medium_length += exit - t;
      t = exit;
      if (hit.on_surface()) {
        ray.at = surface_interaction(line, hit, true);
        ray.end = RayResult::End::kSurface;
        return ray;
      }
      if (!passes(hit)) return ray;
      last_exit = hit.t;
      inside = false;
    } else {
      Hit hit = intersector_->closest(line, from_distance(last_entry), reach, Wanted::kEntry);
      if (stops_at_boundary && hit.found && !hit.on_surface()) {
        const Hit surface = intersector_->closest(line, hit.t, std::min(reach, hit.t + line.slack),
                                                  Wanted::kSurfaceOnly);
        if (surface.found) hit = surface;
      }
      if (!hit.found) return ray;
      t = std::max(t, hit.t);
      if (hit.on_surface()) {
        ray.at = surface_interaction(line, hit, false);
        ray.end = RayResult::End::kSurface;
        return ray;
      }
      ray.entered = true;
      if (!passes(hit)) return ray;
      last_entry = hit.t;
      inside = true;
    }
  }
  ray.end = RayResult::End::kLeaked;
  return ray;
}

bool Geometry::may_contain(Vec3f p) const {
  const float margin = 16 * FLT_EPSILON * extent_;
  const auto within = [&](float v, float low, float high) {
    return v >= low - margin && v <= high + margin;
  };
  return within(p.x, bounds_.min.x, bounds_.max.x) && within(p.y, bounds_.min.y, bounds_.max.y) &&
         within(p.z, bounds_.min.z, bounds_.max.z);
}

// The point is put into the plane of its triangle, so that a level floor stays level.
Interaction Geometry::surface_interaction(const Line& line, const Hit& hit, bool inside) const {
  const SurfaceTriangle on = hit.surface;
  const Mesh& mesh = surfaces_[on.surface];
  const auto normal = static_cast<Vec3d>(surface_normals_[on.surface][on.triangle]);
  const auto corner = static_cast<Vec3d>(mesh.vertices[mesh.triangles[on.triangle][0]]);
  const Vec3d p =
      static_cast<Vec3d>(line.origin) + static_cast<Vec3d>(line.direction) * double{hit.t};
  return {static_cast<Vec3f>(p - normal * dot(p - corner, normal)), inside, on};
}

Vec3f Geometry::facing_normal(SurfaceTriangle at, Vec3f direction) const {
  const Vec3f normal = surface_normals_[at.surface][at.triangle];
  return dot(normal, direction) < 0 ? normal : -normal;
}

}  // namespace itn::tracer
