// itn fit with a scene that is given: where the object stands, and in which light, is known.
#pragma once

#include <filesystem>

#include "client/commands/fit.h"

namespace itn {

// Writes the photographs at the size of their scenes' films, with what counts of them and what
// another g would change, and says what a refinement is of: images, scenes, start, and what is not
// known. Throws Error as read_marked(), load_scene() and find_materials() do.
void prepare_given_scenes(const FitOptions& options, const std::filesystem::path& folder,
                          RefineOptions& refine);

}  // namespace itn
