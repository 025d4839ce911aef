// Optical parameters from one image, by a trained network.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "common/learning/encoder.h"
#include "common/learning/parameterization.h"
#include "common/material.h"

namespace itn {

// A photograph with the object marked.
struct Photograph {
  int width = 0;
  int height = 0;
  int channels = 1;               // 1 or 3
  std::span<const float> pixels;  // linear radiance, >= 0, channels interleaved, top row first
  std::span<const float> mask;    // width * height in [0, 1], 1 on the object
};

// Throws Error (invalid input) that names what is wrong: sizes that do not fit, channels, NaN, a
// negative or infinite value (with its pixel), a mask without a pixel above 0.5.
void validate(const Photograph& photograph);

// Not thread-safe: torch computes in the caller's thread.
class Predictor {
 public:
  // Throws Error as read_checkpoint() does.
  static Predictor load(const std::filesystem::path& checkpoint);
  explicit Predictor(const v1::Model& model);

  // One material for each channel. The image is brought to the network's resolution by averaging
  // over areas. A square image is taken as framed like those that the network was trained with; of
  // any other, a square about the mask is cut out in which the object's longer side takes the same
  // part as there, as sigma_t is relative to the object's longest side of 1 mm. Throws as
  // validate().
  std::vector<Material> predict(const Photograph& photograph);

  // Name and training step, e.g. "itn-similarity, step 1200".
  std::string name() const;
  const v1::Model& model() const { return model_; }

 private:
  v1::Model model_;  // without the weights
  OutputSpace space_;
  Encoder encoder_;
};

}  // namespace itn
