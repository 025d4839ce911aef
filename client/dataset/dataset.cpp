#include "client/dataset/dataset.h"

#include <algorithm>
#include <string_view>
#include <utility>
#include <variant>

#include <fmt/format.h>

#include "client/dataset/dataset_config.h"
#include "client/dataset/item_scene.h"
#include "client/image/attributes.h"
#include "client/render/render_query.h"
#include "client/render/reply_images.h"
#include "client/scene/text_proto.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/scene/wire_array.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

// Null if the image's header has no such number.
template <typename Number>
const Number* attribute_of(const Image& image, const char* name) {
  const auto found = image.attributes.find(name);
  return found == image.attributes.end() ? nullptr : std::get_if<Number>(&found->second);
}

// How a manifest begins; the checksum is of all that follows its line. Earlier versions wrote none.
constexpr std::string_view kChecksumLine = "# SHA-256 of the lines below: ";

void check_checksum(std::string_view text, const fs::path& path) {
  const bool ends_within = kChecksumLine.starts_with(text);
  if (!ends_within && !text.starts_with(kChecksumLine)) return;
  const size_t line = std::min(text.find('\n'), text.size());
  const std::string_view below = text.substr(std::min(line + 1, text.size()));
  if (!ends_within && text.substr(kChecksumLine.size(), line - kChecksumLine.size()) ==
                          to_hex(sha256(std::string(below)))) {
    return;
  }
  throw Error(
      ErrorKind::kDataLoss,
      fmt::format("{} is damaged: it does not have the checksum of its first line. Without the "
                  "file, the command that began the dataset writes it again; without that "
                  "line, it is taken as it is",
                  path.string()));
}

}  // namespace

std::string item_digest(const v1::DatasetConfig& config, const v1::DatasetShape& shape,
                        const v1::DatasetPanorama* panorama, const v1::DatasetItem& item) {
  return to_hex(sha256(fmt::format(
      "{}{}{} {} {} {}{}", item.SerializeAsString(), shape.sha256(),
      panorama == nullptr ? "" : " " + panorama->sha256(), config.resolution(), config.spp(),
      config.noise().SerializeAsString(), config.derivatives() ? " derivatives" : "")));
}

std::string contents_digest(const Image& image) {
  std::string all = fmt::format("{} {}", image.width, image.height);
  for (const auto& [name, plane] : image.channels) all += " " + name + " " + to_bytes(plane);
  for (const auto& [name, value] : image.attributes) {
    if (name == attribute::kContents) continue;
    all += std::visit([&, &name = name](const auto& v) { return fmt::format(" {} {}", name, v); },
                      value);
  }
  return to_hex(sha256(all));
}

std::string to_text(const v1::Dataset& manifest) {
  const std::string text = to_text_proto(manifest);
  return fmt::format("{}{}\n{}", kChecksumLine, to_hex(sha256(text)), text);
}

v1::Dataset read_manifest(const fs::path& path) {
  const std::string text = read_file(path, "manifest");
  check_checksum(text, path);
  v1::Dataset manifest;
  parse_text_proto(text, path.string(), manifest);
  const auto require_inside = [&](const std::string& file) {
    const fs::path relative(file);
    require(
        relative.is_relative() && relative.has_filename() && relative != "." &&
            std::ranges::find(relative, fs::path("..")) == relative.end(),
        fmt::format("{}: \"{}\" is not a file in the folder of the dataset", path.string(), file));
  };
  for (const v1::DatasetShape& shape : manifest.shapes()) require_inside(shape.file());
  for (const v1::DatasetPanorama& panorama : manifest.panoramas()) require_inside(panorama.file());
  for (int i = 0; i < manifest.items_size(); ++i) {
    require_inside(manifest.items(i).file());
    check_item(manifest.items(i), fmt::format("{}: items[{}]", path.string(), i));
  }
  return manifest;
}

