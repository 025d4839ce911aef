// Lights of a scene off the wire.
#pragma once

#include <string>

#include "itn/v1/scene.pb.h"
#include "server/tracer/scene/scene.h"

namespace itn {

// Throws Error as in common/scene/field_check.h; environment maps with a `path` are refused.
tracer::LightDescription build_light(const std::string& field, const v1::Light& proto);

}  // namespace itn
