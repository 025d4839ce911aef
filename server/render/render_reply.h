// What a render becomes on the wire.
#pragma once

#include "itn/v1/render.pb.h"
#include "server/tracer/render.h"

namespace itn {

// The reply to `request`, of the material that build_request makes of it: images, or a loss if it
// asks for one. A loss needs the derivatives, throws Error (invalid input) where its image is
// black.
v1::RenderGradReply make_reply(const tracer::FilmSums& sums, const v1::RenderGradRequest& request,
                               const Material& material);

}  // namespace itn
