// The panoramas that light a dataset.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "itn/v1/dataset.pb.h"

namespace itn {

// Averaged down to this, and scaled to an irradiance of 1 W/m^2 on a surface that faces up: an
// object without a gloss shows no finer detail, and a scene with a panorama travels with it.
inline constexpr uint32_t kPanoramaWidth = 256, kPanoramaHeight = 128;

struct Panorama {
  std::string name;
  std::string sha256;  // of the file's bytes, in hexadecimal
  // The bytes of its file in a dataset: serialized Pixels. Empty: the file is there.
  std::function<std::string()> to_file;
};

struct PanoramaSet {
  std::vector<Panorama> panoramas;   // in the order of their names
  std::vector<std::string> refused;  // one message for each file that cannot be used
};

// The EXR files in a folder (not its subfolders). Throws Error: kIo (no such folder), kInvalidInput
// (none of them can be used: says why for each).
PanoramaSet load_panorama_set(const std::filesystem::path& folder);

// The panoramas of the folder that a light of the configuration names; none without such a light.
PanoramaSet panorama_set(const v1::DatasetConfig& config);

// The panoramas of a dataset that is there, without what would make their files.
PanoramaSet panorama_set(const v1::Dataset& manifest);

// The choice of panoramas in a configuration; null without.
const v1::PanoramaChoice* panoramas_of(const v1::DatasetConfig& config);

}  // namespace itn
