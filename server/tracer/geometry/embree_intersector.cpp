#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <algorithm>
#include <stdexcept>

#include "server/tracer/geometry/intersector.h"

namespace itn::tracer {
namespace {

constexpr uint32_t kObject = 0;  // Embree's number of the object; surface i has number i + 1

// Owns an object of Embree's.
template <typename T, void (*release)(T)>
struct Release {
  using pointer = T;
  void operator()(T object) const { release(object); }
};
using Device = std::unique_ptr<RTCDevice, Release<RTCDevice, rtcReleaseDevice>>;
using EmbreeScene = std::unique_ptr<RTCScene, Release<RTCScene, rtcReleaseScene>>;
using EmbreeGeometry = std::unique_ptr<RTCGeometry, Release<RTCGeometry, rtcReleaseGeometry>>;

// The ray queries, by Embree 3 or 4, which differ in how a filter is passed.
class EmbreeIntersector final : public Intersector {
 public:
  EmbreeIntersector(const Mesh& object, const std::vector<Mesh>& surfaces)
      : device_(rtcNewDevice(nullptr)), scene_(device_ ? rtcNewScene(device_.get()) : nullptr) {
    if (!scene_) throw std::runtime_error("Embree could not start");
    rtcSetSceneBuildQuality(scene_.get(), RTC_BUILD_QUALITY_HIGH);
#if RTC_VERSION_MAJOR >= 4
    rtcSetSceneFlags(scene_.get(),
                     RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS);
#else
    rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION);
#endif
    if (!object.triangles.empty()) attach(object, kObject);
    for (size_t i = 0; i < surfaces.size(); ++i) attach(surfaces[i], static_cast<uint32_t>(i) + 1);
    rtcCommitScene(scene_.get());
    if (rtcGetDeviceError(device_.get()) != RTC_ERROR_NONE) {
      throw std::runtime_error("Embree could not build the scene (out of memory?)");
    }
  }

  Hit closest(const Line& line, float t_min, float t_max, Wanted wanted) const override {
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
    rtcIntersect1(scene_.get(), &query, &arguments);
#else
    rtcInitIntersectContext(&context);
    context.filter = filter;
    rtcIntersect1(scene_.get(), &context, &query);
#endif
    Hit hit;
    hit.found = query.hit.geomID != RTC_INVALID_GEOMETRY_ID;
    hit.t = query.ray.tfar;
    if (hit.found && query.hit.geomID != kObject) {
      hit.surface = {query.hit.geomID - 1, query.hit.primID};
    } else if (hit.found) {
      hit.triangle = query.hit.primID;
      hit.v = query.hit.u;
      hit.w = query.hit.v;
    }
    return hit;
  }

  Crossing crossing(const Hit& hit) const override {
    const auto corner = [&](size_t k) {
      return static_cast<Vec3d>(object_vertices_[object_triangles_[hit.triangle][k]]);
    };
    const Vec3d a = corner(0), to_b = corner(1) - a, to_c = corner(2) - a;
    return {static_cast<Vec3f>(a + to_b * double{hit.v} + to_c * double{hit.w}),
            static_cast<Vec3f>(itn::normalize(cross(to_b, to_c)))};
  }

  // A copy of the triangles and a tree, together about 150 bytes a triangle.
  size_t memory() const override {
    return 150 * triangles_;
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
      const bool exits = context.wanted == Wanted::kExit || context.wanted == Wanted::kExitOnly;
      accepted = (exits && cosine > 0) || (context.wanted == Wanted::kEntry && cosine < 0);
    } else if (context.wanted != Wanted::kExitOnly) {
      accepted =
          hit.geomID - 1 != context.excluded.surface || hit.primID != context.excluded.triangle;
    }
    if (!accepted) arguments->valid[0] = 0;
  }

  void attach(const Mesh& mesh, uint32_t number) {
    const EmbreeGeometry geometry(rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
    auto* vertices = static_cast<Vec3f*>(
        rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                sizeof(Vec3f), std::max<size_t>(1, mesh.vertices.size())));
    auto* triangles = static_cast<std::array<uint32_t, 3>*>(rtcSetNewGeometryBuffer(
        geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof(std::array<uint32_t, 3>),
        std::max<size_t>(1, mesh.triangles.size())));
    if (vertices == nullptr || triangles == nullptr) throw std::bad_alloc();
    std::copy(mesh.vertices.begin(), mesh.vertices.end(), vertices);
    std::copy(mesh.triangles.begin(), mesh.triangles.end(), triangles);
    triangles_ += mesh.triangles.size();
    if (number == kObject) {
      object_vertices_ = vertices;
      object_triangles_ = triangles;
    }
    rtcCommitGeometry(geometry.get());
    rtcAttachGeometryByID(scene_.get(), geometry.get(), number);
  }

  Device device_;
  EmbreeScene scene_;
  size_t triangles_ = 0;
  // Embree's copies, of the object.
  const Vec3f* object_vertices_ = nullptr;
  const std::array<uint32_t, 3>* object_triangles_ = nullptr;
};

}  // namespace

std::unique_ptr<Intersector> make_embree_intersector(const Mesh& object,
                                                     const std::vector<Mesh>& surfaces) {
  return std::make_unique<EmbreeIntersector>(object, surfaces);
}

}  // namespace itn::tracer
