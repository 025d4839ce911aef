// Random valid scenes of all kinds, and of sizes by exponents, for comparisons of the tracers.
#pragma once

#include <cstdint>
#include <string>

#include "server/tracer/render.h"
#include "server/tracer/scene/scene.h"

namespace itn::testing {

struct RandomScene {
  tracer::SceneDescription description;
  tracer::RenderRequest request;  // material and phase function, derivatives in sigma_t, albedo, g
  std::string what;               // of which kinds it consists
};

// Always the same for a number.
RandomScene random_scene(uint64_t number);

// The same scene in other words, in which its image does not change.
RandomScene scaled(RandomScene scene, double factor);  // all lengths
RandomScene turned(RandomScene scene, double angle);   // all but the camera's film, about y
RandomScene with_cut_triangles(RandomScene scene);     // each in three, where they are flat
RandomScene with_split_lights(RandomScene scene);      // each in two of half the brightness
// What it is under light `number` alone.
RandomScene lit_by(RandomScene scene, size_t number);
// In a constant light of 1, with nothing that absorbs: its image is 1 everywhere.
RandomScene in_a_furnace(RandomScene scene);

}  // namespace itn::testing
