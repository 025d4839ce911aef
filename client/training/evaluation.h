// How well trained networks do on a split of a dataset, beside the strongest constant answer.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <stop_token>
#include <vector>

#include "client/render/job_renderer.h"
#include "client/training/training_set.h"
#include "common/learning/parameterization.h"
#include "common/learning/predictor.h"

namespace itn {

// One estimate for each channel of each image, which is changed first, by the same random numbers
// each time. Some images are in memory at a time.
std::vector<MaterialEstimate> estimate_all(const Predictor& predictor, const LabelledImages& images,
                                           const v1::Augmentation& change = {},
                                           const std::stop_token& stop = {});

// For each channel of each image, what the answers to all images of its object say together. Those
// of an object come one after the other (DatasetConfig.views). Throws Error (invalid input) if each
// is of another, or the predictor cannot combine its answers.
std::vector<MaterialEstimate> combined(const Predictor& predictor, const LabelledImages& images,
                                       std::span<const MaterialEstimate> estimates);

// The mean of the truth of these very images, for each of them: of all constant answers the one
// with the smallest RMSE. A network that does not beat it has learned nothing of the parameter.
std::vector<Material> constant_predictions(const LabelledImages& images);

// Sets root-mean-square errors of the row: of sigma_t, albedo and g, and of what follows from them.
void set_errors(std::span<const Material> predictions, const LabelledImages& images,
                v1::Evaluation::Row& row);

// The errors of sigma_t, albedo and g over those of the constant predictor; infinite where the
// truth is one and the same.
MaterialCoordinates relative_errors(std::span<const Material> predictions,
                                    const LabelledImages& images);

// Sets what the row says beside them: errors relative to the constant predictor's, with bootstrap
// intervals over the shapes of the items, root-mean-square and mean absolute; median relative
// errors; errors of what the eye sees; the thirds in sigma_t; and, if the estimates are
// distributions, their coverage. Requires that the row has its errors.
void set_details(std::span<const MaterialEstimate> estimates, const LabelledImages& images,
                 v1::Evaluation::Row& row);

// Sets the log-likelihoods of the row, its joint coverage and its tests of ranks, for a predictor
// that answers distributions about such images.
void set_likelihood(const Predictor& predictor, std::span<const MaterialEstimate> estimates,
                    const LabelledImages& images, v1::Evaluation::Row& row);

// Sets the part of the images that are outliers to the model, if it knows.
void set_outlier_fraction(std::span<const MaterialEstimate> estimates, v1::Evaluation::Row& row);

// How well the model's outlier scores tell images from others: the probability that one of the
// second has a higher score than one of the first, equal ones counting half (the area under the
// curve of hits by false alarms). Requires that all have scores.
double outlier_area(std::span<const MaterialEstimate> usual,
                    std::span<const MaterialEstimate> others);

// The numbers of `count` of the images, rising, one from each of as many equal stretches of the
// split, at random, as a fixed stride would meet the same material of a grid again and again. A
// function of the arguments alone.
std::vector<uint32_t> spread(size_t count, size_t total);

// One image rendered with a material, at the scene of an item; of one in colour the image of this
// colour: 0 to 2 are red, green and blue.
std::vector<float> rerender(DatasetReader& dataset, JobRenderer& pool, const v1::DatasetItem& item,
                            const Material& material, uint32_t spp, std::stop_token stop = {},
                            size_t colour = 0);

// How far renders are from the images that they should be, over some images.
struct ImageErrors {
  double relative = 0;       // mean of relative_image_error()
  double dissimilarity = 0;  // mean of 1 - MS-SSIM (client/image/ms_ssim.h)
};

// The errors of the images of these numbers, in each of their channels, rendered again with the
// predictions; black ones count 0. `progress` is called after each.
ImageErrors image_errors(DatasetReader& dataset, JobRenderer& pool, const LabelledImages& images,
                         std::span<const uint32_t> chosen, std::span<const Material> predictions,
                         uint32_t spp, const std::function<void()>& progress,
                         std::stop_token stop = {});

// For images in colour of these numbers, sphere_colour() of these materials, which are of all
// images, behind the surface of each. The same random numbers each time. `progress` is called after
// each.
std::vector<std::array<double, 3>> sphere_colours(JobRenderer& pool, const LabelledImages& images,
                                                  std::span<const uint32_t> chosen,
                                                  std::span<const Material> materials, uint32_t spp,
                                                  const std::function<void()>& progress,
                                                  std::stop_token stop = {});

// Sets what the row says of colour_difference() between them.
void set_colour_differences(std::span<const std::array<double, 3>> answers,
                            std::span<const std::array<double, 3>> truth, v1::Evaluation::Row& row);

// sqrt(sum (I - T)^2 / sum I^2) over the object (pixels weighted by the mask). Contains the noise
// of both images.
double relative_image_error(std::span<const float> image, std::span<const float> rendered,
                            std::span<const float> mask);

}  // namespace itn
