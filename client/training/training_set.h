// The images of a split with their truth.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "client/dataset/dataset.h"
#include "common/material.h"
#include "itn/v1/learning.pb.h"

namespace itn {

struct LabelledImages {
  int resolution = 0;
  size_t channels = 1;  // of each image: one, or red, green and blue
  std::vector<const v1::DatasetItem*> items;
  std::vector<Material> truth;  // of each channel, one image after the other
  // Numbers of the items whose truth may be learned from; empty: all.
  std::vector<uint32_t> labelled;
  // By the number of the item. Images are read when they are asked for, and not kept. `read`,
  // `read_colours` and `derivatives` may be called from several threads at a time, `scene` may not;
  // they throw as DatasetReader does.
  std::function<DatasetImage(size_t)> read;
  // Of images in colour instead: as a camera takes them whose white is that of their light.
  std::function<std::vector<DatasetImage>(size_t)> read_colours;
  std::function<DerivativeImages(size_t)> derivatives;
  std::function<std::shared_ptr<const SerializedScene>(size_t)> scene;

  std::span<const Material> truth_of(size_t image) const {
    return std::span(truth).subspan(image * channels, channels);
  }
};

// All images of a split; the dataset must outlive them. Throws Error (invalid input) if there are
// none.
LabelledImages images_of(DatasetReader& dataset, v1::Split split);

// The channels of an image of any kind; throws as LabelledImages::read.
std::vector<DatasetImage> read_channels(const LabelledImages& images, size_t number);

// Lets so many items, chosen by a seed, keep their labels; 0: all. Throws Error (invalid input) if
// there are not so many.
void keep_labels(uint32_t count, uint64_t seed, LabelledImages& images);

// A model without weights, as the configuration says: coordinates standardised by the mean and
// standard deviation of the labels, radiance scaled so that its mean over the objects is 1,
// predictions bounded by the range of the dataset's materials and a margin. Throws Error (invalid
// input) if all images are black or all materials are the same in some coordinate.
v1::Model fit_model(const LabelledImages& images, double mean_radiance,
                    const v1::MaterialRange& range, const v1::TrainingConfig& config);

// Warns where more than a hundredth of the truths are albedos that a model of these bounds cannot
// answer, which no training mends. `name` is the model's.
void warn_of_albedos_out_of_reach(const std::vector<Material>& truth,
                                  const v1::MaterialRange& bounds, const std::string& name);

}  // namespace itn
