// Which images a dataset has: the choices of every item.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "client/dataset/dataset_config.h"
#include "client/dataset/panorama_set.h"
#include "client/dataset/shape_set.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

// The names of the shapes of each split, in order.
struct ShapeSplit {
  std::vector<std::string> train, validation, test;

  const std::vector<std::string>& names(v1::Split split) const;
};

// The split that the configuration names; otherwise a random choice by its fractions, of at least
// one for each that is not 0. Throws Error (invalid input) if there are too few, or none of that
// name.
ShapeSplit split_shapes(const v1::DatasetConfig& config, std::span<const Shape> shapes);

// That of a dataset that is there.
ShapeSplit split_shapes(const v1::Dataset& manifest);

// The names of the panoramas of each split, in order.
struct PanoramaSplit {
  std::vector<std::string> train, validation, test;

  // The names of a split, or those of training where it has none.
  const std::vector<std::string>& names(v1::Split split) const;
};

// A random choice by the fractions of the shapes: one for the test at least if there are two, for
// validation if there are three. Throws Error (invalid input) if two have the same name.
PanoramaSplit split_panoramas(const v1::DatasetConfig& config, std::span<const Panorama> panoramas);
PanoramaSplit split_panoramas(const v1::Dataset& manifest);

// Item `index` of the endless sequence that a valid configuration describes: a function of its
// arguments alone, in a time that does not depend on them, and thread-safe. Every choice is
// independent of every other, and each by itself is evenly spread over any stretch of the sequence.
// Each split has its share of any stretch, too; those whose fraction is 0 have none. Not for a grid
// of materials, which ends. `panoramas`: where they are one of the lights.
v1::DatasetItem plan_item(const v1::DatasetConfig& config, const ShapeSplit& shapes, uint64_t index,
                          const PanoramaSplit& panoramas = {});

// A dataset laid out but not rendered.
struct DatasetPlan {
  v1::Dataset manifest;
  // By the name of a shape's or panorama's file: its bytes. None for those that are on disk
  // already.
  std::map<std::string, std::function<std::string()>> files;
};

// `panoramas`: where they are one of the lights. Throws Error (invalid input) if the configuration
// is out of range or leaves training or test without a shape or an item.
DatasetPlan plan_dataset(const v1::DatasetConfig& config, std::span<const Shape> shapes,
                         std::span<const Panorama> panoramas = {});

// The plan of a dataset that is there, with more items: those that it has are its first ones.
// Throws Error (invalid input) if it has more than `count`, or is a grid.
DatasetPlan extended(const v1::Dataset& existing, uint32_t count);

}  // namespace itn
