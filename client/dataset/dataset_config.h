// Dataset files: what the images of a dataset are drawn from.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "itn/v1/dataset.pb.h"

namespace itn {

// The preset of this name (client/presets/presets.h), with all defaults. Throws as find_preset().
v1::DatasetConfig preset_config(std::string_view name);

// The preset `paper`: the set-up, materials and azimuths of Che et al. 2020.
v1::DatasetConfig paper_config(uint32_t resolution);

// Reads a dataset file; with all defaults. Throws Error: kIo; kInvalidInput with file, line and
// column. Ranges are checked by validate().
v1::DatasetConfig load_dataset_config(const std::filesystem::path& path);

// Puts the default wherever a field is absent.
void set_defaults(v1::DatasetConfig& config);

// Throws Error (invalid input) that names what is out of range. For a configuration with all
// defaults.
void validate(const v1::DatasetConfig& config);
// `where` begins the message.
void validate_resolution(uint32_t resolution, const std::string& where = "");

// The irradiance of every light, in W/m^2, where all of them have the same one (Model.irradiance in
// learning.proto); otherwise 0. For a valid configuration.
double common_irradiance(const v1::DatasetConfig& config);

// What materials can be drawn.
v1::MaterialRange material_range(const v1::DatasetConfig& config);

}  // namespace itn
