// Whether the parts of a closed mesh bound one volume together. Internal to geometry.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/cancellation.h"
#include "common/geometry/mesh.h"

namespace itn {

// Disjoint sets of 0 .. n - 1.
class DisjointSets {
 public:
  explicit DisjointSets(size_t n);
  uint32_t find(uint32_t a);
  void join(uint32_t a, uint32_t b) { parent_[find(a)] = find(b); }

 private:
  std::vector<uint32_t> parent_;
};

// `joined` are the triangles that bound the same part, which is closed. Throws Error (invalid
// input) unless every part is outward oriented outside all others or in a cavity, or a cavity of
// one, and no two overlap by more than rounding. Takes n log n, unless the parts come close to one
// another in very many places, which is refused too.
void check_parts(const Mesh& mesh, DisjointSets& joined, const std::string& what,
                 Cancellation& cancellation);

// "(x, y, z)".
std::string describe(Vec3f p);

// 6 times the volume of the tetrahedron between the origin and the triangle.
double volume6(const Mesh& mesh, const std::array<uint32_t, 3>& triangle, Vec3d origin);

}  // namespace itn
