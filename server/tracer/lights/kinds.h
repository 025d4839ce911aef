// The lists of lights: as they are described, and as they are rendered. A new one is a file, as
// directional.h, an entry in both, and a message in the Light of itn/v1/scene.proto.
//
// A description has what DescribedLight lists, its fields (common/fields.h), and has_size(), where
// it may have none: whether paths meet it by chance. What is rendered has what RenderedLight lists,
// and computes what LightMaths (lights-inl.h) does.
#include <concepts>
#include <string_view>
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

using LightKind = std::variant<ConstantLight, SunDisc, SkyLight, EnvironmentMap, ParallelLight,
                               PointLamp, SpotLamp, SphereLamp, PanelLamp>;

// Multiplies all that a light sends out.
void brighten(LightDescription& light, double by);

template <typename Light>
concept DescribedLight = requires(const Light& light, const LightFrame& frame) {
  // Its field in the message.
  { Light::kName } -> std::convertible_to<std::string_view>;
  // What it is rendered as, in the coordinates of the object; more than one as a tuple.
  light.compile(frame);
};

template <typename Kind>
concept RenderedLight = requires(const Kind& kind) {
  // Whether no path hits it by chance.
  { Kind::kDelta } -> std::same_as<const bool&>;
  // Whether it is infinitely far away, behind all that there is.
  { Kind::kDistant } -> std::same_as<const bool&>;
  // Its radiance integrated over all directions, of what is near as it is seen from the object's
  // middle; of a delta, its irradiance.
  { kind.power() } -> std::same_as<double>;
};

inline bool has_size(const LightDescription& description) {
  return std::visit(
      [](const DescribedLight auto& light) {
        if constexpr (requires { light.has_size(); }) return light.has_size();
        return true;
      },
      description);
}

template <typename Kind>
concept VisibleLamp = !Kind::kDelta && !Kind::kDistant;

}  // namespace itn::tracer

#endif
