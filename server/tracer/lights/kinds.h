// The lists of lights: as they are described, and as they are rendered. A new one is a file, as
// directional.h, an entry in both, and a message in the Light of itn/v1/scene.proto.
//
// A description says
//   kName             its field in that message
//   fields(self, to)  its own fields (common/fields.h)
//   has_size()        where it may have none: whether paths meet it by chance
//   compile(frame)    what it is rendered as, in the coordinates of the object; more than one as a
//                     tuple
// What is rendered says
//   kDelta             whether no path hits it by chance
//   kDistant           whether it is infinitely far away, behind all that there is
//   power()            its radiance integrated over all directions, of what is near as it is seen
//                      from the object's middle; of a delta, its irradiance
// and computes, for many places or unit directions at a time, if it is a delta,
//   beam(kind, from)   what it sends there
// or, if it is far away,
//   emission(kind, d)  radiance, and the density per steradian with which `sample` draws d
//   sample(kind, u)    a direction towards it
//   colours(kind, d)   its radiance in red, green and blue, where it is, if that differs and it was
//                      compiled for kRgb
// and else, of a lamp that paths meet, which is black to other light and hides what is behind it,
//   look(kind, from, d)    how it is seen in that direction: see Appearance (light-inl.h)
//   draw(kind, from, u)    a direction towards it
//   redraw(kind, from, d, other)  what `draw` makes elsewhere of the numbers that make d of it here
// and of any but deltas, if its description has slots,
//   outline(kind, from, u, opposite)  a place of its outline that u draws, or the one across from
//                          it, the other of the pair
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

// Multiplies all that a light sends out.
void brighten(LightDescription& light, double by);

inline bool has_size(const LightDescription& description) {
  return std::visit(
      [](const auto& light) {
        if constexpr (requires { light.has_size(); }) return light.has_size();
        return true;
      },
      description);
}

template <typename Kind>
concept VisibleLamp = !Kind::kDelta && !Kind::kDistant;

}  // namespace itn::tracer

#endif
