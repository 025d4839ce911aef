// Colour pictures, as Figs. 5 and 6 of the paper: red, green and blue are three materials in one
// scene, each of them read off a gray image of its own.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "client/dataset/dataset.h"
#include "client/dataset/plan.h"
#include "client/render/job_renderer.h"
#include "common/material.h"

namespace itn {

inline constexpr size_t kColours = 3;

// Pixels of the three planes, resolution x resolution each.
using ColourPicture = std::array<std::vector<float>, kColours>;

// The items of a test of these numbers, each three times: with its own material and with those of
// two others of the test.
DatasetPlan colour_plan(DatasetPlan test, std::span<const uint32_t> chosen);

// What networks are shown: the images of picture number `k` of a dataset of such a plan.
ColourPicture input_colours(const DatasetReader& colours, size_t k);

// Renders these materials, one for each item of the dataset, and writes the pictures that are not
// there into `folder`/`name`.
void render_colours(DatasetReader& colours, std::span<const Material> materials, uint32_t spp,
                    const std::filesystem::path& folder, const std::string& name, JobRenderer& pool,
                    std::stop_token stop);

// One of the pictures that render_colours() wrote. Throws Error as read_exr().
ColourPicture read_colours(const std::filesystem::path& folder, const std::string& name, size_t k);
std::filesystem::path colours_file(const std::filesystem::path& folder, const std::string& name,
                                   size_t k);

}  // namespace itn
