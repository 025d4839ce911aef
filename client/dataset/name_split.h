// Which shapes and panoramas of a dataset are for training, validation and test.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "client/dataset/panorama_set.h"
#include "client/dataset/shape_set.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

// Names by split, each list in order.
struct NameSplit {
  std::vector<std::string> train, validation, test;

  const std::vector<std::string>& names(v1::Split split) const;
  // The names of the split or, where it has none, those of training.
  const std::vector<std::string>& names_or_training(v1::Split split) const;
  // The split that a name is in; training, if it is in none.
  v1::Split split_of(const std::string& name) const;
};

// The split of shapes that the configuration names; otherwise a random choice by its fractions, of
// at least one for each that is not 0. Throws Error (invalid input) if there are too few, or none
// of that name.
NameSplit split_shapes(const v1::DatasetConfig& config, std::span<const Shape> shapes);

// A random choice by the fractions of the shapes: one for the test at least if there are two, for
// validation if there are three. Throws Error (invalid input) if two have the same name.
NameSplit split_panoramas(const v1::DatasetConfig& config, std::span<const Panorama> panoramas);

// The splits of a dataset that is there.
NameSplit split_shapes(const v1::Dataset& manifest);
NameSplit split_panoramas(const v1::Dataset& manifest);

}  // namespace itn
