// How much light sun and sky give, without tracing any.
#pragma once

#include "server/tracer/lights/sun_sky.h"

namespace itn::tracer {

// On a surface that faces up, of what stands above the horizon, in W/m^2; the ground adds nothing.
// Within a thousandth of what the tracer shows. Numbers in the ranges of SunSkyLight.
double irradiance_from_above(const SunSkyLight& light, Channel channel);

}  // namespace itn::tracer
