// Lights that are far away as one panorama in the layout of Mitsuba's: latitude and longitude, as
// EnvironmentMap in scene.proto, but with its first row of pixels at +y and its last one at -y.
#pragma once

#include <vector>

#include "server/tracer/colour/channel.h"
#include "server/tracer/lights/kinds.h"

namespace itn {

struct Panorama {
  int width = 0, height = 0;  // in pixels
  std::vector<float> rgb;     // of each pixel, top row first; radiance in W/(m^2 sr)
  // Fewer columns than a map of the lights has.
  bool loses_detail = false;
};

// Whether a light is far away and of some size, so that it has a place in a panorama.
bool is_panoramic(const tracer::LightDescription& light);

// The sum of lights that are panoramic, of these colours (see tracer::Lights), for a film of this
// channel; gray unless that is kRgb. Pixels are means, three of them lie on the radius of the
// smallest sun, if 4096 columns allow for it.
Panorama panorama_of(const std::vector<tracer::LightDescription>& lights,
                     const std::vector<tracer::Rgb>& colours, tracer::Channel channel);

// A map in its own orientation, without its scale: with further rows, so that it is interpolated to
// the same; one of more than 4096 rows between its rows.
Panorama panorama_of(const tracer::EnvironmentMapLight& map);

}  // namespace itn
