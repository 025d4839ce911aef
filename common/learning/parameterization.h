// The coordinates that a network predicts materials in, and the way from its raw outputs to a
// material that can be rendered.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/material.h"
#include "itn/v1/learning.pb.h"

namespace itn {

// (sigma_t, albedo, g), or coordinates that stand for them.
using MaterialCoordinates = std::array<double, 3>;

// jacobian[i][j] = d (sigma_t, albedo, g)_i / d coordinate_j.
using Jacobian = std::array<MaterialCoordinates, 3>;

// The interval in which g lies in UNBOUNDED coordinates: bounds of the model, so that a Gaussian
// over a coordinate can say that nothing is known of g. The other parameterizations do not look at
// it.
struct OpenInterval {
  double min = -1, max = 1;
};

// Requires albedo * g < 1. UNBOUNDED: a reduced albedo or g at the end of its interval or beyond
// counts as one just inside, so that every material has finite coordinates.
MaterialCoordinates to_coordinates(v1::Parameterization parameterization, const Material& material,
                                   const OpenInterval& g = {});

// The exact inverse. Requires g < 1 and, for SIMILARITY, a reduced albedo in (0, 1].
Material from_coordinates(v1::Parameterization parameterization,
                          const MaterialCoordinates& coordinates, const OpenInterval& g = {});

// The Jacobian of from_coordinates, under the same requirements.
Jacobian jacobian(v1::Parameterization parameterization, const MaterialCoordinates& coordinates,
                  const OpenInterval& g = {});

struct Box {
  MaterialCoordinates min{}, max{};
};

Box to_box(const v1::MaterialRange& range);

// The range in which predictions are kept for rendering: that of the training materials and a
// margin. For the ranges of Che et al. 2020 it is the box that they use: sigma_t [20, 300], albedo
// [.35, .97], g [-.1, .9].
v1::MaterialRange prediction_bounds(const v1::MaterialRange& training_range);

// The training range that has these bounds, as far as the bounds tell: where they end at the end of
// what there is, it is a little narrower than it was.
v1::MaterialRange training_range(const v1::MaterialRange& prediction_bounds);

// The interval of g in these bounds.
OpenInterval g_interval(const v1::MaterialRange& bounds);

// Channels of the images that the model answers about.
size_t channels_of(const v1::Model& model);

// The most Gaussians of a network's answer (Model.components).
inline constexpr uint32_t kMaxComponents = 16;

// Coordinates of materials in so many channels, which share the third.
constexpr size_t coordinate_count(size_t channels) {
  return 2 * channels + 1;
}

// What the raw outputs of a network say about a channel of its images: standardised coordinates,
// clamped to a box of materials.
class OutputSpace {
 public:
  // Throws Error (invalid input) if the model's numbers are missing or do not make sense.
  explicit OutputSpace(const v1::Model& model, size_t channel = 0);

  // What the network should answer for this material.
  MaterialCoordinates standardized(const Material& material) const;

  // The material that an output stands for, clamped. Throws Error (invalid input) if it is not
  // finite.
  Material material(const MaterialCoordinates& output) const;

  // The gradient of a loss in the output, from its gradient in (sigma_t, albedo, g) at
  // material(output). Where the output is clamped, the part of the gradient whose descent would
  // push it further out is dropped; the part that pulls it back passes.
  MaterialCoordinates output_gradient(const MaterialCoordinates& output,
                                      const MaterialCoordinates& material_gradient) const;

 private:
  MaterialCoordinates coordinates(const MaterialCoordinates& output) const;

  v1::Parameterization parameterization_;
  OpenInterval g_;
  MaterialCoordinates mean_{}, standard_deviation_{};
  Box material_box_;    // predictions end here
  Box coordinate_box_;  // the smallest that contains the material box; from_coordinates is safe in
                        // it
};

// What all of the outputs say: of C channels 2 C + 1 numbers, first the first coordinate of each,
// then the second of each, then the third, which they share.
class AnswerSpace {
 public:
  // Throws Error as OutputSpace.
  explicit AnswerSpace(const v1::Model& model);

  size_t channels() const { return channels_.size(); }
  size_t size() const { return coordinate_count(channels()); }
  const OutputSpace& channel(size_t channel) const { return channels_.at(channel); }

  // The numbers among all of size() that a channel has.
  MaterialCoordinates of_channel(size_t channel, std::span<const double> all) const;

  // What the network should answer for the materials of the channels, which have one g.
  std::vector<double> standardized(std::span<const Material> materials) const;

  // By channel. Throws Error as OutputSpace::material().
  std::vector<Material> materials(std::span<const double> output) const;

 private:
  std::vector<OutputSpace> channels_;
};

}  // namespace itn
