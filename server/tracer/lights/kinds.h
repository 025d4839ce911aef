// The lists of lights: as they are described, and as they are rendered. A new one is a file, as
// directional.h, an entry in both, and a message in the Light of itn/v1/scene.proto.
//
// A description says
//   kName             its field in that message
//   fields(self, to)  its own fields (common/fields.h)
//   compile(frame)    what it is rendered as, in the coordinates of the object; more than one as a
//                     tuple
// What is rendered says
//   kDelta             whether no path hits it by chance: what is a delta, and lamps, which no
//                      camera sees
//   power()            its radiance integrated over all directions; of a delta, its irradiance
// and computes, for many places or unit directions at a time, unless it is a delta,
//   emission(kind, d)  radiance, and the density per steradian with which `sample` draws d
//   sample(kind, u)    a direction towards it
// and if it is one,
//   kDistant           whether shadow rays to it leave the scene
//   beam(kind, from, u)  what it sends there, from one of its directions: their mean is all
// Who follows one path at a time has one lane.
#include <variant>

#include "server/tracer/lights/constant.h"
#include "server/tracer/lights/directional.h"
#include "server/tracer/lights/environment_map.h"
#include "server/tracer/lights/panel.h"
#include "server/tracer/lights/point.h"
#include "server/tracer/lights/sky.h"
#include "server/tracer/lights/sphere.h"
#include "server/tracer/lights/spot.h"
#include "server/tracer/lights/sun_disc.h"
#include "server/tracer/lights/sun_sky.h"

#ifndef ITN_TRACER_LIGHTS_KINDS_H_
#define ITN_TRACER_LIGHTS_KINDS_H_

namespace itn::tracer {

using LightDescription =
    std::variant<SunSkyLight, EnvironmentMapLight, ConstantLight, DirectionalLight, PointLight,
                 SpotLight, SphereLight, PanelLight>;

using LightKind = std::variant<ConstantLight, SunDisc, SkyLight, EnvironmentMap, DirectionalLight,
                               PointLight, SpotLight, SphereLight, PanelLight>;

}  // namespace itn::tracer

#endif
