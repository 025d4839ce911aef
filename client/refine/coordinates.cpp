#include "client/refine/coordinates.h"

#include <algorithm>
#include <cmath>

#include "common/learning/parameterization.h"

namespace itn {
namespace {

constexpr OpenInterval kG{-kMaxAbsG, kMaxAbsG};
constexpr double kFarthest = 9;  // of logits: 1e-4 from the ends

constexpr Eigen::Index kOfMaterial = 3;

MaterialCoordinates material_part(const Vector& coordinates) {
  return {coordinates[0], coordinates[1], coordinates[2]};
}

Eigen::Index index_of(size_t unknown) {
  return kOfMaterial + static_cast<Eigen::Index>(unknown);
}

}  // namespace

std::vector<Eigen::Index> Layout::of_colour(size_t colour, Eigen::Index size) const {
  const auto first = 2 * static_cast<Eigen::Index>(colour);
  std::vector<Eigen::Index> result{first, first + 1};
  for (Eigen::Index i = g(); i < size; ++i) result.push_back(i);
  return result;
}

Vector coordinates_of(const Material& material, Unknowns unknowns) {
  const MaterialCoordinates triple = to_coordinates(v1::UNBOUNDED, material, kG);
  Vector coordinates(index_of(unknowns.size()));
  coordinates.head(kOfMaterial) = Eigen::Map<const Eigen::Vector3d>(triple.data());
  for (size_t i = 0; i < unknowns.size(); ++i) {
    coordinates[index_of(i)] = unknowns[i].range.to(unknowns[i].start);
  }
  clamp_to_domain(coordinates, {.colours = 1, .unknowns = {unknowns.begin(), unknowns.end()}});
  return coordinates;
}

Material material_at(const Vector& coordinates) {
  return from_coordinates(v1::UNBOUNDED, material_part(coordinates), kG);
}

double unknown_at(const Vector& coordinates, Unknowns unknowns, size_t which) {
  return unknowns[which].range.from(coordinates[index_of(which)]);
}

std::vector<double> unknowns_at(const Vector& coordinates, Unknowns unknowns) {
  std::vector<double> values;
  for (size_t i = 0; i < unknowns.size(); ++i)
    values.push_back(unknown_at(coordinates, unknowns, i));
  return values;
}

bool has_exposure(const Vector& coordinates, Unknowns unknowns) {
  return coordinates.size() > index_of(unknowns.size());
}

double exposure_at(const Vector& coordinates, Unknowns unknowns) {
  return has_exposure(coordinates, unknowns) ? std::exp(coordinates[index_of(unknowns.size())]) : 1;
}

Linearization linearize(const Vector& coordinates, Unknowns unknowns) {
  const Jacobian j = jacobian(v1::UNBOUNDED, material_part(coordinates), kG);
  const Eigen::Index n = index_of(unknowns.size());
  Linearization at{.jacobian = Matrix::Zero(n, n),
                   .exposure = exposure_at(coordinates, unknowns),
                   .exposure_is_coordinate = has_exposure(coordinates, unknowns)};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t c = 0; c < 3; ++c) at.jacobian(i, c) = j[i][c];
  }
  for (size_t i = 0; i < unknowns.size(); ++i) {
    const double value = unknown_at(coordinates, unknowns, i);
    at.jacobian(index_of(i), index_of(i)) = unknowns[i].range.slope(value);
  }
  return at;
}

void clamp_to_domain(Vector& x, const Layout& layout) {
  for (Eigen::Index i = 0; i < layout.exposure(); ++i) {
    const bool is_log = i < layout.g() && i % 2 == 0;
    x[i] = is_log ? std::clamp(x[i], std::log(kMinRefinedSigmaT), std::log(kMaxRefinedSigmaT))
                  : std::clamp(x[i], -kFarthest, kFarthest);
  }
}

Matrix physical_jacobian(const Vector& coordinates, Unknowns unknowns) {
  const Linearization at = linearize(coordinates, unknowns);
  Matrix result = Matrix::Identity(coordinates.size(), coordinates.size());
  result.topLeftCorner(at.jacobian.rows(), at.jacobian.cols()) = at.jacobian;
  result.row(0) /= material_at(coordinates).sigma_t;
  return result;
}

}  // namespace itn
