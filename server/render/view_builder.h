// Camera and film of a scene off the wire.
#pragma once

#include <cstdint>

#include "itn/v1/scene.pb.h"
#include "server/tracer/scene/scene.h"

namespace itn {

// Both throw Error as in common/scene/field_check.h.
tracer::CameraDescription build_camera(const v1::Camera& proto);
tracer::FilmDescription build_film(const v1::Film& proto, uint64_t max_pixels);

}  // namespace itn
