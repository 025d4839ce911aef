#include "client/refine/coordinates.h"

#include <algorithm>
#include <cmath>

#include "common/learning/parameterization.h"

namespace itn {
namespace {

constexpr OpenInterval kG{-kMaxAbsG, kMaxAbsG};
constexpr double kFarthest = 9;  // of logits: 1e-4 from the ends

Triple material_part(std::span<const double> coordinates) {
  return {coordinates[0], coordinates[1], coordinates[2]};
}

}  // namespace

std::vector<double> coordinates_of(const Material& material) {
  const Triple triple = to_coordinates(v1::UNBOUNDED, material, kG);
  std::vector<double> coordinates(triple.begin(), triple.end());
  keep_inside(coordinates);
  return coordinates;
}

Material material_at(std::span<const double> coordinates) {
  return from_coordinates(v1::UNBOUNDED, material_part(coordinates), kG);
}

double exposure_at(std::span<const double> coordinates) {
  return coordinates.size() > 3 ? std::exp(coordinates[3]) : 1;
}

Viewpoint viewpoint_at(std::span<const double> coordinates) {
  const Jacobian j = jacobian(v1::UNBOUNDED, material_part(coordinates), kG);
  Viewpoint at{.jacobian = SmallMatrix(3),
               .exposure = exposure_at(coordinates),
               .exposure_is_coordinate = coordinates.size() > 3};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t c = 0; c < 3; ++c) at.jacobian(i, c) = j[i][c];
  }
  return at;
}

void keep_inside(std::vector<double>& x) {
  x[0] = std::clamp(x[0], std::log(kLeastSigmaT), std::log(kMostSigmaT));
  x[1] = std::clamp(x[1], -kFarthest, kFarthest);
  x[2] = std::clamp(x[2], -kFarthest, kFarthest);
}

SmallMatrix readable_jacobian(std::span<const double> coordinates) {
  const Viewpoint at = viewpoint_at(coordinates);
  SmallMatrix result(coordinates.size());
  for (size_t c = 0; c < 3; ++c) {
    result(0, c) = at.jacobian(0, c) / material_at(coordinates).sigma_t;
    result(1, c) = at.jacobian(1, c);
    result(2, c) = at.jacobian(2, c);
  }
  if (coordinates.size() > 3) result(3, 3) = 1;
  return result;
}

}  // namespace itn
