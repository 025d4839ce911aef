#include "server/tracer/render.h"

#include <time.h>

#include <vector>

#include "common/threads.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/film/plan.h"
#include "server/tracer/reference/path.h"
#include "server/tracer/scene/compiled_scene.h"
#include "server/tracer/wavefront/wavefront.h"

namespace itn::tracer {
namespace {

double thread_cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// Traces the paths of a plan, on as many threads as have something to do.
FilmSums render(const Scene::Compiled& scene, const RenderRequest& request,
                const RenderOptions& options, const Plan& plan, const std::stop_token& stop) {
  FilmSums film = empty_film(scene, request, plan);
  WorkQueue queue(plan, request.first_sample);
  constexpr uint64_t kPathsPerThread = 256;
  const uint64_t busy = 1 + plan.paths / kPathsPerThread;
  std::vector<FilmWriter> writers(std::min<uint64_t>(thread_count(options.threads), busy),
                                  FilmWriter(film));
  on_threads(writers.size(), [&](size_t i) {
    FilmWriter& writer = writers[i];
    const double start = thread_cpu_seconds();
    if (request.tracer == Tracer::kWavefront) {
      trace_wavefront(scene, request, options, queue, writer, stop);
    } else {
      trace_reference(scene, request, options.switches, queue, writer, stop);
    }
    writer.close();
    writer.counters.cpu_seconds += thread_cpu_seconds() - start;
  });
  for (const FilmWriter& writer : writers) add(film.counters, writer.counters);
  return film;
}

}  // namespace

FilmSums render_grad(const Scene& scene, const RenderRequest& request, const RenderOptions& options,
                     const std::stop_token& stop) {
  validate(request, scene);
  const Scene::Compiled& compiled = scene.compiled();
  if (request.pixels == Pixels::kObject) {
    compiled.object_pixels(options.threads, stop);  // found before they are planned with
  }
  if (request.pilot_spp == 0) {
    return render(compiled, request, options, even_plan(compiled, request), stop);
  }
  const RenderRequest pilot = pilot_request(compiled, request);
  const FilmSums coarse = render(compiled, pilot, options, even_plan(compiled, pilot), stop);
  FilmSums sums =
      render(compiled, request, options, plan_from_pilot(compiled, request, options, coarse), stop);
  add(sums.counters, coarse.counters);
  return sums;
}

}  // namespace itn::tracer
