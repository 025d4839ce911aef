// Which images a dataset has: the choices of every item.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "client/dataset/dataset_config.h"
#include "client/dataset/name_split.h"
#include "client/dataset/panorama_set.h"
#include "client/dataset/shape_set.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

// Item `index` of the endless sequence that a valid configuration describes: a function of its
// arguments alone, in a time that does not depend on them, and thread-safe. Every choice is
// independent of every other, and each by itself is evenly spread over any stretch of the sequence.
// Each split has its share of any stretch, too; those whose fraction is 0 have none. Not for a grid
// of materials, which ends. `panoramas`: where they are one of the lights.
v1::DatasetItem plan_item(const v1::DatasetConfig& config, const NameSplit& shapes, uint64_t index,
                          const NameSplit& panoramas = {});

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
