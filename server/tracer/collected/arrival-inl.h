// What kinds of this folder are told where paths arrive.
#if defined(ITN_TRACER_COLLECTED_ARRIVAL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_COLLECTED_ARRIVAL_INL_H_
#undef ITN_TRACER_COLLECTED_ARRIVAL_INL_H_
#else
#define ITN_TRACER_COLLECTED_ARRIVAL_INL_H_
#endif

#include <cstddef>

#include "server/tracer/wavefront/walk/vertices-inl.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Paths in slots i, i + 1 ... at their vertices, before their weights take the vertices' factors.
struct Arrival {
  size_t i;
  const Vertices& vertices;
  Vectors position;
  Floats weight;   // W
  Mask by_albedo;  // whether the factor is the albedo of the object's medium
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
