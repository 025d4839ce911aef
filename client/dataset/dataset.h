// Datasets: which images there are, the scene of each, and reading them back.
//
// The measurement set-up is that of Che et al., ICCP 2020: an object of 1 mm on a grey ground under
// a clear sky with a widened sun, seen from 15 degrees above the horizon.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/material.h"
#include "common/scene/scene_bytes.h"
#include "itn/v1/experiment.pb.h"

namespace itn {

// A closed mesh, longest side 1 mm, standing on y = 0.
struct Shape {
  std::string name;
  Mesh mesh;
};

struct ShapeSet {
  std::vector<Shape> shapes;         // in the order of their names
  std::vector<std::string> refused;  // one message for each file that cannot be used
};

ShapeSet builtin_shape_set();

// The PLY, OBJ and STL files in a folder (not its subfolders), normalised. Throws Error: kIo (no
// such folder), kInvalidInput (none of them can be used: says why for each). With `repair`, those
// that are nearly closed are closed (mesh_repair.h), and what was changed is logged.
ShapeSet load_shape_set(const std::filesystem::path& folder, bool repair = false);

// The set-up, material ranges and azimuths of the paper, for a square film of this many pixels.
v1::DatasetConfig paper_config(uint32_t resolution);

// A dataset laid out but not rendered. `shape_files`: for each shape the bytes of its file.
struct DatasetPlan {
  v1::Dataset manifest;
  std::map<std::string, std::string> shape_files;  // by DatasetShape.file
};

// Chooses the split and every item. A function of its arguments alone. `test_shapes`: names; empty:
// a random choice by `config.test_fraction`. Throws Error (invalid input) if the configuration is
// out of range or leaves a split without a shape, an azimuth or an item.
DatasetPlan plan_dataset(const v1::DatasetConfig& config, std::span<const Shape> shapes,
                         std::span<const std::string> test_shapes = {});

// What an image's header must say for it to be the image of this item: a digest of the item, the
// shape and the set-up.
std::string item_digest(const v1::Dataset& manifest, const v1::DatasetItem& item);

// The truth of an item.
Material material_of(const v1::DatasetItem& item);

inline constexpr const char* kManifestName = "manifest.textproto";

// The manifest as text; reads back equal.
std::string to_text(const v1::Dataset& manifest);

// Throws Error: kIo; kInvalidInput with line and column.
v1::Dataset read_manifest(const std::filesystem::path& path);

// One image with its mask.
struct DatasetImage {
  std::vector<float> radiance;  // resolution x resolution
  std::vector<float> mask;
};

// A dataset on disk. Not thread-safe.
class DatasetReader {
 public:
  // `folder` holds the manifest. Throws as read_manifest().
  explicit DatasetReader(std::filesystem::path folder);
  DatasetReader(const DatasetReader&) = delete;
  DatasetReader& operator=(const DatasetReader&) = delete;

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
  std::map<std::string, v1::Triangles> triangles_;         // by name
};

}  // namespace itn
