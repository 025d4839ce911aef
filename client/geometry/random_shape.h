// An endless family of shapes, so that a network sees each of them a few times at most: what it
// learns of shape then holds for shapes that it has not seen.
#pragma once

#include <cstdint>
#include <string>

#include "client/geometry/sdf/random_solid.h"
#include "common/geometry/mesh.h"

namespace itn {

// One whole solid for every seed: smooth, grown, faceted, machined, turned or thin, with the
// probabilities of sdf::kKinds. Longest side 1 mm, standing on y = 0, centred over the origin;
// upright in half of all cases, any way up in the others; closed, outward oriented, accepted by
// validate_closed(); kMinRandomTriangles to kMaxRandomTriangles triangles, more of them where it is
// curved. It hardly ever cuts through itself, as scans do. A function of the seed, bit for bit on
// machines of the same kind; elsewhere the math library may round otherwise. Takes some 25 ms, at
// times 100.
Mesh random_shape(uint64_t seed);

// What it is one of.
sdf::Kind random_shape_kind(uint64_t seed);

inline constexpr size_t kMinRandomTriangles = 2000;
inline constexpr size_t kMaxRandomTriangles = 6000;

// The shapes of a set of random ones, from 0: the seed and the name ("random-SEED-INDEX") of each.
uint64_t random_shape_seed(uint64_t set_seed, uint64_t index);
std::string random_shape_name(uint64_t set_seed, uint64_t index);

}  // namespace itn
