#include "client/dataset/dataset.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "client/dataset/item_scene.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/image/attributes.h"
#include "common/image/image.h"
#include "common/scene/text_proto.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

void require(bool condition, const std::string& message) {
  if (!condition) throw invalid_input(message);
}

// Null if the image's header has no such number.
template <typename Number>
const Number* attribute_of(const Image& image, const char* name) {
  const auto found = image.attributes.find(name);
  return found == image.attributes.end() ? nullptr : std::get_if<Number>(&found->second);
}

}  // namespace

std::string item_digest(const v1::DatasetConfig& config, const v1::DatasetShape& shape,
                        const v1::DatasetItem& item) {
  return to_hex(
      sha256(fmt::format("{}{} {} {} {}", item.SerializeAsString(), shape.sha256(),
                         config.resolution(), config.spp(), config.noise().SerializeAsString())));
}

std::string to_text(const v1::Dataset& manifest) {
  return to_text_proto(manifest);
}

v1::Dataset read_manifest(const fs::path& path) {
  v1::Dataset manifest;
  parse_text_proto(read_file(path, "manifest"), path.string(), manifest);
  const auto require_inside = [&](const std::string& file) {
    const fs::path relative(file);
    require(
        relative.is_relative() && relative.has_filename() && relative != "." &&
            std::ranges::find(relative, fs::path("..")) == relative.end(),
        fmt::format("{}: \"{}\" is not a file in the folder of the dataset", path.string(), file));
  };
  for (const v1::DatasetShape& shape : manifest.shapes()) {
    require_inside(shape.file());
  }
  for (const v1::DatasetItem& item : manifest.items()) {
    require_inside(item.file());
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

bool holds_shape(const fs::path& folder, const v1::DatasetShape& shape) {
  const fs::path path = path_inside(folder, shape.file());
  return fs::exists(path) && to_hex(sha256(read_file(path, "shape"))) == shape.sha256();
}

DatasetReader::DatasetReader(fs::path folder)
    : folder_(std::move(folder)), manifest_(read_manifest(folder_ / kManifestName)) {
  for (const v1::DatasetShape& shape : manifest_.shapes()) {
    shapes_[shape.name()] = &shape;
  }
  for (const v1::DatasetItem& item : manifest_.items()) {
    require(shapes_.contains(item.shape()),
            fmt::format("{}: {} is of a shape \"{}\" that is not listed",
                        (folder_ / kManifestName).string(), item.file(), item.shape()));
    require(item.split() == shapes_[item.shape()]->split(),
            fmt::format("{}: {} is not in the split of its shape",
                        (folder_ / kManifestName).string(), item.file()));
  }
}

int DatasetReader::resolution() const {
  return static_cast<int>(manifest_.config().resolution());
}

std::vector<const v1::DatasetItem*> DatasetReader::items(v1::Split split) const {
  std::vector<const v1::DatasetItem*> result;
  for (const v1::DatasetItem& item : manifest_.items()) {
    if (item.split() == split) {
      result.push_back(&item);
    }
  }
  return result;
}

DatasetImage DatasetReader::image(const v1::DatasetItem& item) const {
  const fs::path path = path_inside(folder_, item.file());
  if (!fs::exists(path)) {
    throw Error(ErrorKind::kIo,
                fmt::format("{} is missing: the dataset is not complete; the command that began it "
                            "continues it",
                            path.string()));
  }
  const Image image = read_exr(path);
  const auto digest = image.attributes.find(attribute::kItem);
  require(digest != image.attributes.end() && digest->second == Attribute(this->digest(item)) &&
              image.width == resolution() && image.height == resolution(),
          fmt::format("{} is not the image that the manifest describes", path.string()));
  const auto* noise = attribute_of<double>(image, attribute::kRelativeNoise);
  const auto* spp = attribute_of<int>(image, attribute::kSpp);
  require(noise != nullptr && spp != nullptr,
          fmt::format("{} does not say how noisy it is", path.string()));
  return {image.channel("Y"), image.channel("mask.Y"), *noise, static_cast<uint32_t>(*spp)};
}

std::string DatasetReader::digest(const v1::DatasetItem& item) const {
  return item_digest(manifest_.config(), *shapes_.at(item.shape()), item);
}

const v1::Triangles& DatasetReader::triangles(const v1::DatasetShape& shape) {
  if (const auto known = triangles_.find(shape.name()); known != triangles_.end()) {
    return known->second;
  }
  const fs::path path = path_inside(folder_, shape.file());
  const std::string bytes = read_file(path, "shape");
  v1::Triangles triangles;
  if (to_hex(sha256(bytes)) != shape.sha256() || !triangles.ParseFromString(bytes)) {
    throw Error(
        ErrorKind::kDataLoss,
        fmt::format(
            "{} is not the shape that the dataset was rendered with; the command that began "
            "the dataset, with its --shapes, writes it again",
            path.string()));
  }
  // Items of a shape are mostly asked for one after the other.
  constexpr size_t kMaxTriangleBytes = size_t{64} << 20;
  if (triangle_bytes_ + bytes.size() > kMaxTriangleBytes) {
    triangles_.clear();
    triangle_bytes_ = 0;
  }
  triangle_bytes_ += bytes.size();
  return triangles_[shape.name()] = std::move(triangles);
}

std::shared_ptr<const SerializedScene> DatasetReader::scene(const v1::DatasetItem& item) {
  const v1::DatasetShape& shape = *shapes_.at(item.shape());
  return serialize(scene_of(item, triangles(shape), manifest_.config().resolution()));
}

}  // namespace itn
