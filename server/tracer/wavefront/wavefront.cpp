// The wavefront, compiled for every instruction set of simd/targets.h, and chosen at run time.
// Multiplications and additions are fused where the code says so, not where the compiler likes
// (-ffp-contract=off), so that every width computes the same bits.
#include "server/tracer/simd/targets.h"
// After targets.h:
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/tracer/wavefront/wavefront.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h:
#include <hwy/highway.h>

#include "server/tracer/random/sampler.h"
#include "server/tracer/wavefront/walk/walk-inl.h"
#include "server/tracer/wavefront/wavefront.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

void run_wavefront(const Scene::Compiled& scene, const RenderRequest& request,
                   const RenderOptions& options, WorkQueue& queue, FilmWriter& film,
                   const std::stop_token& stop) {
  std::make_unique<Walk>(scene, request, options, queue, film)->run(stop);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace itn::tracer {

HWY_EXPORT(run_wavefront);

void trace_wavefront(const Scene::Compiled& scene, const RenderRequest& request,
                     const RenderOptions& options, WorkQueue& queue, FilmWriter& film,
                     const std::stop_token& stop) {
  HWY_DYNAMIC_DISPATCH(run_wavefront)(scene, request, options, queue, film, stop);
}

}  // namespace itn::tracer
#endif
