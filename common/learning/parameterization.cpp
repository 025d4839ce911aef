#include "common/learning/parameterization.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "common/error.h"

namespace itn {
namespace {

MaterialCoordinates as_triple(const Material& m) {
  return {m.sigma_t, m.albedo, m.g};
}
Material as_material(const MaterialCoordinates& t) {
  return {t[0], t[1], t[2]};
}

MaterialCoordinates clamp(const MaterialCoordinates& value, const Box& box) {
  MaterialCoordinates result;
  for (size_t i = 0; i < 3; ++i) result[i] = std::clamp(value[i], box.min[i], box.max[i]);
  return result;
}

// Drops what would push a clamped value further out: descent moves along minus the gradient.
MaterialCoordinates clamp_gradient(const MaterialCoordinates& value, const Box& box,
                                   MaterialCoordinates gradient) {
  for (size_t i = 0; i < 3; ++i) {
    const bool outward =
        (value[i] < box.min[i] && gradient[i] > 0) || (value[i] > box.max[i] && gradient[i] < 0);
    if (outward) gradient[i] = 0;
  }
  return gradient;
}

// The smallest box of coordinates around a box of materials. Every coordinate is monotone in each
// of sigma_t, albedo and g while the others are held, so the corners bound it.
Box coordinate_box(v1::Parameterization parameterization, const Box& materials,
                   const OpenInterval& g) {
  Box box;
  box.min.fill(HUGE_VAL);
  box.max.fill(-HUGE_VAL);
  for (unsigned corner = 0; corner < 8; ++corner) {
    MaterialCoordinates at;
    for (size_t i = 0; i < 3; ++i) {
      at[i] = (corner >> i & 1U) != 0 ? materials.max[i] : materials.min[i];
    }
    const MaterialCoordinates c = to_coordinates(parameterization, as_material(at), g);
    for (size_t i = 0; i < 3; ++i) {
      box.min[i] = std::min(box.min[i], c[i]);
      box.max[i] = std::max(box.max[i], c[i]);
    }
  }
  return box;
}

void require_count(const char* what, int count, size_t wanted) {
  if (static_cast<size_t>(count) != wanted) {
    throw invalid_input(
        fmt::format("model.{} has {} numbers; it must have {}", what, count, wanted));
  }
}

}  // namespace

// SIMILARITY. Two media look nearly the same deep inside when sigma_a and sigma_s (1 - g) agree
// (the similarity relation, Wyman et al. 1989). Of all of these media take the one with g* = 0:
//   sigma_a* = sigma_a = sigma_t (1 - albedo)
//   sigma_s* = sigma_s (1 - g) = sigma_t albedo (1 - g)
// so that
//   sigma_t* = sigma_a* + sigma_s* = sigma_t (1 - albedo g)
//   albedo*  = sigma_s* / sigma_t* = albedo (1 - g) / (1 - albedo g).
// An image tells (sigma_t*, albedo*) well and g badly; in these coordinates the three are apart.
namespace {

MaterialCoordinates to_similarity(const Material& m) {
  const double reduction = 1 - m.albedo * m.g;
  return {m.sigma_t * reduction, m.albedo * (1 - m.g) / reduction, m.g};
}

// With q = 1 - g and D = 1 - g (1 - albedo*):
//   sigma_t = sigma_a + sigma_s = sigma_t* (1 - albedo*) + sigma_t* albedo* / q = sigma_t* D / q
//   albedo  = sigma_s / sigma_t = albedo* / D.
Material from_similarity(const MaterialCoordinates& c) {
  const auto [reduced_sigma_t, reduced_albedo, g] = c;
  const double q = 1 - g;
  const double d = 1 - g * (1 - reduced_albedo);
  return {reduced_sigma_t * d / q, reduced_albedo / d, g};
}

// By dD/d albedo* = g, dD/dg = -(1 - albedo*), dq/dg = -1, and
// d(D/q)/dg = (-(1 - albedo*) q + D) / q^2 = albedo* / q^2.
Jacobian similarity_jacobian(const MaterialCoordinates& c) {
  const auto [reduced_sigma_t, reduced_albedo, g] = c;
  const double q = 1 - g;
  const double d = 1 - g * (1 - reduced_albedo);
  return {{{d / q, reduced_sigma_t * g / q, reduced_sigma_t * reduced_albedo / (q * q)},
           {0, q / (d * d), reduced_albedo * (1 - reduced_albedo) / (d * d)},
           {0, 0, 1}}};
}

// UNBOUNDED. The ends of (0, 1) are infinitely far away; what is nearer to them than this is not.
constexpr double kNearest = 1e-4;

double logit(double u) {
  const double inside = std::clamp(u, kNearest, 1 - kNearest);
  return std::log(inside / (1 - inside));
}
double logistic(double x) {
  return 1 / (1 + std::exp(-x));
}

MaterialCoordinates similarity_of_unbounded(const MaterialCoordinates& c, const OpenInterval& g) {
  return {std::exp(c[0]), logistic(c[1]), g.min + (g.max - g.min) * logistic(c[2])};
}

}  // namespace

MaterialCoordinates to_coordinates(v1::Parameterization parameterization, const Material& m,
                                   const OpenInterval& g) {
  if (parameterization == v1::NAIVE) return as_triple(m);
  const MaterialCoordinates c = to_similarity(m);
  if (parameterization == v1::SIMILARITY) return c;
  return {std::log(c[0]), logit(c[1]), logit((c[2] - g.min) / (g.max - g.min))};
}

Material from_coordinates(v1::Parameterization parameterization, const MaterialCoordinates& c,
                          const OpenInterval& g) {
  switch (parameterization) {
    case v1::NAIVE: return as_material(c);
    case v1::SIMILARITY: return from_similarity(c);
    default: return from_similarity(similarity_of_unbounded(c, g));
  }
}

Jacobian jacobian(v1::Parameterization parameterization, const MaterialCoordinates& c,
                  const OpenInterval& g) {
  if (parameterization == v1::NAIVE) return {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  if (parameterization == v1::SIMILARITY) return similarity_jacobian(c);
  // By the chain rule; the derivative of the logistic function p is p (1 - p).
  const MaterialCoordinates s = similarity_of_unbounded(c, g);
  const double u = logistic(c[2]);
  const MaterialCoordinates inner{s[0], s[1] * (1 - s[1]), (g.max - g.min) * u * (1 - u)};
  Jacobian j = similarity_jacobian(s);
  for (MaterialCoordinates& row : j) {
    for (size_t k = 0; k < 3; ++k) row[k] *= inner[k];
  }
  return j;
}

OpenInterval g_interval(const v1::MaterialRange& bounds) {
  return {bounds.g().min(), bounds.g().max()};
}

Box to_box(const v1::MaterialRange& range) {
  return {{range.sigma_t().min(), range.albedo().min(), range.g().min()},
          {range.sigma_t().max(), range.albedo().max(), range.g().max()}};
}

namespace {

// The bounds lie so far beyond the training range that the paper's ranges (30 to 276, 0.39 to 0.95,
// 0 to 0.8) become the paper's clamps.
constexpr double kSigmaTBelow = 20.0 / 30.0, kSigmaTAbove = 300.0 / 276.0;
constexpr double kAlbedoBelow = 0.04, kAlbedoAbove = 0.02, kG = 0.1;
constexpr double kMinAlbedo = 0.001, kMaxAlbedo = 0.999;

}  // namespace

v1::MaterialRange training_range(const v1::MaterialRange& bounds) {
  v1::MaterialRange range;
  range.mutable_sigma_t()->set_min(bounds.sigma_t().min() / kSigmaTBelow);
  range.mutable_sigma_t()->set_max(bounds.sigma_t().max() / kSigmaTAbove);
  range.mutable_albedo()->set_min(bounds.albedo().min() + kAlbedoBelow);
  const double max_albedo = bounds.albedo().max();
  range.mutable_albedo()->set_max(max_albedo > kMaxAlbedo ? max_albedo : max_albedo - kAlbedoAbove);
  range.mutable_g()->set_min(bounds.g().min() + kG);
  range.mutable_g()->set_max(bounds.g().max() - kG);
  return range;
}

v1::MaterialRange prediction_bounds(const v1::MaterialRange& training_range) {
  // At an albedo of 1 paths do not end by absorption, so that bounds end before it unless the
  // training does not; at 0 there is no derivative in g.
  v1::MaterialRange bounds;
  const auto set = [](v1::Interval* interval, double min, double max) {
    interval->set_min(min);
    interval->set_max(max);
  };
  const v1::MaterialRange& r = training_range;
  set(bounds.mutable_sigma_t(), std::max(r.sigma_t().min() * kSigmaTBelow, kMinSigmaT),
      std::min(r.sigma_t().max() * kSigmaTAbove, kMaxSigmaT));
  set(bounds.mutable_albedo(), std::max(r.albedo().min() - kAlbedoBelow, kMinAlbedo),
      std::max(r.albedo().max(), std::min(r.albedo().max() + kAlbedoAbove, kMaxAlbedo)));
  set(bounds.mutable_g(), std::max(r.g().min() - kG, -kMaxAbsG),
      std::min(r.g().max() + kG, kMaxAbsG));
  return bounds;
}

size_t channels_of(const v1::Model& model) {
  if (model.channels() > 1 && model.channels() != 3) {
    throw invalid_input(fmt::format("model.channels is {}; it must be 1 or 3", model.channels()));
  }
  return std::max<size_t>(1, model.channels());
}

namespace {

// Where the coordinates of a channel are among those of all.
std::array<size_t, 3> places_of(size_t channel, size_t channels) {
  return {channel, channels + channel, 2 * channels};
}

}  // namespace

OutputSpace::OutputSpace(const v1::Model& model, size_t channel)
    : parameterization_(model.parameterization()),
      g_(g_interval(model.bounds())),
      material_box_(to_box(model.bounds())) {
  if (parameterization_ != v1::NAIVE && parameterization_ != v1::SIMILARITY &&
      parameterization_ != v1::UNBOUNDED) {
    throw invalid_input("model.parameterization must be NAIVE, SIMILARITY or UNBOUNDED");
  }
  if (model.output() == v1::GAUSSIAN && parameterization_ != v1::UNBOUNDED) {
    throw invalid_input("model.parameterization must be UNBOUNDED for the output GAUSSIAN");
  }
  if (parameterization_ == v1::UNBOUNDED && !(g_.min < g_.max)) {
    throw invalid_input("model.bounds: g must have an interval that is not empty");
  }
  const size_t channels = channels_of(model);
  if (channels > 1 && parameterization_ != v1::UNBOUNDED) {
    throw invalid_input("model.parameterization must be UNBOUNDED in colour");
  }
  require_count("mean", model.mean_size(), coordinate_count(channels));
  require_count("standard_deviation", model.standard_deviation_size(), coordinate_count(channels));
  for (size_t i = 0; i < 3; ++i) {
    const auto place = static_cast<int>(places_of(channel, channels).at(i));
    mean_[i] = model.mean(place);
    standard_deviation_[i] = model.standard_deviation(place);
    if (!std::isfinite(mean_[i]) || !(standard_deviation_[i] > 0) ||
        !std::isfinite(standard_deviation_[i])) {
      throw invalid_input("model.mean must be finite and model.standard_deviation positive");
    }
    if (!(material_box_.min[i] <= material_box_.max[i])) {
      throw invalid_input("model.bounds: min must not exceed max");
    }
  }
  validate(as_material(material_box_.min));
  validate(as_material(material_box_.max));
  coordinate_box_ = coordinate_box(parameterization_, material_box_, g_);
}

MaterialCoordinates OutputSpace::standardized(const Material& material) const {
  MaterialCoordinates c = to_coordinates(parameterization_, material, g_);
  for (size_t i = 0; i < 3; ++i) c[i] = (c[i] - mean_[i]) / standard_deviation_[i];
  return c;
}

MaterialCoordinates OutputSpace::coordinates(const MaterialCoordinates& output) const {
  MaterialCoordinates c;
  for (size_t i = 0; i < 3; ++i) {
    if (!std::isfinite(output[i])) throw invalid_input("the network's prediction is not finite");
    c[i] = mean_[i] + standard_deviation_[i] * output[i];
  }
  return c;
}

Material OutputSpace::material(const MaterialCoordinates& output) const {
  const MaterialCoordinates inside = clamp(coordinates(output), coordinate_box_);
  return as_material(
      clamp(as_triple(from_coordinates(parameterization_, inside, g_)), material_box_));
}

MaterialCoordinates OutputSpace::output_gradient(
    const MaterialCoordinates& output, const MaterialCoordinates& material_gradient) const {
  const MaterialCoordinates raw = coordinates(output);
  const MaterialCoordinates inside = clamp(raw, coordinate_box_);
  const MaterialCoordinates by_material = clamp_gradient(
      as_triple(from_coordinates(parameterization_, inside, g_)), material_box_, material_gradient);
  const Jacobian j = jacobian(parameterization_, inside, g_);
  MaterialCoordinates by_coordinate{};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t k = 0; k < 3; ++k) by_coordinate[i] += j[k][i] * by_material[k];
  }
  MaterialCoordinates gradient = clamp_gradient(raw, coordinate_box_, by_coordinate);
  for (size_t i = 0; i < 3; ++i) gradient[i] *= standard_deviation_[i];
  return gradient;
}

AnswerSpace::AnswerSpace(const v1::Model& model) {
  for (size_t channel = 0; channel < channels_of(model); ++channel) {
    channels_.emplace_back(model, channel);
  }
}

MaterialCoordinates AnswerSpace::of_channel(size_t channel, std::span<const double> all) const {
  const auto [first, second, third] = places_of(channel, channels());
  return {all[first], all[second], all[third]};
}

std::vector<double> AnswerSpace::standardized(std::span<const Material> materials) const {
  std::vector<double> all(size());
  for (size_t channel = 0; channel < channels(); ++channel) {
    const MaterialCoordinates one = channels_[channel].standardized(materials[channel]);
    const std::array<size_t, 3> places = places_of(channel, channels());
    for (size_t i = 0; i < 3; ++i) all[places[i]] = one[i];
  }
  return all;
}

std::vector<Material> AnswerSpace::materials(std::span<const double> output) const {
  std::vector<Material> materials;
  for (size_t channel = 0; channel < channels(); ++channel) {
    materials.push_back(channels_[channel].material(of_channel(channel, output)));
  }
  return materials;
}

}  // namespace itn
