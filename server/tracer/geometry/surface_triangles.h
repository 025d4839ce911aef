// The opaque surfaces of a scene, their triangles numbered through. Internal to the tracer.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "server/tracer/geometry/intersector.h"
#include "server/tracer/surfaces/surface.h"

namespace itn::tracer {

struct Surfaces {
  static constexpr uint32_t kNone = SurfaceTriangle::kNone;
  // Up to this many triangles are tested one after the other against many lines; beyond, Embree
  // looks for them, line by line.
  static constexpr size_t kFew = 64;

  explicit Surfaces(const std::vector<DiffuseSurface>& surfaces);

  // Whether a surface lies between `origin` and `origin` + `length` * `direction`, or, if they are
  // many, a little further.
  bool in_front(Vec3d origin, Vec3d direction, double length) const;

  // The numbers of a surface's triangles: from `first` to the one before `end`.
  struct Range {
    uint32_t first, end;
  };
  Range triangles_of(size_t surface) const {
    const bool last = surface + 1 == first_triangle_of_mesh.size();
    return {first_triangle_of_mesh[surface],
            last ? static_cast<uint32_t>(triangles) : first_triangle_of_mesh[surface + 1]};
  }

  size_t memory() const;
  // At most, without what looks for many.
  static constexpr size_t kBytesByTriangle = 22 * sizeof(float);
  bool empty() const { return triangles == 0; }

  size_t triangles = 0;
  // By triangle; with one unused entry at least, so that there is something to load. The normal has
  // unit length.
  struct Vectors {
    std::vector<float> x, y, z;
    void push_back(Vec3f v) {
      x.push_back(v.x);
      y.push_back(v.y);
      z.push_back(v.z);
    }
    Vec3f at(size_t i) const { return {x[i], y[i], z[i]}; }
  };
  Vectors corners[3], normals;
  // The normals at the corners, where some surfaces are smooth; else empty.
  Vectors corner_normals[3];
  bool smooth() const { return !corner_normals[0].x.empty(); }
  // The reflectance of those that are uniform; the others are patterned.
  std::vector<float> reflectances;
  struct Pattern {
    Range triangles;
    Reflectance reflectance;
    size_t surface;  // its number
  };
  std::vector<Pattern> patterned;
  Bounds bounds{};                               // of all of them
  std::unique_ptr<Intersector> many;             // null for a few
  std::vector<uint32_t> first_triangle_of_mesh;  // the number of a mesh's triangle 0

 private:
  void add_corner_normals(const std::vector<DiffuseSurface>& surfaces);
};

}  // namespace itn::tracer
