// Datasets: which images there are, the scene of each, and reading them back.
//
// The measurement set-up is that of Che et al., ICCP 2020: an object of 1 mm on a grey ground under
// a clear sky with a widened sun, seen from 15 degrees above the horizon.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/scene/scene_bytes.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

// A closed mesh, longest side 1 mm, standing on y = 0.
struct Shape {
  std::string name;
  float height = 0;                      // highest y, in mm
  std::string sha256;                    // of the file's bytes, in hexadecimal
  std::function<std::string()> to_file;  // the bytes of its file in a dataset; may throw Error
};

// Loads the mesh to look at it, and again when its file is asked for: a folder may hold more meshes
// than fit in memory. Throws what `load` throws.
Shape describe_shape(std::string name, std::function<Mesh()> load);

// Keeps the bytes of the file.
Shape describe_shape(std::string name, const Mesh& mesh);

struct ShapeSet {
  std::vector<Shape> shapes;         // in the order of their names
  std::vector<std::string> refused;  // one message for each file that cannot be used
};

// Builds each once; their files take a few MB in all.
ShapeSet builtin_shape_set();

// The PLY, OBJ and STL files in a folder (not its subfolders), normalised. Throws Error: kIo (no
// such folder), kInvalidInput (none of them can be used: says why for each). With `repair`, those
// that are nearly closed are closed (mesh_repair.h), and what was changed is logged.
ShapeSet load_shape_set(const std::filesystem::path& folder, bool repair = false);

// The set-up, material ranges and azimuths of the paper, for a square film of this many pixels.
v1::DatasetConfig paper_config(uint32_t resolution);

// A dataset laid out but not rendered.
struct DatasetPlan {
  v1::Dataset manifest;
  // By DatasetShape.file: the bytes of that file. None for those that are on disk already.
  std::map<std::string, std::function<std::string()>> shape_files;
};

// Chooses the split and every item. A function of its arguments alone. `test_shapes`: names; empty:
// a random choice by `config.test_fraction`. Throws Error (invalid input) if the configuration is
// out of range or leaves a split without a shape, an azimuth or an item.
DatasetPlan plan_dataset(const v1::DatasetConfig& config, std::span<const Shape> shapes,
                         std::span<const std::string> test_shapes = {});

// What an image's header must say for it to be the image of this item: a digest of the item, the
// shape and the set-up.
std::string item_digest(const v1::Dataset& manifest, const v1::DatasetItem& item);

inline constexpr const char* kManifestName = "manifest.textproto";

// The manifest as text; reads back equal.
std::string to_text(const v1::Dataset& manifest);

// Throws Error: kIo; kInvalidInput with line and column, or if it names a file that is not in the
// dataset's folder by its name: absolute, or with "..".
v1::Dataset read_manifest(const std::filesystem::path& path);

// A file of the dataset. Throws Error (invalid input) if it exists but is not a regular file inside
// of the folder, with all links followed.
std::filesystem::path path_inside(const std::filesystem::path& folder, const std::string& file);

// Whether the file of this shape is there and whole. Throws as path_inside().
bool holds_shape(const std::filesystem::path& folder, const v1::DatasetShape& shape);

// One image with its mask.
struct DatasetImage {
  std::vector<float> radiance;  // resolution x resolution
  std::vector<float> mask;
  // Standard error over radiance of a pixel: root of the mean squares of both over the object.
  double relative_noise = 0;
};

// A dataset on disk. What it has in memory is the manifest and some shapes, however many there are.
// Not thread-safe, but for image().
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

  // Throws Error: kIo if the image has not been rendered yet, kInvalidInput if it is not the image
  // of this item, and as read_exr().
  DatasetImage image(const v1::DatasetItem& item) const;

  // The scene that the image was rendered of. Throws Error: kIo, kDataLoss (the shape's file is not
  // the one that the manifest was written for).
  std::shared_ptr<const SerializedScene> scene(const v1::DatasetItem& item);

 private:
  const v1::Triangles& triangles(const v1::DatasetShape& shape);

  std::filesystem::path folder_;
  v1::Dataset manifest_;
  std::map<std::string, const v1::DatasetShape*> shapes_;  // by name
  std::map<std::string, v1::Triangles> triangles_;         // by name; those used lately
  size_t triangle_bytes_ = 0;                              // of these
};

}  // namespace itn
