#include "client/training/training_set.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "client/dataset/sampler.h"
#include "common/error.h"
#include "common/learning/parameterization.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

// By the coordinates of the labels.
void fit_coordinates(const LabelledImages& images, v1::Model& model) {
  // Whatever they are standardised by, that is undone again.
  const size_t n = coordinate_count(images.channels);
  for (size_t i = 0; i < n; ++i) {
    model.add_mean(0);
    model.add_standard_deviation(1);
  }
  const AnswerSpace space(model);
  std::vector<double> sum(n), products(n * n);
  const auto add = [&](size_t image) {
    const std::vector<double> c = space.standardized(images.truth_of(image));
    for (size_t i = 0; i < n; ++i) {
      sum[i] += c[i];
      for (size_t j = 0; j < n; ++j) products[i * n + j] += c[i] * c[j];
    }
  };
  size_t count = images.labelled.size();
  for (const uint32_t i : images.labelled) add(i);
  if (count == 0) {
    count = images.items.size();
    for (size_t i = 0; i < count; ++i) add(i);
  }
  for (size_t i = 0; i < n; ++i) {
    const double mean = sum[i] / static_cast<double>(count);
    const double variance = products[i * n + i] / static_cast<double>(count) - mean * mean;
    if (!(variance > 1e-12 * mean * mean)) {
      throw invalid_input(
          "all materials of the training split are the same in some coordinate; there is "
          "nothing to learn");
    }
    model.set_mean(static_cast<int>(i), mean);
    model.set_standard_deviation(static_cast<int>(i), std::sqrt(variance));
  }
  for (size_t i = 0; i < n; ++i) {
    for (size_t j = 0; j < n; ++j) {
      const int row = static_cast<int>(i), column = static_cast<int>(j);
      const double covariance =
          products[i * n + j] / static_cast<double>(count) - model.mean(row) * model.mean(column);
      model.add_correlation(covariance /
                            (model.standard_deviation(row) * model.standard_deviation(column)));
    }
  }
}

void divide(std::vector<float>& values, double divisor) {
  for (float& value : values) value /= static_cast<float>(divisor);
}

size_t channels_of(const v1::DatasetItem& item) {
  return std::max<size_t>(1, static_cast<size_t>(item.colours_size()));
}

}  // namespace

LabelledImages images_of(DatasetReader& dataset, v1::Split split) {
  LabelledImages images;
  images.resolution = dataset.resolution();
  images.items = dataset.items(split);
  if (images.items.empty()) {
    throw invalid_input("the dataset has no image in the split " + v1::Split_Name(split));
  }
  images.channels = channels_of(*images.items.front());
  for (const v1::DatasetItem* item : images.items) {
    if (channels_of(*item) != images.channels) {
      throw invalid_input("some images of the dataset are in colour, and others are not");
    }
    if (item->colours().empty()) images.truth.push_back(from_proto(item->material()));
    for (const v1::Material& colour : item->colours()) images.truth.push_back(from_proto(colour));
  }
  images.read = [&dataset, items = images.items](size_t i) { return dataset.image(*items.at(i)); };
  std::vector<std::array<double, 3>> whites;
  if (images.channels > 1) {
    for (const v1::DatasetItem* item : images.items) whites.push_back(dataset.white(*item));
  }
  images.read_colours = [&dataset, items = images.items, whites = std::move(whites)](size_t i) {
    std::vector<DatasetImage> channels = dataset.channels(*items.at(i));
    for (size_t c = 0; c < channels.size(); ++c) {
      divide(channels[c].radiance, whites.at(i).at(c));
      divide(channels[c].standard_error, whites[i].at(c));
    }
    return channels;
  };
  images.derivatives = [&dataset, items = images.items](size_t i) {
    return dataset.derivatives(*items.at(i));
  };
  images.scene = [&dataset, items = images.items](size_t i) { return dataset.scene(*items.at(i)); };
  return images;
}

std::vector<DatasetImage> read_channels(const LabelledImages& images, size_t number) {
  if (images.channels > 1) return images.read_colours(number);
  return {images.read(number)};
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
  model.set_components(config.components());
  model.set_input(config.input());
  model.set_exposure(config.exposure());
  model.set_parameterization(config.parameterization());
  model.set_image_scale(1 / mean_radiance);
  *model.mutable_bounds() = prediction_bounds(range);
  if (images.channels > 1) model.set_channels(static_cast<uint32_t>(images.channels));
  fit_coordinates(images, model);
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
