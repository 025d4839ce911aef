// The objects of a dataset.
#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "common/geometry/mesh.h"
#include "itn/v1/dataset.pb.h"

namespace itn {

// A closed mesh, longest side 1 mm, standing on y = 0. It is loaded when it is needed, unless it is
// small enough to be kept.
struct Shape {
  std::string name;
  std::string sha256;  // of the file's bytes, in hexadecimal; empty: not known before it is made
  // The bytes of its file in a dataset; may throw Error. Empty: the file is there.
  std::function<std::string()> to_file;
};

// Keeps the bytes of the file.
Shape describe_shape(std::string name, const Mesh& mesh);

struct ShapeSet {
  std::vector<Shape> shapes;         // in the order of their names
  std::vector<std::string> refused;  // one message for each file that cannot be used
  std::vector<std::string> alike;    // one message for each file that repeats another's shape
};

// All of them, or those of these names. Throws Error (invalid input) that lists the names there
// are.
ShapeSet builtin_shape_set(std::span<const std::string> names = {});

// The PLY, OBJ and STL files in a folder (not its subfolders), normalised. Throws Error: kIo (no
// such folder), kInvalidInput (none of them can be used: says why for each). A shape that is
// another one, turned, scaled or mirrored, is used, and told. With `repair`, those that are nearly
// closed are closed (mesh_repair.h), and what was changed is logged.
ShapeSet load_shape_set(const std::filesystem::path& folder, bool repair = false);

// The first of an endless family (random_shape.h). None is built before its file is asked for.
ShapeSet random_shape_set(uint32_t count, uint64_t seed);

// Whatever the source says. Throws as these.
ShapeSet shape_set(const v1::ShapeSource& source);

// The shapes of a dataset that is there, without what would make their files.
ShapeSet shape_set(const v1::Dataset& manifest);

}  // namespace itn