fs::path path_inside(const fs::path& folder, const std::string& file) {
  const fs::path path = folder / file;
  std::error_code error;
  if (fs::exists(fs::symlink_status(path, error))) {
    const fs::path base = fs::weakly_canonical(folder, error);
    const fs::path target = fs::weakly_canonical(path, error);
    require(!error && fs::is_regular_file(target, error) &&
                std::mismatch(base.begin(), base.end(), target.begin(), target.end()).first ==
                    base.end(),
            fmt::format("{} is not a regular file in the folder of the dataset", path.string()));
  }
  return path;
}

bool holds_file(const fs::path& folder, const std::string& file, const std::string& sha256) {
  const fs::path path = path_inside(folder, file);
  return fs::exists(path) && to_hex(itn::sha256(read_file(path, "file"))) == sha256;
}

template <typename Message>
template <typename Entry>
const Message& RecentParts<Message>::get(const fs::path& folder, const Entry& entry) {
  if (const auto known = parts_.find(entry.name()); known != parts_.end()) return known->second;
  const fs::path path = path_inside(folder, entry.file());
  const std::string bytes = read_file(path, kind_);
  Message part;
  if (to_hex(sha256(bytes)) != entry.sha256() || !part.ParseFromString(bytes)) {
    throw Error(ErrorKind::kDataLoss,
                fmt::format("{} is not the {} that the dataset was rendered with; the command that "
                            "began the dataset, with its {}, writes it again",
                            path.string(), kind_, flag_));
  }
  // Items of a shape are mostly asked for one after the other.
  constexpr size_t kMaxBytes = size_t{64} << 20;
  if (bytes_ + bytes.size() > kMaxBytes) {
    parts_.clear();
    bytes_ = 0;
  }
  bytes_ += bytes.size();
  return parts_[entry.name()] = std::move(part);
}

DatasetReader::DatasetReader(fs::path folder)
    : folder_(std::move(folder)), manifest_(read_manifest(folder_ / kManifestName)) {
  validate_resolution(manifest_.config().resolution(), (folder_ / kManifestName).string() + ": ");
  for (const v1::DatasetShape& shape : manifest_.shapes()) shapes_[shape.name()] = &shape;
  for (const v1::DatasetPanorama& panorama : manifest_.panoramas()) {
    panoramas_[panorama.name()] = &panorama;
  }
  for (const v1::DatasetItem& item : manifest_.items()) {
    require(shapes_.contains(item.shape()),
            fmt::format("{}: {} is of a shape \"{}\" that is not listed",
                        (folder_ / kManifestName).string(), item.file(), item.shape()));
    require(item.split() == shapes_[item.shape()]->split(),
            fmt::format("{}: {} is not in the split of its shape",
                        (folder_ / kManifestName).string(), item.file()));
    const v1::ItemLight& light = item.light();
    require(!light.has_panorama() || panoramas_.contains(light.panorama().name()),
            fmt::format("{}: {} is lit by a panorama \"{}\" that is not listed",
                        (folder_ / kManifestName).string(), item.file(), light.panorama().name()));
  }
}

int DatasetReader::resolution() const {
  return static_cast<int>(manifest_.config().resolution());
}

std::vector<const v1::DatasetItem*> DatasetReader::items(v1::Split split) const {
  std::vector<const v1::DatasetItem*> result;
  for (const v1::DatasetItem& item : manifest_.items()) {
    if (item.split() == split) result.push_back(&item);
  }
  return result;
}

