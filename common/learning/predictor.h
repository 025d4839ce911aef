// Optical parameters from one image, by a trained network.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <variant>
#include <vector>

#include "common/error.h"
#include "common/image/photograph.h"
#include "common/learning/capture.h"
#include "common/learning/combination.h"
#include "common/learning/encoder.h"
#include "common/learning/gaussian.h"
#include "common/learning/network_input.h"
#include "common/learning/outlier_detector.h"
#include "common/learning/parameterization.h"
#include "common/material.h"
#include "itn/v1/predict.pb.h"

namespace itn {

// What a network says about one channel of an image.
struct MaterialEstimate {
  Material material;                   // the best guess; the mean of the posterior if there is one
  std::optional<Posterior> posterior;  // of a network with the output GAUSSIAN
  // Of the network about the image, with its widths corrected; in colour they are those of all
  // channels.
  std::vector<double> outputs;
  // Parameters of which the 90 % intervals, or the best guess of a network without any, reach an
  // end of what the model can answer.
  std::vector<v1::MaterialBound> at_bounds;
  std::optional<OutlierScore> outlier;  // of a model with outlier_model
  std::vector<v1::Warning> warnings;    // of a photograph
};

// What a network sees of a photograph, and what is known of it beside.
struct NetworkView {
  // Of the model's resolution, on the scale of its training: one image, if the model answers about
  // images in colour, else one for each channel.
  ImageBatch channels;
  std::optional<double> object_size;               // longest side, in mm; absent if nobody knows
  std::vector<std::vector<v1::Warning>> warnings;  // by channel
};

// Name, version if it has one, and training step, e.g. "outdoor 1.2, step 30000".
std::string name(const v1::ModelVersion& version);

// Thread-safe. Torch computes in the caller's thread, with a pool of its own for each: let few
// threads of a process call what goes through the network.
class Predictor {
 public:
  // Puts images through the network: n x planes x resolution x resolution -> n x features.
  using Embed = std::function<torch::Tensor(const torch::Tensor& input)>;

  // Throws Error as read_checkpoint() does.
  static Predictor load(const std::filesystem::path& checkpoint);
  explicit Predictor(const v1::Model& model);

  // One estimate for each channel. What the network sees is framed() (common/image/photograph.h)
  // and brought to its resolution: by averaging over areas, or by interpolation if it is smaller.
  // Takes little memory whatever the photograph's size. Throws as validate() of photographs and of
  // captures do, and radiance_factor(), and Error (cancelled)
  // within milliseconds of a stop, unless the network is at work, which is not interrupted: that
  // takes tens of milliseconds (128^2, 16 base channels), and seconds for the largest there can be
  // (256^2, 64 base channels).
  std::vector<MaterialEstimate> estimate(const Photograph& photograph,
                                         const v1::Capture& capture = {},
                                         const std::stop_token& stop = {}) const;

  // The best guesses of these estimates.
  std::vector<Material> predict(const Photograph& photograph,
                                const std::stop_token& stop = {}) const;

  // One estimate for each channel of each image of the model's resolution. A pixel that is quieter
  // than those of the model's training were (v1::Model::noise), as of photographs, is brought up to
  // their noise first, since the network knows no other; always by the same random numbers, so that
  // an image has one answer. A network that has learned from mirrored images (v1::Model::mirrored)
  // sees the image's mirror image, too, with noise of its own. What is estimated of an image
  // depends on no other, bit for bit; it may depend in the last bits on set_torch_threads().
  std::vector<MaterialEstimate> estimate(const ImageBatch& images) const;

  // What became of a photograph: an estimate for each channel, or what is wrong with it.
  using Outcome = std::variant<std::vector<MaterialEstimate>, Error>;

  struct Outcomes {
    std::vector<Outcome> each;
    // What those that could be used say together of one material, with the size of the first's
    // object, all their warnings, and the outlier score of the farthest of them; empty if that
    // was not asked for, or there is none.
    std::vector<MaterialEstimate> combined;
  };

