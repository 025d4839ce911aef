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
  const auto run = [&]<typename AtBoundary>(std::type_identity<AtBoundary>) {
    std::make_unique<Walk<AtBoundary>>(scene, request, options, queue, film)->run(stop);
  };
  if (options.switches.boundary == nullptr) {
    run(std::type_identity<IndexMatched>());
  } else {
    run(std::type_identity<Modelled>());
  }
}

void follow_rays(const Obstacles& obstacles, Rays& rays, size_t count) {
  IndexMatched passes;
  follow_lines(obstacles, rays, count, Report::kEnds, passes);
}

void evaluate_all(const Lights& lights, LightProbe& probe, size_t count) {
  for (size_t i = 0; i < count; i += lanes()) {
    const Emission light = emission(lights, load(probe.direction, i));
    store(light.radiance, probe.radiance, i);
    store(light.pdf, probe.pdf, i);
  }
}

void draw_all(const Lights& lights, uint64_t seed, LightProbe& probe, size_t count) {
  for (size_t i = 0; i < count; i += lanes()) {
    const Uints number = hn::Iota(UintTag(), static_cast<uint32_t>(i)), zero = hn::Zero(UintTag());
    const Words words = philox(zero, zero, number, zero, seed);
    const Words more = philox(zero, set(uint32_t{1}), number, zero, seed);
    const LightSamples light = sample(lights, words, more);
    store(light.direction, probe.direction, i);
    store(light.radiance, probe.radiance, i);
    store(light.pdf, probe.pdf, i);
  }
}

void look_up_all(const DepthGrid& depth_grid, const VectorColumn& points, FloatColumn& quantized,
                 size_t count) {
  for (size_t i = 0; i < count; i += lanes()) {
    store(quantized_depth(depth_grid, load(points, i)), quantized, i);
  }
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace itn::tracer {

HWY_EXPORT(run_wavefront);
HWY_EXPORT(follow_rays);
HWY_EXPORT(evaluate_all);
HWY_EXPORT(draw_all);
HWY_EXPORT(look_up_all);

void trace_wavefront(const Scene::Compiled& scene, const RenderRequest& request,
                     const RenderOptions& options, WorkQueue& queue, FilmWriter& film,
                     const std::stop_token& stop) {
  HWY_DYNAMIC_DISPATCH(run_wavefront)(scene, request, options, queue, film, stop);
}

void follow(const Obstacles& obstacles, Rays& rays, size_t count) {
  HWY_DYNAMIC_DISPATCH(follow_rays)(obstacles, rays, count);
}

void evaluate_lights(const Lights& lights, LightProbe& probe, size_t count) {
  HWY_DYNAMIC_DISPATCH(evaluate_all)(lights, probe, count);
}

void sample_lights(const Lights& lights, uint64_t seed, LightProbe& probe, size_t count) {
  HWY_DYNAMIC_DISPATCH(draw_all)(lights, seed, probe, count);
}

void look_up_quantized_depth(const DepthGrid& depth_grid, const VectorColumn& points,
                             FloatColumn& quantized, size_t count) {
  HWY_DYNAMIC_DISPATCH(look_up_all)(depth_grid, points, quantized, count);
}

}  // namespace itn::tracer
#endif
