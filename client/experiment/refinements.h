// Table 3 of Che et al. 2020: analysis by synthesis from what networks say, with shape and light
// known.
#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "client/dataset/dataset.h"
#include "client/render/job_renderer.h"
#include "client/training/training_set.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

// Numbers of the test's images that are refined, evenly spread.
std::vector<uint32_t> refined_images(const v1::AnalysisBySynthesis& settings, size_t test_images);

// Refines the images from a start for each image of the test, by Adam and by Gauss-Newton, several
// at a time. Each image that is done is a file in `folder` and is not done again. `progress` is
// called with how many are done. Throws what refinements throw, and Error (cancelled) soon after a
// stop.
v1::ExperimentRefinements refine_images(const v1::AnalysisBySynthesis& settings,
                                        DatasetReader& dataset, const LabelledImages& test,
                                        std::span<const Material> starts,
                                        const std::filesystem::path& folder, JobRenderer& pool,
                                        const std::function<void(size_t, size_t)>& progress,
                                        std::stop_token stop);

// The files in `folder` of the images that are refined, in order.
std::vector<std::filesystem::path> refinement_files(const v1::AnalysisBySynthesis& settings,
                                                    size_t test_images,
                                                    const std::filesystem::path& folder);

}  // namespace itn
