#include "server/tracer/simd/targets.h"
// After targets.h:
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/server/tracer/lane_probes.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h:
#include <hwy/highway.h>

#include "common/fields.h"
#include "server/tracer/boundary/boundary.h"
#include "server/tracer/geometry/depth_grid-inl.h"
#include "server/tracer/geometry/lines/lines-inl.h"
#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/phase/phase_function.h"
#include "server/tracer/random/philox-inl.h"
#include "tests/server/tracer/lane_probes.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

void draw_all_uniforms(uint64_t seed, uint32_t pixel, uint32_t vertex, uint32_t purpose,
                       std::array<FloatColumn, 5>& uniforms) {
  for (size_t i = 0; i < kSlots; i += lanes()) {
    const Uints number = hn::Iota(UintTag(), static_cast<uint32_t>(i));
    const Words words = philox(set(vertex), set(purpose), number, set(pixel), seed);
    for (size_t k = 0; k < 4; ++k) store(uniform(words.w[k]), uniforms[k], i);
    store(fifth_uniform(words), uniforms[4], i);
  }
}

void probe_phase_in_lanes(const PhaseFunction& phase, PhaseProbe& probe) {
  for (size_t i = 0; i < kSlots; i += lanes()) {
    const PhaseValue at = evaluate(phase, load(probe.cosine, i));
    store(at.value, probe.value, i);
    for (size_t s = 0; s < slot_count(phase); ++s) store(at.scores[s], probe.scores[s], i);
    store(sample_cosine(phase, load(probe.u, i)), probe.drawn, i);
  }
}

Crossing crossing_of(const BoundaryProbe& probe) {
  const Vectors outwards = set(probe.outwards);
  return crossing_of(set(probe.direction), outwards, outwards,
                     hn::FirstN(FloatTag(), probe.leaving ? lanes() : 0), true, probe.asked);
}

void evaluate_boundary_in_lanes(const Boundary& boundary, BoundaryProbe& probe) {
  const Crossing at = crossing_of(probe);
  for (size_t i = 0; i < kSlots; i += lanes()) {
    const BoundaryValue light = evaluate(boundary, at, load(probe.to, i));
    store(light.value, probe.value, i);
    store(light.pdf, probe.pdf, i);
    for (size_t s = 0; s < kMaxBoundarySlots; ++s) store(light.scores[s], probe.scores[s], i);
    store(light.by_normal, probe.by_normal, i);
  }
}

void sample_boundary_in_lanes(const Boundary& boundary, uint32_t pixel, BoundaryProbe& probe) {
  const Crossing at = crossing_of(probe);
  for (size_t i = 0; i < kSlots; i += lanes()) {
    const Uints number = hn::Iota(UintTag(), static_cast<uint32_t>(i)), zero = hn::Zero(UintTag());
    const Words words = philox(zero, zero, number, set(pixel), 1);
    const BoundarySample next = sample(boundary, at, words);
    store(next.edge_weight, probe.edge_weight, i);
    store(next.direction, probe.to, i);
    store(next.weight, probe.weight, i);
    store(next.pdf, probe.pdf, i);
    for (size_t s = 0; s < kMaxBoundarySlots; ++s) store(next.scores[s], probe.scores[s], i);
    store(next.by_normal, probe.by_normal, i);
  }
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
    const LightSamples light = sample(lights, set(Vec3f{}), light_choice(words, more));
    store(light.direction, probe.direction, i);
    store(light.radiance, probe.radiance, i);
    store(light.pdf, probe.pdf, i);
  }
}

void follow_all(const Obstacles& obstacles, Rays& rays, Crossings& crossings, size_t count) {
  follow_lines(obstacles, rays, count, Report::kEnds, &crossings);
}

void look_up_all(const DepthGrid& depth_grid, const CellNormals& normals, CellProbe& probe) {
  for (size_t i = 0; i < kSlots; i += lanes()) {
    const Ints cells = cells_at(depth_grid.cells, load(probe.points, i));
    store(quantized_depth(depth_grid, cells), probe.quantized, i);
    store(cell_normal(normals, cells), probe.normals, i);
  }
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace itn::tracer {

HWY_EXPORT(draw_all_uniforms);
HWY_EXPORT(probe_phase_in_lanes);
HWY_EXPORT(evaluate_boundary_in_lanes);
HWY_EXPORT(sample_boundary_in_lanes);
HWY_EXPORT(evaluate_all);
HWY_EXPORT(draw_all);
HWY_EXPORT(look_up_all);
HWY_EXPORT(follow_all);

void draw_uniforms(uint64_t seed, uint32_t pixel, uint32_t vertex, uint32_t purpose,
                   std::array<FloatColumn, 5>& uniforms) {
  HWY_DYNAMIC_DISPATCH(draw_all_uniforms)(seed, pixel, vertex, purpose, uniforms);
}

void probe_phase(const PhaseFunction& phase, PhaseProbe& probe) {
  HWY_DYNAMIC_DISPATCH(probe_phase_in_lanes)(phase, probe);
}

void evaluate_boundary(const Boundary& boundary, BoundaryProbe& probe) {
  HWY_DYNAMIC_DISPATCH(evaluate_boundary_in_lanes)(boundary, probe);
}
void sample_boundary(const Boundary& boundary, uint32_t pixel, BoundaryProbe& probe) {
  HWY_DYNAMIC_DISPATCH(sample_boundary_in_lanes)(boundary, pixel, probe);
}

void evaluate_lights(const Lights& lights, LightProbe& probe, size_t count) {
  HWY_DYNAMIC_DISPATCH(evaluate_all)(lights, probe, count);
}

void sample_lights(const Lights& lights, uint64_t seed, LightProbe& probe, size_t count) {
  HWY_DYNAMIC_DISPATCH(draw_all)(lights, seed, probe, count);
}

void follow_to_boundary(const Obstacles& obstacles, Rays& rays, Crossings& crossings,
                        size_t count) {
  HWY_DYNAMIC_DISPATCH(follow_all)(obstacles, rays, crossings, count);
}

void look_up_cells(const DepthGrid& depth_grid, const CellNormals& normals, CellProbe& probe) {
  HWY_DYNAMIC_DISPATCH(look_up_all)(depth_grid, normals, probe);
}

}  // namespace itn::tracer
#endif
