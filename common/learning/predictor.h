// Optical parameters from one image, by a trained network.
#pragma once

#include <filesystem>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "common/image/photograph.h"
#include "common/learning/encoder.h"
#include "common/learning/gaussian.h"
#include "common/learning/network_input.h"
#include "common/learning/parameterization.h"
#include "common/material.h"

namespace itn {

// What a network says about one image.
struct MaterialEstimate {
  Material material;                   // the best guess; the mean of the posterior if there is one
  std::optional<Posterior> posterior;  // of a network with the output GAUSSIAN
  std::vector<double> outputs;         // of the network itself
};

// Not thread-safe: torch computes in the caller's thread.
class Predictor {
 public:
  // Throws Error as read_checkpoint() does.
  static Predictor load(const std::filesystem::path& checkpoint);
  explicit Predictor(const v1::Model& model);

  // One estimate for each channel. What the network sees is framed() (common/image/photograph.h)
  // and brought to its resolution: by averaging over areas, or by interpolation if it is smaller.
  // Takes little memory whatever the photograph's size. Throws as validate(), and Error (cancelled)
  // within milliseconds of a stop, unless the network is at work, which is not interrupted: that
  // takes tens of milliseconds (128^2, 16 base channels), and seconds for the largest there can be
  // (256^2, 64 base channels).
  std::vector<MaterialEstimate> estimate(const Photograph& photograph,
                                         const std::stop_token& stop = {});

  // The best guesses of these estimates.
  std::vector<Material> predict(const Photograph& photograph, const std::stop_token& stop = {});

  // One estimate for each image of the model's resolution.
  std::vector<MaterialEstimate> estimate(const ImageBatch& images);

  // What estimate() sees of a photograph: its channels as images.
  ImageBatch seen(const Photograph& photograph, const std::stop_token& stop = {}) const;

  // Of a network with the output GAUSSIAN: the logarithm of the density that an estimate gives the
  // truth, in the coordinates of standardized().
  double log_likelihood(const MaterialEstimate& estimate, const Material& truth) const;

  // A material in the coordinates in which the network answers.
  Triple standardized(const Material& material) const { return space_.standardized(material); }

  // Name and training step, e.g. "itn-similarity, step 1200".
  std::string name() const;
  const v1::Model& model() const { return model_; }

 private:
  v1::Model model_;  // without the weights
  OutputSpace space_;
  Encoder encoder_;
};

}  // namespace itn
