// The images of a split in the form that the network takes.
#pragma once

#include <stop_token>
#include <vector>

#include <torch/torch.h>

#include "client/dataset/dataset.h"
#include "common/material.h"

namespace itn {

struct LabelledImages {
  int resolution = 0;
  std::vector<const v1::DatasetItem*> items;
  std::vector<Material> truth;
  std::vector<std::vector<float>> radiance;  // of each item, as rendered
  std::vector<std::vector<float>> mask;
};

// Reads all images of a split. Throws as DatasetReader::image(); kCancelled.
LabelledImages load_images(const DatasetReader& dataset, v1::Split split,
                           std::stop_token stop = {});

// items x 2 x resolution x resolution.
torch::Tensor encoder_inputs(const LabelledImages& images, double image_scale);

// A model without weights, as the configuration says: coordinates standardised by the mean and
// standard deviation of the truth, radiance scaled so that its mean over the objects is 1,
// predictions bounded by the range of the dataset's materials and a margin. Throws Error (invalid
// input) if all images are black or all materials are the same in some coordinate.
v1::Model fit_model(const LabelledImages& images, const v1::MaterialRange& range,
                    const v1::TrainingConfig& config);

}  // namespace itn
