// What a render becomes on the wire.
#pragma once

#include "itn/v1/render.pb.h"
#include "server/scene_compiler/derivatives.h"
#include "server/tracer/render.h"

namespace itn {

// The reply to `request`: images, or a loss if it asks for one. A loss throws Error (invalid input)
// where its image is black. The weights are those of build_request.
v1::RenderGradReply make_reply(const tracer::FilmSums& sums, const v1::RenderGradRequest& request,
                               const DerivativeWeights& derivative_weights);

}  // namespace itn