  // Estimates photographs 0 to count - 1, each of which is asked for once, in their order, as
  // seen() gives it. If that throws Error, this is what becomes of it. They go through the network
  // together, but no more at a time than memory should be taken for. Throws Error (cancelled) after
  // a stop, before the next of them, and Error (invalid input) if photographs of one material have
  // not the same channels, the size of some objects alone is known, or the model answers no
  // distributions.
  Outcomes estimate_each(size_t count, const std::function<NetworkView(size_t)>& seen,
                         bool one_material, const std::stop_token& stop = {}) const;
  // Estimates them through the network by `embed`, which gets inputs_at_a_time() at most.
  Outcomes estimate_each(size_t count, const std::function<NetworkView(size_t)>& seen,
                         bool one_material, const std::stop_token& stop, const Embed& embed) const;

  // What estimates for images of one material say together, by channel; of objects whose longest
  // side is 1 mm, or unknown. Throws as estimate_each().
  std::vector<MaterialEstimate> combined(
      std::span<const std::vector<MaterialEstimate>> images) const;

  // What the network makes of its inputs. A row depends on no other, bit for bit.
  torch::Tensor embed(const torch::Tensor& input) const;

  // Inputs that should go through the network together at most, for the memory that it takes.
  int64_t inputs_at_a_time() const;

  // What tells whether images of the model's resolution are familiar to it, of the images that
  // estimate() would show the network.
  Features features(const ImageBatch& images) const;

  // What estimate() sees of a photograph.
  NetworkView seen(const Photograph& photograph, const v1::Capture& capture = {},
                   const std::stop_token& stop = {}) const;

  // For a network with the output GAUSSIAN, the logarithm of the density that an estimate for one
  // of an image's channels gives the truth of all of them, in the coordinates of standardized().
  double log_likelihood(const MaterialEstimate& estimate, std::span<const Material> truth) const;

  // Likewise region_probability() (gaussian.h) of the truth.
  double region_probability(const MaterialEstimate& estimate,
                            std::span<const Material> truth) const;

  // Likewise marginal_probability(), by coordinate.
  std::vector<double> marginal_probability(const MaterialEstimate& estimate,
                                           std::span<const Material> truth) const;

  // Likewise levels_that_reach(), by channel.
  std::vector<IntervalLevels> levels_that_reach(const MaterialEstimate& estimate,
                                                std::span<const Material> truth) const;

  // The materials of an image's channels in the coordinates in which the network answers.
  std::vector<double> standardized(std::span<const Material> channels) const {
    return space_.standardized(channels);
  }
  size_t channels() const { return space_.channels(); }

  std::string name() const;
  const v1::ModelVersion& version() const { return version_; }
  const v1::Model& model() const { return model_; }

 private:
  ImageBatch as_noisy_as_training(const ImageBatch& image) const;
  Features features_of(const ImageBatch& as_measured, const Embed& embed) const;
  torch::Tensor outputs_of(const torch::Tensor& embedding) const;
  std::vector<MaterialEstimate> estimate(const ImageBatch& as_measured,
                                         std::span<const double> object_sizes,
                                         const Embed& embed) const;
  // What the outputs for an image say of an object of this size, by channel.
  std::vector<MaterialEstimate> estimates_of(std::span<const double> outputs, double object_size,
                                             const IntervalLevels& levels) const;
  std::vector<MaterialEstimate> combined(std::span<const Outcome> outcomes,
                                         std::span<const std::optional<double>> object_sizes,
                                         const std::stop_token& stop) const;

  v1::Model model_;  // without the weights and outlier_model
  v1::ModelVersion version_;
  AnswerSpace space_;
  Encoder encoder_;
  std::optional<OutlierDetector> outlier_detector_;
  std::optional<torch::Tensor> calibration_;  // as to_tensor()
  IntervalLevels levels_ = nominal_levels();  // of answers about one image
  torch::Tensor noise_;  // of an image: planes x resolution x resolution, standard normal
};

}  // namespace itn
