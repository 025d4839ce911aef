#include "client/dataset/panorama_set.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "client/dataset/panorama.h"
#include "client/files/folder_files.h"
#include "client/scene/panorama_file.h"
#include "common/error.h"
#include "common/scene/scene_bytes.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

void require_radiance(const v1::Pixels& pixels, const std::string& name) {
  const std::vector<float> rgb = from_bytes<float>(pixels.rgb());
  const auto bad = std::ranges::find_if(rgb, [](float v) { return !(v >= 0 && std::isfinite(v)); });
  if (bad == rgb.end()) return;
  const auto pixel = (bad - rgb.begin()) / 3;
  throw invalid_input(fmt::format("{}: pixel ({}, {}) is {}; radiance must be finite and >= 0",
                                  name, pixel % pixels.width(), pixel / pixels.width(), *bad));
}

// The bytes of its file in a dataset.
std::string normalized(const fs::path& file) {
  const v1::Pixels all = load_panorama(file);
  if (all.width() != 2 * all.height()) {
    throw invalid_input(fmt::format(
        "{} has {} x {} pixels; a panorama in latitude-longitude format is twice as wide as high",
        file.string(), all.width(), all.height()));
  }
  require_radiance(all, file.string());
  v1::Pixels pixels = averaged_down(all, kPanoramaWidth, kPanoramaHeight);
  const double irradiance = irradiance_from_above(pixels);
  if (!(irradiance > 0)) {
    throw invalid_input(fmt::format("{} is black above the horizon", file.string()));
  }
  scale(pixels, 1 / irradiance);
  require_radiance(pixels, file.string());
  return pixels.SerializeAsString();
}

}  // namespace

PanoramaSet load_panorama_set(const fs::path& folder) {
  PanoramaSet set;
  for (const fs::path& file : files_with({".exr"}, folder)) {
    try {
      const auto bytes = std::make_shared<const std::string>(normalized(file));
      set.panoramas.push_back({.name = file.stem().string(),
                               .sha256 = to_hex(sha256(*bytes)),
                               .to_file = [bytes] { return *bytes; }});
    } catch (const Error& error) {
      set.refused.emplace_back(error.what());
    }
  }
  if (set.panoramas.empty()) {
    throw invalid_input(set.refused.empty()
                            ? fmt::format("{} holds no EXR file", folder.string())
                            : fmt::format("no panorama in {} can be used:\n  {}", folder.string(),
                                          fmt::join(set.refused, "\n  ")));
  }
  std::ranges::sort(set.panoramas, {}, &Panorama::name);
  return set;
}

PanoramaSet panorama_set(const v1::DatasetConfig& config) {
  const v1::PanoramaChoice* choice = panoramas_of(config);
  if (choice == nullptr) return {};
  if (choice->folder().empty()) {
    throw invalid_input("panoramas.folder is empty; it is the folder with the EXR files");
  }
  return load_panorama_set(choice->folder());
}

PanoramaSet panorama_set(const v1::Dataset& manifest) {
  PanoramaSet set;
  for (const v1::DatasetPanorama& panorama : manifest.panoramas()) {
    set.panoramas.push_back({.name = panorama.name(), .sha256 = panorama.sha256(), .to_file = {}});
  }
  return set;
}

const v1::PanoramaChoice* panoramas_of(const v1::DatasetConfig& config) {
  const auto light = std::ranges::find_if(config.lights(), &v1::LightChoice::has_panoramas);
  return light == config.lights().end() ? nullptr : &light->panoramas();
}

}  // namespace itn
