// What a scene says of a parameter: what can be differentiated can be set, by the same name.
#pragma once

#include "server/tracer/parameters/parameter.h"
#include "server/tracer/scene/scene.h"

namespace itn::tracer {

struct ParameterValue {
  double value, low, high;  // infinite ends: a coordinate may be any number
};

// These throw Error (invalid input) where the scene has nothing of that name, as it has no
// parameter of the medium, which is part of a request.
ParameterValue value_of(const SceneDescription& scene, const Parameter& parameter);

// Sets a value as a scene file with that number has it: rounded to float. A light's scale
// multiplies what it sends out. Throws, too, where the value is out of its range.
void set_value(const Parameter& parameter, double value, SceneDescription& scene);

}  // namespace itn::tracer
