#include "client/training/image_metric.h"

#include "client/training/in_parallel.h"
#include "common/error.h"
#include "common/learning/weight_map.h"

namespace itn {

ImageMetric image_metric(std::span<const float> image, std::span<const float> weight,
                         const DerivativeImages& derivatives) {
  bool fits = weight.size() == image.size();
  for (const auto& estimate : derivatives) {
    for (const std::vector<float>& derivative : estimate) {
      fits = fits && derivative.size() == image.size();
    }
  }
  if (!fits) throw invalid_input("the derivative images do not have the size of the image");
  ImageMetric metric{};
  double energy = 0;
  for (size_t p = 0; p < image.size(); ++p) {
    const double w2 = static_cast<double>(weight[p]) * weight[p];
    energy += w2 * image[p] * image[p];
    for (size_t i = 0; i < 3; ++i) {
      for (size_t j = 0; j < 3; ++j) {
        const auto product = [&](size_t a, size_t b) {
          return static_cast<double>(derivatives[a][i][p]) * derivatives[b][j][p];
        };
        metric[i][j] += w2 * (product(0, 1) + product(1, 0)) / 2;
      }
    }
  }
  if (!(energy > 0)) throw invalid_input("the image is black where its weight map is not 0");
  for (Triple& row : metric) {
    for (double& value : row) value /= energy;
  }
  return metric;
}

std::vector<float> image_weights(const DatasetImage& image, int resolution,
                                 v1::TrainingConfig::ImageWeights weights) {
  return weights == v1::TrainingConfig::UNIFORM
             ? image.mask
             : weight_map(resolution, resolution, image.radiance, image.mask);
}

std::vector<ImageMetric> image_metrics(const LabelledImages& images,
                                       v1::TrainingConfig::ImageWeights weights,
                                       std::stop_token stop) {
  std::vector<ImageMetric> metrics(images.items.size());
  in_parallel(metrics.size(), stop, [&](size_t i) {
    const DatasetImage image = images.read(i);
    metrics[i] = image_metric(image.radiance, image_weights(image, images.resolution, weights),
                              images.derivatives(i));
  });
  return metrics;
}

}  // namespace itn
