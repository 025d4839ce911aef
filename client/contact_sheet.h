// A picture of many shapes, side by side.
#pragma once

#include <filesystem>
#include <functional>

#include "common/geometry/mesh.h"

namespace itn {

// Shapes 0 .. count-1 row by row, each made when it is its turn, from a little above, grey, lit
// from the upper left: in rows of `columns`, in squares of `side` pixels. Shapes are `normalized`.
// Throws Error (kIo) if it cannot be written.
void write_contact_sheet(const std::filesystem::path& path, size_t count, size_t columns, int side,
                         const std::function<Mesh(size_t)>& shape);

}  // namespace itn