Image DatasetReader::file_of(const v1::DatasetItem& item) const {
  const fs::path path = path_inside(folder_, item.file());
  if (!fs::exists(path)) {
    throw Error(ErrorKind::kIo,
                fmt::format("{} is missing: the dataset is not complete; the command that began it "
                            "continues it",
                            path.string()));
  }
  Image image = read_exr(path);
  const auto digest = image.attributes.find(attribute::kItem);
  const auto contents = image.attributes.find(attribute::kContents);  // earlier versions wrote none
  if (contents != image.attributes.end() && contents->second != Attribute(contents_digest(image))) {
    throw Error(
        ErrorKind::kDataLoss,
        fmt::format("{} is damaged: it does not have the checksum that it should; the command "
                    "that began the dataset renders it again",
                    path.string()));
  }
  require(digest != image.attributes.end() && digest->second == Attribute(this->digest(item)) &&
              image.width == resolution() && image.height == resolution(),
          fmt::format("{} is not the image that the manifest describes", path.string()));
  return image;
}

std::vector<std::string> channel_names(const v1::DatasetItem& item) {
  if (item.colours().empty()) return {"Y"};
  return {kColourChannels.begin(), kColourChannels.end()};
}

DatasetImage DatasetReader::image(const v1::DatasetItem& item) const {
  require(item.colours().empty(),
          fmt::format("{} is in colour, where an image with one channel is needed",
                      (folder_ / item.file()).string()));
  return std::move(channels(item).front());
}

std::vector<DatasetImage> DatasetReader::channels(const v1::DatasetItem& item) const {
  const Image image = file_of(item);
  const auto* noise = attribute_of<double>(image, attribute::kRelativeNoise);
  const auto* spp = attribute_of<int>(image, attribute::kSpp);
  require(noise != nullptr && spp != nullptr,
          fmt::format("{} does not say how noisy it is", (folder_ / item.file()).string()));
  require(*noise >= 0, fmt::format("{} says a relative noise of {}; it must be >= 0",
                                   (folder_ / item.file()).string(), *noise));
  std::vector<DatasetImage> channels;
  for (const std::string& name : channel_names(item)) {
    channels.push_back({image.channel(name), image.channel("mask.Y"),
                        image.channel("stderr." + name), *noise, static_cast<uint32_t>(*spp)});
  }
  return channels;
}

std::array<double, 3> DatasetReader::white(const v1::DatasetItem& item) {
  const v1::DatasetPanorama* panorama = panorama_of(item);
  return white_of(item, panorama == nullptr ? nullptr : &pixels_.get(folder_, *panorama));
}

DerivativeImages DatasetReader::derivatives(const v1::DatasetItem& item) const {
  require(manifest_.config().derivatives(),
          fmt::format("{} has no derivative images; itn dataset --derivatives makes one that has",
                      folder_.string()));
  Image image = file_of(item);
  DerivativeImages derivatives;
  for (int k = 0; k < kDerivativeEstimates; ++k) {
    for (size_t i = 0; i < 3; ++i) {
      derivatives[static_cast<size_t>(k)][i] =
          image.channel(estimate_channel(k, kMaterialParameters[i]));
    }
  }
  return derivatives;
}

std::string DatasetReader::digest(const v1::DatasetItem& item) const {
  return item_digest(manifest_.config(), *shapes_.at(item.shape()), panorama_of(item), item);
}

const v1::DatasetPanorama* DatasetReader::panorama_of(const v1::DatasetItem& item) const {
  const v1::ItemLight& light = item.light();
  return light.has_panorama() ? panoramas_.at(light.panorama().name()) : nullptr;
}

std::shared_ptr<const SerializedScene> DatasetReader::scene(const v1::DatasetItem& item) {
  return scene(item, item.channel());
}

std::shared_ptr<const SerializedScene> DatasetReader::scene(const v1::DatasetItem& item,
                                                            v1::Film::Channel shown) {
  const v1::Triangles& triangles = triangles_.get(folder_, *shapes_.at(item.shape()));
  const v1::DatasetPanorama* panorama = panorama_of(item);
  v1::Scene scene = scene_of(item, triangles, manifest_.config().resolution(),
                             panorama == nullptr ? nullptr : &pixels_.get(folder_, *panorama));
  scene.mutable_film()->set_channel(shown);
  return serialize(scene);
}

}  // namespace itn
