// Scene files (protobuf text format of itn.v1.Scene).
#pragma once

#include <filesystem>
#include <optional>

#include "common/scene/scene_bytes.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// Reads a scene file ("-": standard input) and replaces every mesh and image path by its contents,
// so that the scene stands alone; built-in shapes stay names, which are checked. A scene file is as
// trusted as a command line: its paths are relative to its folder, and may be absolute or leave it.
// What they name must be regular files of bounded size. Throws Error: kIo; kInvalidInput with file,
// line and column (unknown field, syntax), or with the name of the mesh or image that cannot be
// used; kDataLoss (damaged image). Ranges are checked where the scene is built. `mesh_unit`: of the
// lengths of all mesh files, instead of what the scene says of each.
v1::Scene load_scene(const std::filesystem::path& path,
                     std::optional<v1::LengthUnit> mesh_unit = {});

// The same of a scene that is not in a file, whose paths are relative to the folder.
void load_files(v1::Scene& scene, const std::filesystem::path& folder,
                std::optional<v1::LengthUnit> mesh_unit = {});

}  // namespace itn
