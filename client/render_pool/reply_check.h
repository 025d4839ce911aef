// Whether a reply can be the answer to a request.
#pragma once

#include "client/render/render_job.h"
#include "itn/v1/render.pb.h"

namespace itn {

// Throws Error (kInternal) that names the field unless the reply has everything that the job asks
// for, of the right sizes, finite and in its range, for the scene's film. What is computed from a
// reply that passes needs no further checks.
void check_reply(const v1::RenderGradReply& reply, const RenderJob& job);

}  // namespace itn
