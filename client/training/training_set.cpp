#include "client/training/training_set.h"

#include <cmath>

#include "common/error.h"
#include "common/learning/encoder.h"
#include "common/learning/parameterization.h"

namespace itn {
namespace {

// 1 / mean radiance over the objects.
double fit_image_scale(const LabelledImages& images) {
  double sum = 0, weight = 0;
  for (size_t i = 0; i < images.items.size(); ++i) {
    for (size_t p = 0; p < images.mask[i].size(); ++p) {
      sum += static_cast<double>(images.mask[i][p]) * images.radiance[i][p];
      weight += images.mask[i][p];
    }
  }
  if (!(sum > 0)) {
    throw invalid_input("the objects are black in all images of the training split");
  }
  return weight / sum;
}

void fit_coordinates(const LabelledImages& images, v1::Model& model) {
  Triple sum{}, squares{};
  for (const Material& truth : images.truth) {
    const Triple c = to_coordinates(model.parameterization(), truth);
    for (size_t i = 0; i < 3; ++i) {
      sum[i] += c[i];
      squares[i] += c[i] * c[i];
    }
  }
  const auto count = static_cast<double>(images.truth.size());
  for (size_t i = 0; i < 3; ++i) {
    const double mean = sum[i] / count;
    const double variance = squares[i] / count - mean * mean;
    if (!(variance > 1e-12 * mean * mean)) {
      throw invalid_input(
          "all materials of the training split are the same in some coordinate; there is "
          "nothing to learn");
    }
    model.add_mean(mean);
    model.add_standard_deviation(std::sqrt(variance));
  }
}

}  // namespace

LabelledImages load_images(const DatasetReader& dataset, v1::Split split, std::stop_token stop) {
  LabelledImages images;
  images.resolution = dataset.resolution();
  images.items = dataset.items(split);
  for (const v1::DatasetItem* item : images.items) {
    if (stop.stop_requested()) {
      throw Error(ErrorKind::kCancelled, "interrupted");
    }
    DatasetImage image = dataset.image(*item);
    images.truth.push_back(material_of(*item));
    images.radiance.push_back(std::move(image.radiance));
    images.mask.push_back(std::move(image.mask));
  }
  if (images.items.empty()) {
    throw invalid_input("the dataset has no image in the split " + v1::Split_Name(split));
  }
  return images;
}

torch::Tensor encoder_inputs(const LabelledImages& images, double image_scale) {
  std::vector<torch::Tensor> inputs;
  for (size_t i = 0; i < images.items.size(); ++i) {
    inputs.push_back(
        encoder_input(images.resolution, images.radiance[i], images.mask[i], image_scale));
  }
  return torch::stack(inputs);
}

v1::Model fit_model(const LabelledImages& images, const v1::MaterialRange& range,
                    const v1::TrainingConfig& config) {
  v1::Model model;
  model.set_resolution(static_cast<uint32_t>(images.resolution));
  *model.mutable_architecture() = config.architecture();
  model.set_output(config.output());
  model.set_parameterization(config.parameterization());
  model.set_image_scale(fit_image_scale(images));
  *model.mutable_bounds() = prediction_bounds(range);
  fit_coordinates(images, model);
  return model;
}

}  // namespace itn
