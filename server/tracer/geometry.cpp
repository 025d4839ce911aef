#include "server/tracer/geometry.h"

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <stdexcept>

namespace itn::tracer {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr uint32_t kObject = 0;  // Embree's number of the object; surface i has number i + 1

// More crossings than this on one line mean that rounding has trapped it.
constexpr int kMaxCrossings = 100000;

float max_abs(Vec3f v) {
  return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

// Which hits a query looks for, besides surfaces.
enum class Wanted { kExit, kEntry, kSurfaceOnly };

}  // namespace

// A line in the form that it is queried in: its origin is moved back a little, so that distances
// are positive even where rule 3 looks behind the start.
struct Geometry::Line {
  Vec3f origin, direction;
  float start;  // distance from `origin` at which the line starts
  float slack;
  SurfaceTriangle excluded;

  Line(Vec3f position, Vec3f unit, SurfaceTriangle on, float extent)
      : direction(unit),
        slack(4 * FLT_EPSILON * std::max(extent, max_abs(position))),
        excluded(on) {
    start = 2 * slack;
    origin = position - unit * start;
  }
  Vec3f at(float t) const { return origin + direction * t; }
};

struct Geometry::Hit {
  float t = kInfinity;
  uint32_t geometry = RTC_INVALID_GEOMETRY_ID;
  uint32_t triangle = RTC_INVALID_GEOMETRY_ID;

  explicit operator bool() const { return geometry != RTC_INVALID_GEOMETRY_ID; }
  bool on_surface() const { return geometry != kObject; }
};

// The ray queries, by Embree 3 or 4, which differ in how a filter is passed.
class Geometry::Embree {
 public:
  Embree(const Mesh& object, const std::vector<Mesh>& surfaces)
      : device_(rtcNewDevice(nullptr)), scene_(rtcNewScene(device_)) {
    rtcSetSceneBuildQuality(scene_, RTC_BUILD_QUALITY_HIGH);
#if RTC_VERSION_MAJOR >= 4
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS);
#else
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION);
#endif
    attach(object, kObject);
    for (size_t i = 0; i < surfaces.size(); ++i) {
      attach(surfaces[i], static_cast<uint32_t>(i) + 1);
    }
    rtcCommitScene(scene_);
    if (rtcGetDeviceError(device_) != RTC_ERROR_NONE) {
      throw std::runtime_error("Embree could not build the scene (out of memory?)");
    }
  }
  ~Embree() {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }
  Embree(const Embree&) = delete;
  Embree& operator=(const Embree&) = delete;

  // The closest wanted hit at a distance in [t_min, t_max].
  Hit closest(const Line& line, float t_min, float t_max, Wanted wanted) const {
    RTCRayHit query{};
    query.ray.org_x = line.origin.x;
    query.ray.org_y = line.origin.y;
    query.ray.org_z = line.origin.z;
    query.ray.dir_x = line.direction.x;
    query.ray.dir_y = line.direction.y;
    query.ray.dir_z = line.direction.z;
    query.ray.tnear = std::max(0.0F, t_min);
    query.ray.tfar = t_max;
    query.ray.mask = ~0U;
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    Context context;
    context.wanted = wanted;
    context.excluded = line.excluded;
#if RTC_VERSION_MAJOR >= 4
    rtcInitRayQueryContext(&context);
    RTCIntersectArguments arguments;
    rtcInitIntersectArguments(&arguments);
    arguments.context = &context;
    arguments.filter = filter;
    arguments.flags = RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER;
    rtcIntersect1(scene_, &query, &arguments);
#else
    rtcInitIntersectContext(&context);
    context.filter = filter;
    rtcIntersect1(scene_, &context, &query);
#endif
    return {query.ray.tfar, query.hit.geomID, query.hit.primID};
  }

 private:
#if RTC_VERSION_MAJOR >= 4
  using BaseContext = RTCRayQueryContext;
#else
  using BaseContext = RTCIntersectContext;
