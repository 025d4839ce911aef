// The surface of a solid as triangles.
#pragma once

#include <cstddef>

#include "client/geometry/sdf/solid.h"
#include "common/geometry/mesh.h"

namespace itn::sdf {

// Dual contouring (Ju, Losasso, Schaefer, Warren, "Dual Contouring of Hermite Data", SIGGRAPH
// 2002): a vertex in each cell of a grid that the surface passes through, where the planes at its
// crossings with the cell's edges meet, so that edges and corners stay sharp. A cell that several
// sheets pass through has a vertex for each (Nielson, "Dual Marching Cubes", VIS 2004): the mesh is
// closed and outward oriented whatever the solid, which is cut off at kReach.
//
// The grid is as fine as takes about the given number of triangles, which may be off by half, but
// no finer than 1/100 of the solid. What is thinner than a cell is lost, or in pieces. Empty if the
// grid finds nothing. A function of its arguments, bit for bit on machines of the same kind.
Mesh contoured(const Solid& solid, size_t about_triangles);

}  // namespace itn::sdf
