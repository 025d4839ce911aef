// The fast renderer: many paths at a time, in stages. Internal to the tracer.
//
// It estimates what reference/path.h estimates, from the same integrals, and is tested against it.
#pragma once

#include <stop_token>

#include "server/tracer/film/film_writer.h"
#include "server/tracer/film/work_queue.h"
#include "server/tracer/geometry/rays.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {

// Traces paths until the queue is empty. Throws Error (cancelled) if stopped.
void trace_wavefront(const Scene::Compiled& scene, const RenderRequest& request,
                     const RenderOptions& options, WorkQueue& queue, FilmWriter& film,
                     const std::stop_token& stop);

// Follows the first `count` rays, for tests and for masks.
void follow(const Obstacles& obstacles, Rays& rays, size_t count);

// Evaluates and draws lights as the wavefront does, for tests.
struct LightProbe {
  FloatColumn radiance{}, pdf{};
  VectorColumn direction{};
};
// Radiance and pdf of `probe.direction`.
void evaluate_lights(const Lights& lights, LightProbe& probe, size_t count);
// Draws `count` directions (see LightSamples in lights-inl.h) with the random numbers of samples 0
// .. count-1 of pixel 0.
void sample_lights(const Lights& lights, uint64_t seed, LightProbe& probe, size_t count);

// Looks up DepthGrid::quantized at `count` points, for tests.
void look_up_quantized_depth(const DepthGrid& depth_grid, const VectorColumn& points,
                             FloatColumn& quantized, size_t count);

}  // namespace itn::tracer
