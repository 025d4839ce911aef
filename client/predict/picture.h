// What a network saw of a photograph, as panels for people to look at.
#pragma once

#include <span>
#include <vector>

#include "client/panels.h"
#include "client/predict/photograph_input.h"

namespace itn {

// Each of the framed photograph's side:
//   photograph  in colour if it has three channels; white is the 99th percentile on the object
//   mask        the same, darker outside of the object, whose outline is orange
//   weight map  common/learning/weight_map.h, of the luminance: black 0, red, yellow, white 1
PanelRow network_view_panels(const PredictInput& photograph);

// Beside them, for an image of the object alone (channels interleaved, of the photograph's size) by
// a renderer:
//   re-rendering  on the scale of the photograph's panel
//   difference    diverging(), of the luminance, times the mask: red where the re-rendering is
//                 brighter than the photograph, which counts as black where the mask is 0
// The re-rendering is radiance, as is the photograph times its exposure, or as it is if none was
// said. Of one whose exposure was not said, and which was encoded for a screen or has a gray card,
// the scale is unknown: then the re-rendering is brought to its mean over the object.
PanelRow rerendered_panels(const PredictInput& photograph, std::span<const float> rendered);

}  // namespace itn
