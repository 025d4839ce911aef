// Makes the reply of the render service from what the tracer accumulated.
#pragma once

#include "itn/v1/render.pb.h"
#include "server/scene_compiler/derivatives.h"
#include "server/tracer/render.h"

namespace itn {

// The reply to `request`: a loss and its gradient if the request asks for one, else images. Throws
// Error (invalid input) if the loss compares with an image that is black wherever it has a weight.
// `derivative_weights` are those that build_request made of the same request.
v1::RenderGradReply make_reply(const tracer::FilmSums& sums, const v1::RenderGradRequest& request,
                               const DerivativeWeights& derivative_weights);

}  // namespace itn
