// A render request but for its scene: what it asks for, checked.
#pragma once

#include "itn/v1/render.pb.h"
#include "server/render/scene_builder.h"
#include "server/tracer/render.h"

namespace itn {

inline constexpr uint32_t kMaxEstimates = 16;

// Checks the request but for its scene. `threads` is left at its default. This and the following
// throw Error as in field_check.h.
tracer::RenderSettings build_settings(const v1::RenderGradRequest& request,
                                      const RenderLimits& limits);

Material build_material(const v1::Material& material);

// Checks the request against its scene: throws kInvalidInput if the loss's image has another size,
// kLimit if the reply to this (checked) request would not fit into a message.
void check_reply_size(int width, int height, const v1::RenderGradRequest& request,
                      const RenderLimits& limits);

}  // namespace itn
