// A render request but for its scene: what it asks for, checked.
#pragma once

#include <cstdint>

#include "itn/v1/render.pb.h"
#include "server/render/scene_builder.h"
#include "server/tracer/request/request.h"

namespace itn {

// Checks the request but for its scene. Its material has the mean cosine of its phase function.
// This and the following throw Error as in common/scene/field_check.h.
tracer::RenderRequest build_request(const v1::RenderGradRequest& request,
                                    const RenderLimits& limits);

Material build_material(const v1::Material& material);

// Of the tile that is asked for, or of the film.
uint64_t pixel_count(int width, int height, const v1::RenderGradRequest& request);

// Checks the request against its scene: throws kInvalidInput if the loss's image has another size,
// kLimit if the reply to this (checked) request would not fit into a message. `map_pixels`: see
// tracer::map_pixels.
void check_reply_size(int width, int height, const v1::RenderGradRequest& request,
                      const RenderLimits& limits, uint64_t map_pixels = 0);

}  // namespace itn