#endif
  struct Context : BaseContext {
    Wanted wanted;
    SurfaceTriangle excluded;
  };

  // Rule 1: rejects crossings of the boundary in the wrong direction, and the triangle the line
  // starts on. Embree's Ng is the normal of counter-clockwise triangles.
  static void filter(const RTCFilterFunctionNArguments* arguments) {
    const auto& context = *static_cast<const Context*>(arguments->context);
    const auto& ray = *reinterpret_cast<const RTCRay*>(arguments->ray);
    const auto& hit = *reinterpret_cast<const RTCHit*>(arguments->hit);
    const float cosine = hit.Ng_x * ray.dir_x + hit.Ng_y * ray.dir_y + hit.Ng_z * ray.dir_z;
    bool accepted = false;
    if (hit.geomID == kObject) {
      accepted = (context.wanted == Wanted::kExit && cosine > 0) ||
                 (context.wanted == Wanted::kEntry && cosine < 0);
    } else {
      accepted =
          hit.geomID - 1 != context.excluded.surface || hit.primID != context.excluded.triangle;
    }
    if (!accepted) {
      arguments->valid[0] = 0;
    }
  }

  void attach(const Mesh& mesh, uint32_t number) {
    RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<Vec3f*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                sizeof(Vec3f), std::max<size_t>(1, mesh.vertices.size())));
    auto* triangles = static_cast<std::array<uint32_t, 3>*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof(std::array<uint32_t, 3>),
        std::max<size_t>(1, mesh.triangles.size())));
    if (vertices == nullptr || triangles == nullptr) {
      throw std::bad_alloc();
    }
    std::copy(mesh.vertices.begin(), mesh.vertices.end(), vertices);
    std::copy(mesh.triangles.begin(), mesh.triangles.end(), triangles);
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(scene_, geometry, number);
    rtcReleaseGeometry(geometry);
  }

  RTCDevice device_;
  RTCScene scene_;
};

Geometry::Geometry(Mesh object, const std::vector<DiffuseSurface>& surfaces)
    : object_(std::move(object)), bounds_(bounds(object_)) {
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
  embree_ = std::make_unique<Embree>(object_, surfaces_);
}

Geometry::~Geometry() = default;

Travel Geometry::travel(const Place& from, Vec3f direction, float budget) const {
  const Line line(from.position, direction, from.on, extent_);
  Travel travel;
  bool inside = from.inside;
  travel.entered = inside;
  float t = line.start;
  float last_exit = 0, last_entry = 0;  // distances; crossings of a kind lie beyond the last one
  const auto from_distance = [&](float last) {
    return std::max(t - line.slack, std::nextafter(last, kInfinity));
  };
  for (int crossings = 0; crossings < kMaxCrossings; ++crossings) {
    if (inside) {
      const float end = t + (budget - travel.in_medium);
      const Hit hit = embree_->closest(line, from_distance(last_exit), end, Wanted::kExit);
      if (!hit) {
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
      last_exit = hit.t;
      inside = false;
    } else {
      const Hit hit = embree_->closest(line, from_distance(last_entry), kInfinity, Wanted::kEntry);
      if (!hit) {
        travel.end = Travel::End::kEscaped;
        return travel;
      }
      t = std::max(t, hit.t);
      if (hit.on_surface()) {
        travel.place = surface_place(line, hit, false);
        travel.end = Travel::End::kSurface;
        return travel;
      }
      last_entry = hit.t;
      inside = true;
      travel.entered = true;
    }
  }
  travel.end = Travel::End::kLeaked;
  return travel;
}

Travel Geometry::travel_to_surface(Vec3f origin, Vec3f direction, float length) const {
  const Line line(origin, direction, {}, extent_);
  Travel travel;
  travel.end = Travel::End::kSpent;
  if (const Hit hit =
          embree_->closest(line, line.start, line.start + length, Wanted::kSurfaceOnly)) {
    travel.place = surface_place(line, hit, false);
    travel.end = Travel::End::kSurface;
  }
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

bool Geometry::contains(Vec3d point) const {
  return winding_number(object_, point) > 0.5;
}

// The point is put into the plane of its triangle, so that a level floor stays level.
Place Geometry::surface_place(const Line& line, const Hit& hit, bool inside) const {
  const SurfaceTriangle on{hit.geometry - 1, hit.triangle};
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

size_t Geometry::memory() const {
  const auto of = [](const Mesh& mesh) {
    return mesh.vertices.size() * sizeof(Vec3f) +
           mesh.triangles.size() * sizeof(std::array<uint32_t, 3>);
  };
  size_t sum = of(object_);
  size_t triangles = object_.triangles.size();
  for (const Mesh& mesh : surfaces_) {
    sum += of(mesh);
    triangles += mesh.triangles.size();
  }
  // Embree keeps a copy and a tree of about 100 bytes a triangle.
  return 2 * sum + 100 * triangles;
}

}  // namespace itn::tracer
