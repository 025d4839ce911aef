// One path from the camera, by plain path tracing with next-event estimation at every vertex: the
// reference that everything faster is tested against.
#pragma once

#include <stop_token>

#include "server/tracer/path_desk.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {

// Traces all the paths that the desk orders. Throws Error (cancelled) if stopped.
void trace_reference(const Scene::Compiled& scene, const RenderSettings& settings, PathDesk& desk,
                     const std::stop_token& stop);

}  // namespace itn::tracer
