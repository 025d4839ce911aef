// Meshes of fewer triangles.
#pragma once

#include <cstddef>

#include "common/geometry/mesh.h"

namespace itn {

// With about so many triangles: collapses edges, those first that move the surface least.
Mesh simplified(const Mesh& mesh, size_t triangles);

}  // namespace itn
