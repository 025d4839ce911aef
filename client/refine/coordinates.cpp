#include "client/refine/coordinates.h"

#include <algorithm>
#include <cmath>

#include "common/learning/parameterization.h"

namespace itn {
namespace {

constexpr OpenInterval kG{-kMaxAbsG, kMaxAbsG};
constexpr double kFarthest = 9;  // of logits: 1e-4 from the ends

// Known to be about 1 at most.
constexpr double kFarthestDisturbance = 6;

MaterialCoordinates material_part(const Vector& coordinates) {
  return {coordinates[0], coordinates[1], coordinates[2]};
}

}  // namespace

std::vector<Eigen::Index> Layout::of_colour(size_t colour) const {
  const auto first = 2 * static_cast<Eigen::Index>(colour);
  std::vector<Eigen::Index> result{first, first + 1, g(colour)};
  for (Eigen::Index i = unknown(0); i < size(); ++i) result.push_back(i);
  return result;
}

std::vector<Eigen::Index> Layout::all_g() const {
  std::vector<Eigen::Index> result;
  for (Eigen::Index i = g(0); i < unknown(0); ++i) result.push_back(i);
  return result;
}

Layout Layout::one_colour() const {
  Layout one = *this;
  one.colours = 1;
  return one;
}

Vector coordinates_of(const Material& material, const Layout& layout) {
  const MaterialCoordinates triple = to_coordinates(v1::UNBOUNDED, material, kG);
  Vector coordinates = Vector::Zero(layout.size());
  coordinates.head(3) = Eigen::Map<const Eigen::Vector3d>(triple.data());
  for (size_t i = 0; i < layout.unknowns.size(); ++i) {
    coordinates[layout.unknown(i)] = layout.unknowns[i].range.to(layout.unknowns[i].start);
  }
  clamp_to_domain(coordinates, layout);
  return coordinates;
}

Material material_at(const Vector& coordinates) {
  return from_coordinates(v1::UNBOUNDED, material_part(coordinates), kG);
}

double unknown_at(const Vector& coordinates, const Layout& layout, size_t which) {
  return layout.unknowns[which].range.from(coordinates[layout.unknown(which)]);
}

std::vector<double> unknowns_at(const Vector& coordinates, const Layout& layout) {
  std::vector<double> values;
  for (size_t i = 0; i < layout.unknowns.size(); ++i)
    values.push_back(unknown_at(coordinates, layout, i));
  return values;
}

double exposure_at(const Vector& coordinates, const Layout& layout) {
  return layout.has_exposure ? std::exp(coordinates[layout.exposure()]) : 1;
}

Linearization linearize(const Vector& coordinates, const Layout& layout) {
  const Jacobian j = jacobian(v1::UNBOUNDED, material_part(coordinates), kG);
  const Eigen::Index n = layout.exposure();
  Linearization linearization{.jacobian = Matrix::Zero(n, n),
                              .exposure = exposure_at(coordinates, layout),
                              .exposure_is_coordinate = layout.has_exposure,
                              .disturbances = {}};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t c = 0; c < 3; ++c) linearization.jacobian(i, c) = j[i][c];
  }
  for (size_t i = 0; i < layout.unknowns.size(); ++i) {
    const double value = unknown_at(coordinates, layout, i);
    linearization.jacobian(layout.unknown(i), layout.unknown(i)) =
        layout.unknowns[i].range.slope(value);
  }
  for (size_t i = 0; i < layout.disturbances; ++i) {
    linearization.disturbances.push_back(coordinates[layout.disturbance(i)]);
  }
  return linearization;
}

Matrix physical_jacobian(const Vector& coordinates, const Layout& layout) {
  const Linearization at = linearize(coordinates, layout);
  Matrix result = Matrix::Identity(coordinates.size(), coordinates.size());
  result.topLeftCorner(at.jacobian.rows(), at.jacobian.cols()) = at.jacobian;
  result.row(0) /= material_at(coordinates).sigma_t;
  return result;
}

void clamp_to_domain(Vector& x, const Layout& layout) {
  for (Eigen::Index i = 0; i < layout.exposure(); ++i) {
    const bool is_log = i < layout.g(0) && i % 2 == 0;
    x[i] = is_log ? std::clamp(x[i], std::log(kMinRefinedSigmaT), std::log(kMaxRefinedSigmaT))
                  : std::clamp(x[i], -kFarthest, kFarthest);
  }
  for (size_t i = 0; i < layout.disturbances; ++i) {
    double& place = x[layout.disturbance(i)];
    place = std::clamp(place, -kFarthestDisturbance, kFarthestDisturbance);
  }
}

}  // namespace itn
