// Closed procedural shapes of thin and thick features, so that nothing needs to be downloaded.
#pragma once

#include <span>
#include <stop_token>
#include <string>
#include <string_view>

#include "common/geometry/mesh.h"

namespace itn {

struct ShapeInfo {
  std::string_view name;
  std::string_view description;  // one line
};

// In a fixed order.
std::span<const ShapeInfo> builtin_shapes();

// Throws Error (invalid input) that lists the names there are.
void check_shape_name(std::string_view name);

// Longest side 1 mm, standing on y = 0, centred over the origin; closed and outward oriented.
// Deterministic; up to two seconds. Throws Error: kInvalidInput that lists the names there are,
// kCancelled soon after a stop is asked for.
Mesh make_shape(std::string_view name, const std::stop_token& stop = {});

}  // namespace itn
