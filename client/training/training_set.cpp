#include "client/training/training_set.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>

#include "client/dataset/sampler.h"
#include "common/error.h"
#include "common/learning/parameterization.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

void fit_coordinates(std::span<const Material> truth, v1::Model& model) {
  MaterialCoordinates sum{}, squares{};
  for (const Material& material : truth) {
    const MaterialCoordinates c =
        to_coordinates(model.parameterization(), material, g_interval(model.bounds()));
    for (size_t i = 0; i < 3; ++i) {
      sum[i] += c[i];
      squares[i] += c[i] * c[i];
    }
  }
  const auto count = static_cast<double>(truth.size());
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

LabelledImages images_of(DatasetReader& dataset, v1::Split split) {
  LabelledImages images;
  images.resolution = dataset.resolution();
  images.items = dataset.items(split);
  if (images.items.empty()) {
    throw invalid_input("the dataset has no image in the split " + v1::Split_Name(split));
  }
  for (const v1::DatasetItem* item : images.items) {
    images.truth.push_back(from_proto(item->material()));
  }
  images.read = [&dataset, items = images.items](size_t i) { return dataset.image(*items.at(i)); };
  images.derivatives = [&dataset, items = images.items](size_t i) {
    return dataset.derivatives(*items.at(i));
  };
  images.scene = [&dataset, items = images.items](size_t i) { return dataset.scene(*items.at(i)); };
  return images;
}

void keep_labels(uint32_t count, uint64_t seed, LabelledImages& images) {
  const auto all = static_cast<uint32_t>(images.items.size());
  if (count > all) {
    throw invalid_input(fmt::format("labels is {}; the training split has {} images", count, all));
  }
  images.labelled.clear();
  if (count == 0 || count == all) return;
  images.labelled = permutation(all, seed);
  images.labelled.resize(count);
}

v1::Model fit_model(const LabelledImages& images, double mean_radiance,
                    const v1::MaterialRange& range, const v1::TrainingConfig& config) {
  if (!(mean_radiance > 0)) {
    throw invalid_input("the objects are black in all images of the training split");
  }
  v1::Model model;
  model.set_resolution(config.resolution() != 0 ? config.resolution()
                                                : static_cast<uint32_t>(images.resolution));
  *model.mutable_architecture() = config.architecture();
  model.set_output(config.output());
  model.set_input(config.input());
  model.set_exposure(config.exposure());
  model.set_parameterization(config.parameterization());
  model.set_image_scale(1 / mean_radiance);
  *model.mutable_bounds() = prediction_bounds(range);
  std::vector<Material> labels;
  for (const uint32_t i : images.labelled) labels.push_back(images.truth[i]);
  fit_coordinates(labels.empty() ? images.truth : labels, model);
  return model;
}

void warn_of_albedos_out_of_reach(const std::vector<Material>& truth,
                                  const v1::MaterialRange& bounds, const std::string& name) {
  constexpr double kFew = 0.01;
  const auto beyond = [&](const Material& m) { return m.albedo > bounds.albedo().max(); };
  const double part = static_cast<double>(std::ranges::count_if(truth, beyond)) /
                      static_cast<double>(std::max<size_t>(1, truth.size()));
  if (part <= kFew) return;
  spdlog::warn(
      "{:.0f} % of the albedos are above {:.4g}, the most that {} can answer: errors of those "
      "do not vanish",
      100 * part, bounds.albedo().max(), name);
}

}  // namespace itn
