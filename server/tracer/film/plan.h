// Which samples of which pixels a render takes, and how threads get them to trace from. Internal to
// the tracer.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <span>
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

// A plan of as many samples in every pixel that is rendered.
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

// A path to be traced.
struct PathSample {
  uint32_t pixel = 0;
  uint32_t sample = 0;
  float expected = 0;  // radiance, which multiplies the derivatives' control variates
};

// Hands out the samples of a plan, in its order. Thread-safe.
class WorkQueue {
 public:
  // The samples of each pixel are numbered from `first_sample` on.
  WorkQueue(const Plan& plan, uint32_t first_sample) : plan_(plan), first_sample_(first_sample) {}

  // Fills some of `samples`, from the front, and returns how many; 0: there are no more.
  size_t take(std::span<PathSample> samples) {
    const uint64_t first = next_.fetch_add(samples.size(), std::memory_order_relaxed);
    if (first >= plan_.paths) return 0;
    const auto count = static_cast<size_t>(std::min<uint64_t>(samples.size(), plan_.paths - first));
    const auto begins_after = [](uint64_t path, const PlannedPixel& p) {
      return path < p.first_path;
    };
    auto at = std::upper_bound(plan_.pixels.begin(), plan_.pixels.end(), first, begins_after) - 1;
    for (size_t i = 0; i < count; ++i) {
      while (first + i >= at->first_path + at->sample_count) ++at;
      const auto number = static_cast<uint32_t>(first + i - at->first_path);
      samples[i] = {at->pixel, first_sample_ + number, at->expected};
    }
    return count;
  }

 private:
  const Plan& plan_;
  const uint32_t first_sample_;
  std::atomic<uint64_t> next_ = 0;
};

}  // namespace itn::tracer
