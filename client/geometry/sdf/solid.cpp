#include "client/geometry/sdf/solid.h"

namespace itn::sdf {

float Solid::distance(Vec3f p) const {
  Points points;
  for (size_t i = 0; i < kLanes; ++i) points.set(i, p);
  Values distances;
  evaluate(points, distances);
  return distances[0];
}

}  // namespace itn::sdf
