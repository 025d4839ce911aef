#include "client/training/similarity_predictor.h"

#include <algorithm>
#include <cmath>

#include "client/dataset/distribution.h"
#include "common/learning/parameterization.h"

namespace itn {
namespace {

// Values of g over which the mean is taken.
constexpr int kSteps = 1024;

double determinant(const Jacobian& j) {
  return j[0][0] * (j[1][1] * j[2][2] - j[1][2] * j[2][1]) -
         j[0][1] * (j[1][0] * j[2][2] - j[1][2] * j[2][0]) +
         j[0][2] * (j[1][0] * j[2][1] - j[1][1] * j[2][0]);
}

// By sigma_t at this albedo and g, however it is drawn.
double density_of_sigma_t(const v1::MaterialChoice& materials, const Material& material) {
  if (!materials.has_sigma_s_reduced()) return density(materials.sigma_t(), material.sigma_t);
  return density(materials.sigma_s_reduced(), material.sigma_s_reduced()) * material.albedo *
         (1 - material.g);
}

// Similar materials are a curve along g. A step of it weighs what the distributions hold there: in
// reduced coordinates, their density times the volume that the change of coordinates makes.
Material mean_of_similar(const Material& material, const v1::MaterialChoice& materials) {
  const v1::Interval range = range_of(materials.g());
  MaterialCoordinates coordinates = to_coordinates(v1::SIMILARITY, material);
  Material sum{.sigma_t = 0, .albedo = 0, .g = 0};
  double weights = 0;
  for (int i = 0; i < kSteps; ++i) {
    coordinates[2] = range.min() + (range.max() - range.min()) * (i + 0.5) / kSteps;
    const Material similar = from_coordinates(v1::SIMILARITY, coordinates);
    const double weight = density_of_sigma_t(materials, similar) *
                          density(materials.albedo(), similar.albedo) *
                          density(materials.g(), similar.g) *
                          std::abs(determinant(jacobian(v1::SIMILARITY, coordinates)));
    sum.sigma_t += weight * similar.sigma_t;
    sum.albedo += weight * similar.albedo;
    sum.g += weight * similar.g;
    weights += weight;
  }
  if (weights == 0) {  // at a corner of the range: the curve is shorter there than a step
    return material;
  }
  return {sum.sigma_t / weights, sum.albedo / weights, sum.g / weights};
}

}  // namespace

std::optional<std::vector<Material>> similarity_predictions(const LabelledImages& images,
                                                            const v1::MaterialChoice& materials) {
  if (images.channels > 1 || materials.sampling() == v1::MaterialChoice::GRID ||
      is_list(materials.sigma_t()) || is_list(materials.sigma_s_reduced()) ||
      is_list(materials.albedo()) || is_list(materials.g())) {
    return std::nullopt;
  }
  std::vector<Material> predictions;
  for (const Material& truth : images.truth) {
    predictions.push_back(mean_of_similar(truth, materials));
  }
  return predictions;
}

}  // namespace itn
