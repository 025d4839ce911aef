// Closes meshes that are nearly closed, as scans often are. A library of its own: the client
// repairs, a worker never does.
//
// (Of what could do this, CGAL and ADMesh are under the GPL, libigl is not packaged, nor is the
// hole filler of OpenMesh, and VTK brings 180 packages.)
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "common/geometry/mesh.h"

namespace itn {

struct MeshRepairOptions {
  // Vertices of open edges that are nearer than this fraction of the mesh's longest side are one.
  double weld_distance = 1e-4;
  // Holes of more edges stay open, and the mesh is refused.
  size_t max_hole_edges = 500;
};

struct MeshRepair {
  Mesh mesh;
  size_t welded_vertices = 0;
  size_t dropped_triangles = 0;           // that repeat a vertex, or another triangle
  size_t flat_triangles = 0;              // of no area, dropped
  size_t turned_triangles = 0;            // whose orientation was changed
  std::vector<size_t> filled_hole_edges;  // of each hole that was filled

  bool changed() const;
  // One line, e.g. "12 vertices welded, 2 holes filled (of 5 and 9 edges), 31 triangles turned".
  std::string describe() const;
};

// Welds vertices along open edges, drops triangles that are there twice, turns triangles until
// those that share an edge agree and solids are counter-clockwise seen from outside, cavities the
// other way round; and fills holes by the triangles of least area (Barequet and Sharir, "Filling
// gaps in the boundary of a polyhedron", 1995). A mesh that is closed stays as it is, but for
// facets of no area, which are dropped. `what` names
// the mesh in messages. Throws Error (invalid input) if the mesh does not pass validate_closed
// then, with what was tried. Time grows with the number of parts times that of triangles.
MeshRepair repaired(const Mesh& mesh, const std::string& what,
                    const MeshRepairOptions& options = {});

// Throws as validate_closed() does; the message ends with `how_to_repair`, e.g. the flag that asks
// for it.
void require_closed(const Mesh& mesh, const std::string& what, const std::string& how_to_repair);

}  // namespace itn
