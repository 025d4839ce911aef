// What a render becomes on the wire, and back. Used by workers, and by clients that put parts of a
// sample range together, so that both give the same bytes.
#pragma once

#include "itn/v1/render.pb.h"
#include "server/tracer/render.h"

namespace itn {

// The reply to `request`: images, or exact sums or a loss if it asks for them. A loss needs the
// derivatives, throws Error (invalid input) where its image is black.
v1::RenderGradReply make_reply(const tracer::FilmSums& sums, const v1::RenderGradRequest& request);

// Of a reply with exact sums. Throws Error (kInternal) if its arrays do not have the sizes that
// they should.
tracer::FilmSums film_sums(const v1::RenderGradReply& reply);

// Throws Error (kInternal) unless the reply has all the images that `request` asked for, in full,
// or the sums of all estimates (film_sums checks the rest of them).
void check_reply(const v1::RenderGradReply& reply, const v1::RenderGradRequest& request);

}  // namespace itn
