// The list of lights as they are rendered. A kind is a file, as sun_disc.h, and an entry here. It
// says
//   kDelta             whether no direction hits it by chance
//   power()            its radiance integrated over all directions; of a delta, its irradiance
// and computes, for many unit directions at a time,
//   emission(kind, d)  radiance, and the density per steradian with which `sample` draws d; not of
//                      a delta
//   sample(kind, u)    a direction towards it; not of a delta, which has its `direction`
// Who follows one path at a time has one lane.
#include <variant>

#include "server/tracer/lights/constant.h"
#include "server/tracer/lights/directional.h"
#include "server/tracer/lights/environment_map.h"
#include "server/tracer/lights/sky.h"
#include "server/tracer/lights/sun_disc.h"

#ifndef ITN_TRACER_LIGHTS_KINDS_H_
#define ITN_TRACER_LIGHTS_KINDS_H_

namespace itn::tracer {

using LightKind = std::variant<ConstantLight, SunDisc, SkyLight, EnvironmentMap, DirectionalLight>;

}  // namespace itn::tracer

#endif
