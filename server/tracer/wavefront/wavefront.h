// The fast renderer: many paths at a time, in stages. Internal to the tracer.
//
// It estimates what reference/path.h estimates, from the same integrals, and is tested against it.
#pragma once

#include <stop_token>

#include "server/tracer/film/film_writer.h"
#include "server/tracer/film/plan.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {

// Traces paths until the queue is empty. Throws Error (cancelled) if stopped.
void trace_wavefront(const Scene::Compiled& scene, const RenderRequest& request,
                     const RenderOptions& options, WorkQueue& queue, FilmWriter& film,
                     const std::stop_token& stop);

}  // namespace itn::tracer
