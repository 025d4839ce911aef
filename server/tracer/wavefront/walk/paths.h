// What is known of the paths under way and of their shadow rays, a slot each (columns.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <tuple>
#include <vector>

#include "server/tracer/collected/state_columns.h"
#include "server/tracer/geometry/rays.h"
#include "server/tracer/simd/columns.h"

namespace itn::tracer {

// What a path takes along from vertex to vertex, but for its ray.
struct PathState {
  // Which sample it is: see PathSample.
  UintState<> pixel{}, sample{};
  FloatState<> expected{};
  FloatState<> first_flight{};  // the random number of the first flight

  UintState<1> vertex{};  // that is next, the camera being vertex 0
  UintState<1> alive{};
  UintState<> hit{}, leaked{}, steps{};  // see PathEstimate
  // Whether no shadow ray looks for the light ahead too: on the camera's ray, and behind a boundary
  // that is a delta; kFound where one has found all of it already. How many boundaries at which
  // lines stop were crossed in a row.
  static constexpr uint32_t kFound = 2;
  UintState<1> delta_bounce{};
  UintState<> crossings{};
  FloatState<> pdf{};   // per steradian, of the last direction
  UintStates medium{};  // where there are several: see Wavefront::medium
  // What refracted shadow rays need (refracted_rays-inl.h): x, y and z of the last scattering;
  // `pdf` if that was the last vertex, or 0; and the odds for light ahead if that was a crossing,
  // or 0.
  FloatStates<> scattered_at{}, scattered_pdf{}, odds{};

  // The weight W, and what was collected so far.
  FloatState<1> weight{};
  FloatState<> radiance{};

  // For derivatives in the boundary's index or normals: W times what edges weigh that the path has
  // followed, which make W 0 (BoundaryEdge).
  FloatStates<> edge_weight{};

  // The list of all columns: what moves a path, and begins one, goes through it.
  auto columns() {
    return std::tie(pixel, sample, expected, first_flight, vertex, alive, hit, leaked, steps,
                    delta_bounce, crossings, pdf, medium, scattered_at, scattered_pdf, odds, weight,
                    radiance, edge_weight);
  }
  // Columns that a factor of the path's weight multiplies.
  auto weights() { return std::tie(weight, edge_weight); }
};

// The list is complete: its columns fill the structure.
template <typename... Entries>
constexpr size_t size_of_all(std::tuple<Entries&...>* /*type*/) {
  return (sizeof(Entries) + ...);
}
static_assert(size_of_all(static_cast<decltype(PathState().columns())*>(nullptr)) ==
                  sizeof(PathState),
              "PathState::columns() leaves out a member");

// The paths under way.
struct Paths : PathState {
  Rays rays;                     // of the flight
  VectorColumn flight_from;      // where it began, if lamps may end it
  FloatColumn u1{}, u2{}, u3{};  // random numbers of the vertex
  // What the boundary multiplies the path's weight by, once the vertex's shadow rays are traced.
  FloatColumn crossing_weight{};
  std::vector<FloatColumn> crossing_edge_weight;  // and what it adds to `edge_weight`, by W

  void move(size_t from, size_t to) {
    rays.position.set(to, rays.position.at(from));
    rays.direction.set(to, rays.direction.at(from));
    rays.interaction[to] = rays.interaction[from];
    rays.normal.set(to, rays.normal.at(from));
    move_columns(columns(), from, to);
  }

  // All but the ray and the sample.
  void begin(size_t slot) { begin_columns(columns(), slot); }
};

// The shadow rays that survived their roulette.
struct ShadowRays {
  Rays rays;
  UintColumn slot{};  // of the path
  // Light that would arrive undimmed, scattered and weighted: without the path's weight, and with
  // the importance of the path.
  FloatColumn light{}, importance{};
  std::vector<FloatColumn> scores;        // of the path, with that of the turn to the light
  UintColumn source{};                    // of `light`, if parts of it count: see LightParts
  std::vector<FloatColumn> per_radiance;  // `light` by radiance, for a gradient in a panorama
  FloatColumn length_before{};            // in the medium, of those that come through the boundary
  // Scores of rays that come from the boundary, for a gradient in normals: see NormalScore.
  VectorColumn normal_score;
  UintColumn triangle{};
  size_t count = 0;
};

// Shadow rays on their way to the boundary (refracted_rays-inl.h), and rays that search for a facet
// of it.
struct RefractedRays {
  Rays rays;
  UintColumn slot{};         // of the path
  FloatColumn phase{};       // value of the phase function for the direction,
  FloatColumn pdf{};         // with which that was drawn, per steradian
  FloatColumn importance{};  // of the path
  // The light: see LightSamples; and, where there are lamps, how it was drawn: see LightChoice.
  VectorColumn to_light;
  FloatColumn radiance{}, light_pdf{};
  FloatColumn choice{}, u0{}, u1{};
  // Scores of the path, with that of the direction, unless it is a search for a facet.
  std::vector<FloatColumn> scores;
  UintColumn source{};  // of the light, as of ShadowRays
  // Columns of searches for a facet: where they begin, in which direction the path came there, what
  // they are for (Target::place and Target::lamp), and how far the ray may go that is aimed at what
  // they find, in mm.
  VectorColumn origin, before, target;
  UintColumn lamp{};
  FloatColumn limit{};
  UintColumn facet{};  // that rays are aimed at which were aimed again
  size_t count = 0;
};

// Rays that find out whether a refracted one would have gone where a walk did.
struct OddsRays {
  Rays rays;
  UintColumn slot{};            // of the path
  FloatColumn odds{};           // if one would have
  VectorColumn origin, target;  // these and `lamp` are like those of RefractedRays
  UintColumn lamp{};
  // Where the boundary is smooth: by which facet the walk left the medium, and where, from
  // `origin`.
  UintColumn facet{};
  VectorColumn exit_place;
  // Where it is nearly smooth: in which direction it came there, and the shadow ray that is sent
  // from there.
  VectorColumn exit_direction;
  UintColumn shadow_ray{};
  size_t count = 0;
};

}  // namespace itn::tracer
