// The derivatives of boundaries.
#pragma once

#include <cstddef>

namespace itn::tracer {

constexpr size_t kMaxBoundarySlots = 2;

// Derivatives that are computed only if they are asked for. With them, some paths follow edges
// (BoundaryEdge).
struct BoundaryDerivatives {
  bool index = false, normal = false;
  bool any() const { return index || normal; }
};

}  // namespace itn::tracer
