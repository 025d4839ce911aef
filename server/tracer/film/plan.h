// Which samples of which pixels a render takes. Internal to the tracer.
#pragma once

#include <cstdint>
#include <vector>

#include "server/tracer/film/film.h"
#include "server/tracer/request/request.h"
#include "server/tracer/scene/compiled_scene.h"

namespace itn::tracer {

struct PlannedPixel {
  uint32_t pixel = 0;  // of the camera's film
  uint32_t sample_count = 0;
  float expected = 0;       // radiance, times Tuning::control_variate
  uint64_t first_path = 0;  // number of its first sample among all those of the plan
};

struct Plan {
  std::vector<PlannedPixel> pixels;  // in the order of their paths
  uint64_t paths = 0;
};

// The part of the film that is rendered.
Tile tile_of(const Scene::Compiled& scene, const RenderRequest& request);

// As many samples in every pixel that is rendered.
Plan even_plan(const Scene::Compiled& scene, const RenderRequest& request);

// How the pilot of a render is rendered: few samples, of other random numbers, also of the pixels
// around the tile that count for those at its edge.
RenderRequest pilot_request(const Scene::Compiled& scene, const RenderRequest& request);

// Samples and control variates after a pilot.
//
// The sum over pixels of weight^2 variance / samples is least, for a given number of samples,
// if each pixel gets samples in proportion to its weight times its standard deviation. The
// pilot's deviation is noisy, so that of its neighbours counts as well, and a quarter of the mean
// deviation is certain. The samples of the render do not depend on the pilot's, so nothing is
// biased by what the pilot found.
Plan plan_from_pilot(const Scene::Compiled& scene, const RenderRequest& request,
                     const RenderOptions& options, const FilmSums& pilot);

}  // namespace itn::tracer
