#include "server/tracer/simd/targets.h"
// After targets.h:
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/tracer/geometry/lines/follow.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h:
#include <hwy/highway.h>

#include "server/tracer/geometry/lines/follow-inl.h"
#include "server/tracer/geometry/lines/follow.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

void follow_lines(const Obstacles& obstacles, Rays& rays, size_t count, Report report,
                  Crossings* at_boundary) {
  if (at_boundary == nullptr) {
    LineFollower<PassBoundary>(obstacles, rays, count, report, nullptr).run();
  } else {
    LineFollower<StopAtBoundary>(obstacles, rays, count, report, at_boundary).run();
  }
}

void follow_rays(const Obstacles& obstacles, Rays& rays, size_t count) {
  follow_lines(obstacles, rays, count, Report::kEnds, nullptr);
}

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace itn::tracer {

HWY_EXPORT(follow_rays);

void follow(const Obstacles& obstacles, Rays& rays, size_t count) {
  HWY_DYNAMIC_DISPATCH(follow_rays)(obstacles, rays, count);
}

}  // namespace itn::tracer
#endif
