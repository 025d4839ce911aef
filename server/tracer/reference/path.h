// One path from the camera, by plain path tracing with next-event estimation at every vertex: the
// reference that everything faster is tested against.
#pragma once

#include <stop_token>

#include "server/tracer/film/film_writer.h"
#include "server/tracer/film/plan.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {

// Traces paths until the queue is empty. Throws Error (cancelled) if stopped.
void trace_reference(const Scene::Compiled& scene, const RenderRequest& request,
                     const Switches& switches, WorkQueue& queue, FilmWriter& film,
                     const std::stop_token& stop);

}  // namespace itn::tracer
