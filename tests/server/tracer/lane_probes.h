// What the tracer computes many at a time, one call for each: evaluates and draws lights, looks up
// depths, by the instruction set that there is.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "server/tracer/boundary/boundary.h"
#include "server/tracer/geometry/depth_grid.h"
#include "server/tracer/geometry/obstacles.h"
#include "server/tracer/geometry/rays.h"
#include "server/tracer/lights/lights.h"
#include "server/tracer/phase/phase_function.h"
#include "server/tracer/simd/columns.h"

namespace itn::tracer {

// Sampler(seed, pixel, i).uniforms(vertex, purpose), the number u_k in column k.
void draw_uniforms(uint64_t seed, uint32_t pixel, uint32_t vertex, uint32_t purpose,
                   std::array<FloatColumn, 5>& uniforms);

// A phase function at all of `cosine`, and the cosines that all of `u` draw.
struct PhaseProbe {
  FloatColumn cosine{}, value{}, u{}, drawn{};
  FloatColumn scores[kMaxPhaseSlots];
};
void probe_phase(const PhaseFunction& phase, PhaseProbe& probe);

// A path that arrives at a boundary, and directions there: `to` is what evaluates, or what is drawn
// with the random numbers of samples 0 .. kSlots - 1 of a pixel.
struct BoundaryProbe {
  Vec3f direction, outwards;
  bool leaving = false;
  BoundaryDerivatives asked = {};
  VectorColumn to{};
  FloatColumn value{}, pdf{}, weight{}, edge_weight{};
  FloatColumn scores[kMaxBoundarySlots];
  VectorColumn by_normal{};
};
void evaluate_boundary(const Boundary& boundary, BoundaryProbe& probe);
void sample_boundary(const Boundary& boundary, uint32_t pixel, BoundaryProbe& probe);

struct LightProbe {
  FloatColumn radiance{}, pdf{};
  VectorColumn direction{};
};
// Radiance and pdf of `probe.direction`.
void evaluate_lights(const Lights& lights, LightProbe& probe, size_t count);
// Draws `count` directions (see LightSamples in lights-inl.h) with the random numbers of samples 0
// .. count-1 of pixel 0.
void sample_lights(const Lights& lights, uint64_t seed, LightProbe& probe, size_t count);

// Follows the first `count` rays to the boundary at most.
void follow_to_boundary(const Obstacles& obstacles, Rays& rays, Crossings& crossings, size_t count);

// Looks up DepthGrid::quantized and the normals nearby at all of `points`.
struct CellProbe {
  VectorColumn points{}, normals{};
  FloatColumn quantized{};
};
void look_up_cells(const DepthGrid& depth_grid, const CellNormals& normals, CellProbe& probe);

}  // namespace itn::tracer
