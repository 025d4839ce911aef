// A dataset on disk: reading it back.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "client/image/image.h"
#include "common/scene/scene_bytes.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

// The digest of all that determines the image of `item`. The image's header stores it, which tells
// whether a file is that image. `panorama` is null if no panorama lights the item.
std::string item_digest(const v1::DatasetConfig& config, const v1::DatasetShape& shape,
                        const v1::DatasetPanorama* panorama, const v1::DatasetItem& item);

// The digest of the image's pixels and header entries, without the entry that stores this digest.
std::string contents_digest(const Image& image);

inline constexpr const char* kManifestName = "manifest.textproto";

// The manifest as text, with a checksum in the first line; reads back equal.
std::string to_text(const v1::Dataset& manifest);

// Reads and checks a manifest. Throws Error: kIo; kDataLoss if the checksum of the first line is
// not that of the text, or the file ends within that line; kInvalidInput, with line and column, if
// the text cannot be parsed, check_item() refuses an item, or a file's name is absolute or has
// "..".
v1::Dataset read_manifest(const std::filesystem::path& path);

// The path of `file` in the folder of the dataset. Throws Error (invalid input) if it exists but is
// not a regular file inside of the folder, with all links followed.
std::filesystem::path path_inside(const std::filesystem::path& folder, const std::string& file);

// Whether `file` is in the folder and has the digest `sha256`. Throws what path_inside() throws.
bool holds_file(const std::filesystem::path& folder, const std::string& file,
                const std::string& sha256);

// The channels of images in colour.
inline constexpr std::array<const char*, 3> kColourChannels{"R", "G", "B"};

// The channels of an item's image: Y, or those.
std::vector<std::string> channel_names(const v1::DatasetItem& item);

// One channel of an image, with its mask.
struct DatasetImage {
  std::vector<float> radiance;  // resolution x resolution
  std::vector<float> mask;
  std::vector<float> standard_error;  // of the radiance; 0 or empty where unknown
  // The noise as NoiseTarget in dataset.proto defines it, by the header; 0 if unknown (of a single
  // sample), or if the image is black; infinite if it is nothing but noise.
  double relative_noise = 0;
  uint32_t spp = 0;
};

// Shapes or panoramas of a dataset: those used lately, up to some memory.
template <typename Message>
class RecentParts {
 public:
  // `kind`: what they are called in messages; `flag`: that makes them.
  RecentParts(std::string kind, std::string flag)
      : kind_(std::move(kind)), flag_(std::move(flag)) {}

  // `entry`: a DatasetShape or DatasetPanorama. Throws Error: kIo, kDataLoss (not the file of that
  // digest).
  template <typename Entry>
  const Message& get(const std::filesystem::path& folder, const Entry& entry);

 private:
  std::string kind_, flag_;
  std::map<std::string, Message> parts_;  // by name
  size_t bytes_ = 0;
};

// Independent estimates of d radiance / d (sigma_t, albedo, g), in this order: resolution x
// resolution each.
inline constexpr int kDerivativeEstimates = 2;
using DerivativeImages = std::array<std::array<std::vector<float>, 3>, kDerivativeEstimates>;

// A dataset on disk. What it has in memory is the manifest and some shapes and
// panoramas, however many there are.
// Not thread-safe, but for image() and derivatives().
class DatasetReader {
 public:
  // `folder` holds the manifest. Throws as read_manifest().
  explicit DatasetReader(std::filesystem::path folder);
  DatasetReader(const DatasetReader&) = delete;
  DatasetReader& operator=(const DatasetReader&) = delete;

  const std::filesystem::path& folder() const { return folder_; }
  const v1::Dataset& manifest() const { return manifest_; }
  int resolution() const;
  std::vector<const v1::DatasetItem*> items(v1::Split split) const;

  // The image of an item with one channel. Throws Error: kIo if the image has not been rendered
  // yet, kInvalidInput if it is not the image of this item, or in colour, and as read_exr().
  DatasetImage image(const v1::DatasetItem& item) const;
  // The image by channel: luminance, or red, green and blue. Throws likewise.
  std::vector<DatasetImage> channels(const v1::DatasetItem& item) const;

  // What is white in the light of an item (white_of()).
  std::array<double, 3> white(const v1::DatasetItem& item);

  // Reads the derivative images of a dataset that has them (Error, invalid input, otherwise);
  // throws as image().
  DerivativeImages derivatives(const v1::DatasetItem& item) const;

  // What the header of the item's image must say.
  std::string digest(const v1::DatasetItem& item) const;

  // The scene that the image was rendered of. Throws Error: kIo, kDataLoss (the file of the shape
  // or panorama is not the one that the manifest was written for).
  std::shared_ptr<const SerializedScene> scene(const v1::DatasetItem& item);
  // Likewise, of which the film shows another part of the light.
  std::shared_ptr<const SerializedScene> scene(const v1::DatasetItem& item,
                                               v1::Film::Channel shown);

 private:
  // Its file, which is that of this item.
  Image file_of(const v1::DatasetItem& item) const;
  const v1::DatasetPanorama* panorama_of(const v1::DatasetItem& item) const;  // null without

  std::filesystem::path folder_;
  v1::Dataset manifest_;
  std::map<std::string, const v1::DatasetShape*> shapes_;        // by name
  std::map<std::string, const v1::DatasetPanorama*> panoramas_;  // by name
  RecentParts<v1::Triangles> triangles_{"shape", "--shapes"};
  RecentParts<v1::Pixels> pixels_{"panorama", "--panoramas"};
};

}  // namespace itn
