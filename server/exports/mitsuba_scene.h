// Scenes as those of Mitsuba 3: https://mitsuba.readthedocs.io, "Plugin reference".
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/geometry/mesh.h"
#include "common/material.h"
#include "itn/v1/render.pb.h"
#include "itn/v1/scene.pb.h"

namespace itn {

// A scene file and those that it names, which lie beside it.
struct MitsubaFiles {
  struct Shape {
    std::string file;  // its name, a PLY file
    Mesh mesh;         // in mm
    // The normals at the corners of its triangles, outwards, of unit length; empty: it is flat.
    std::vector<std::array<Vec3f, 3>> corner_normals;
  };
  struct Picture {
    std::string file;  // its name, an OpenEXR file
    int width = 0, height = 0;
    std::vector<float> rgb;  // of each pixel, top row first
    bool is_panorama = false;
  };
  std::string xml;
  std::vector<Shape> shapes;
  std::vector<Picture> pictures;
  std::vector<std::string> not_carried_over;  // a sentence each
};

// In mm, with the scene's radiances. A film of one channel becomes one of luminance, whose lights
// and surfaces are as gray as it sees them. `media`: of the object and of other objects, one
// material each, or those of R, G and B; other objects of the scene need some material, too.
// `phase`: of the object, instead of that of its g. `stem`: what the names of files begin with.
// Lights that are far away become one panorama, unless there is but one that has a counterpart; its
// first row stands at +y and its last at -y. A rectangle that an object touches is moved a little.
// Throws Error (invalid input) where the scene cannot be rendered.
MitsubaFiles to_mitsuba(const v1::Scene& scene, std::span<const std::vector<Material>> media,
                        const std::optional<v1::PhaseFunction>& phase, const std::string& stem);

}  // namespace itn
