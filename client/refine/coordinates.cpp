#include "client/refine/coordinates.h"

#include <algorithm>
#include <cmath>

#include "common/learning/parameterization.h"

namespace itn {
namespace {

constexpr OpenInterval kG{-kMaxAbsG, kMaxAbsG};
constexpr double kFarthest = 9;  // of logits: 1e-4 from the ends

MaterialCoordinates material_part(const Vector& coordinates) {
  return {coordinates[0], coordinates[1], coordinates[2]};
}

}  // namespace

Vector coordinates_of(const Material& material) {
  const MaterialCoordinates triple = to_coordinates(v1::UNBOUNDED, material, kG);
  Vector coordinates = Eigen::Map<const Eigen::Vector3d>(triple.data());
  clamp_to_domain(coordinates);
  return coordinates;
}

Material material_at(const Vector& coordinates) {
  return from_coordinates(v1::UNBOUNDED, material_part(coordinates), kG);
}

double exposure_at(const Vector& coordinates) {
  return coordinates.size() > 3 ? std::exp(coordinates[3]) : 1;
}

Linearization linearize(const Vector& coordinates) {
  const Jacobian j = jacobian(v1::UNBOUNDED, material_part(coordinates), kG);
  Linearization at{.jacobian = Matrix(3, 3),
                   .exposure = exposure_at(coordinates),
                   .exposure_is_coordinate = coordinates.size() > 3};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t c = 0; c < 3; ++c) at.jacobian(i, c) = j[i][c];
  }
  return at;
}

void clamp_to_domain(Vector& x) {
  x[0] = std::clamp(x[0], std::log(kMinRefinedSigmaT), std::log(kMaxRefinedSigmaT));
  x[1] = std::clamp(x[1], -kFarthest, kFarthest);
  x[2] = std::clamp(x[2], -kFarthest, kFarthest);
}

Matrix physical_jacobian(const Vector& coordinates) {
  const Linearization at = linearize(coordinates);
  Matrix result = Matrix::Zero(coordinates.size(), coordinates.size());
  result.topLeftCorner(3, 3) = at.jacobian;
  result.topLeftCorner(1, 3) /= material_at(coordinates).sigma_t;
  if (coordinates.size() > 3) result(3, 3) = 1;
  return result;
}

}  // namespace itn
