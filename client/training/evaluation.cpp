#include "client/training/evaluation.h"

#include <cmath>

#include "client/dataset/sampler.h"
#include "client/render_pool/render_wait.h"
#include "common/error.h"
#include "common/rpc/wire_array.h"
#include "common/scene/material_proto.h"

namespace itn {

std::vector<Material> predict_all(Predictor& predictor, const LabelledImages& images,
                                  std::stop_token stop) {
  std::vector<Material> predictions;
  for (size_t i = 0; i < images.items.size(); ++i) {
    if (stop.stop_requested()) {
      throw Error(ErrorKind::kCancelled, "interrupted");
    }
    const DatasetImage image = images.read(i);
    predictions.push_back(predictor.predict({.width = images.resolution,
                                             .height = images.resolution,
                                             .channels = 1,
                                             .pixels = image.radiance,
                                             .mask = image.mask})[0]);
  }
  return predictions;
}

std::vector<Material> constant_predictions(const LabelledImages& images) {
  Material mean{0, 0, 0};
  const auto count = static_cast<double>(images.truth.size());
  for (const Material& truth : images.truth) {
    mean.sigma_t += truth.sigma_t / count;
    mean.albedo += truth.albedo / count;
    mean.g += truth.g / count;
  }
  return std::vector<Material>(images.truth.size(), mean);
}

void set_errors(std::span<const Material> predictions, const LabelledImages& images,
                v1::Evaluation::Row& row) {
  Material squares{0, 0, 0};
  for (size_t i = 0; i < predictions.size(); ++i) {
    squares.sigma_t += std::pow(predictions[i].sigma_t - images.truth[i].sigma_t, 2);
    squares.albedo += std::pow(predictions[i].albedo - images.truth[i].albedo, 2);
    squares.g += std::pow(predictions[i].g - images.truth[i].g, 2);
  }
  const auto count = static_cast<double>(predictions.size());
  row.set_sigma_t(std::sqrt(squares.sigma_t / count));
  row.set_albedo(std::sqrt(squares.albedo / count));
  row.set_g(std::sqrt(squares.g / count));
}

std::vector<size_t> spread(size_t count, size_t total) {
  std::vector<size_t> chosen;
  for (size_t i = 0; i < std::min(count, total); ++i) {
    chosen.push_back(i * total / std::min(count, total));
  }
  return chosen;
}

std::vector<float> rerender(DatasetReader& dataset, RenderPool& pool, const v1::DatasetItem& item,
                            const Material& material, uint32_t spp, std::stop_token stop) {
  RenderJob job;
  job.scene = dataset.scene(item);
  *job.request.mutable_material() = to_proto(material);
  job.request.set_spp(spp);
  job.request.set_pixels(v1::OBJECT_PIXELS);  // as the images of a dataset
  // Not the random numbers of the image that it is compared with.
  job.request.set_seed(derive_seed(item.seed(), {1}));
  std::future<v1::RenderGradReply> future = pool.submit(std::move(job));
  const v1::RenderGradReply reply = wait_for_render(future, stop);
  return from_bytes<float>(reply.estimates(0).radiance());
}

double relative_image_error(std::span<const float> image, std::span<const float> rendered,
                            std::span<const float> mask) {
  double error = 0, energy = 0;
  for (size_t p = 0; p < image.size(); ++p) {
    const double difference = static_cast<double>(rendered[p]) - image[p];
    error += mask[p] * difference * difference;
    energy += static_cast<double>(mask[p]) * image[p] * image[p];
  }
  return energy > 0 ? std::sqrt(error / energy) : 0;
}

}  // namespace itn
