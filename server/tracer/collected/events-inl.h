// What kinds of this folder are told of paths.
#if defined(ITN_TRACER_COLLECTED_EVENTS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_EVENTS_INL_H_
#undef ITN_TRACER_COLLECTED_EVENTS_INL_H_
#else
#define ITN_TRACER_COLLECTED_EVENTS_INL_H_
#endif

#include <cstddef>
#include <vector>

#include "server/tracer/collected/media-inl.h"
#include "server/tracer/collected/state_columns.h"
#include "server/tracer/collected/vertices-inl.h"
#include "server/tracer/film/film_writer.h"
#include "server/tracer/request/request.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Paths in slots i, i + 1 ... have flown.
struct Flight {
  size_t i;
  Mask scattered;  // whether the flight ended in a scattering
  Floats length;   // inside the medium, in mm
  const Media& media;
  Uints medium;
  Floats weight;  // W
};

// Paths in slots i, i + 1 ... are at their vertices, and their weights have not taken the factors
// of these.
struct AtVertex {
  size_t i;
  const Vertices& vertices;
  Vectors position;
  Floats weight;   // W
  Mask by_albedo;  // whether the factor is the albedo of the object's medium
};

// The parts of light that are due to the lights of LightScales; or, if colours are rendered, what
// it is in each. As multiples of it.
struct LightParts {
  Floats of[kMaxDerivatives];
};

// The scores of whole paths: see Scores.
struct PathScores {
  Floats of[kMaxPhaseSlots + kMaxBoundarySlots];
};

// Light arrives along the paths in some slots; none where a lane is not meant.
struct Light {
  SlotGather at;
  Floats by_weight;     // the light that a W of 1 would bring
  Floats contribution;  // what W brings
  Floats length;        // in the object's medium, in mm, since the last vertex
  const LightParts& parts;
  const PathScores& scores;
  Floats by_edges;  // what edges bring that the paths have followed; 0 where none are
};

// Which of the request's derivatives are of a kind.
inline std::vector<size_t> derivatives_of(const RenderRequest& request, Parameter::Kind kind) {
  std::vector<size_t> numbers;
  for (size_t d = 0; d < request.derivatives.size(); ++d) {
    if (request.derivatives[d].kind == kind) numbers.push_back(d);
  }
  return numbers;
}

// Writes what the path in a slot has collected: a column for each of the request's derivatives with
// these numbers.
inline void record_derivatives(const std::vector<size_t>& derivatives,
                               const FloatStates<>& collected, size_t slot,
                               PathEstimate& estimate) {
  for (size_t k = 0; k < derivatives.size(); ++k) {
    estimate.derivatives[derivatives[k]] = collected[k][slot];
  }
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
