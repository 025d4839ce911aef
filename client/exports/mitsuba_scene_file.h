// A scene and its medium as files of Mitsuba 3.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "client/render/image_render.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// Writes the XML file `path`, and beside it the meshes and pictures that it names, whose names
// begin with its own. `request`: the medium, and whether the image is in colour; its samples,
// derivatives and values are not looked at. Returns what has no counterpart there, a sentence each.
// Throws Error: as channels_of(), resolve_media(), to_mitsuba() (server/exports/mitsuba_scene.h)
// and write_file_atomically().
std::vector<std::string> write_mitsuba_scene(const std::filesystem::path& path,
                                             const v1::Scene& scene, const ImageRequest& request);

}  // namespace itn
