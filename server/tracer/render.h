// The renderer: an image of a scene and its derivatives with respect to the material, surfaces and
// lights, by path integration with score functions (Che et al., ICCP 2020, Eqs. 4-7).
#pragma once

#include <stop_token>

#include "server/tracer/film/film.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/scene.h"

namespace itn::tracer {

// Renders. The result depends on scene, request, tuning and switches, bit for bit; the random
// numbers of a sample depend on (seed, pixel, sample) alone. Returns within a few milliseconds
// after a stop is requested, by throwing Error (cancelled). Throws Error (invalid input) for a
// request that `validate` refuses.
FilmSums render_grad(const Scene& scene, const RenderRequest& request,
                     const RenderOptions& options = {}, const std::stop_token& stop = {});

}  // namespace itn::tracer
