#include "server/tracer/reference/geometry.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

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

Travel Geometry::travel(const Place& from, Vec3f direction, float budget,
                        const BoundaryModel* model) const {
  const Line line(from.position, direction, from.on, extent_);
  Travel travel;
  bool inside = from.inside;
  travel.entered = inside;
  float t = line.start;
  float last_exit = 0, last_entry = 0;  // distances; crossings of a kind lie beyond the last one
  const auto from_distance = [&](float last) {
    return std::max(t - line.slack, std::nextafter(last, kInfinity));
  };
  // Asks the model about a crossing at t; whether the line goes on.
  const auto passes = [&](const Hit& hit) {
    if (model == nullptr) {
      return true;
    }
    const auto [point, normal] = intersector_->crossing(hit);
    const BoundaryInteraction at{.point = point,
                                 .normal = normal,
                                 .direction = line.direction,
                                 .triangle = hit.triangle,
                                 .leaving = inside};
    if (model->straight()) {
      travel.transmittance *= model->transmittance(at);
      return true;
    }
    travel.place = {at.point, inside, {}};
    travel.crossing = at;
    travel.end = Travel::End::kCrossing;
    return false;
  };
  for (int crossings = 0; crossings < kMaxCrossings; ++crossings) {
    if (inside) {
      const float end = t + (budget - travel.in_medium);
      const Hit hit = intersector_->closest(line, from_distance(last_exit), end, Wanted::kExit);
      if (!hit.found) {
        travel.in_medium = budget;
        travel.place = {line.at(end), true, {}};
        travel.end =
            may_contain(travel.place.position) ? Travel::End::kSpent : Travel::End::kLeaked;
        return travel;
      }
      const float exit = std::max(t, hit.t);
      travel.in_medium += exit - t;
      t = exit;
      if (hit.on_surface()) {
        travel.place = surface_place(line, hit, true);
        travel.end = Travel::End::kSurface;
        return travel;
      }
      if (!passes(hit)) {
        return travel;
      }
      last_exit = hit.t;
      inside = false;
    } else {
      const Hit hit =
          intersector_->closest(line, from_distance(last_entry), kInfinity, Wanted::kEntry);
      if (!hit.found) {
        travel.end = Travel::End::kEscaped;
        return travel;
      }
      t = std::max(t, hit.t);
      if (hit.on_surface()) {
        travel.place = surface_place(line, hit, false);
        travel.end = Travel::End::kSurface;
        return travel;
      }
      travel.entered = true;
      if (!passes(hit)) {
        return travel;
      }
      last_entry = hit.t;
      inside = true;
    }
  }
  travel.end = Travel::End::kLeaked;
  return travel;
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
Place Geometry::surface_place(const Line& line, const Hit& hit, bool inside) const {
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
