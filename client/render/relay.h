// Passes renders on for a process that has no gRPC, through a pipe or a socket (relay.proto says
// what goes through it; relay_renderer.h is the other end).
#pragma once

#include <string>

#include "client/render/job_renderer.h"

namespace itn {

// Answers what it reads from `in` on `out`, which are file descriptors, until `in` ends and all is
// answered. When nobody reads `out` any more, it gives up what is under way, and returns. SIGPIPE
// should be ignored. A request may leave out its scene if it is that of the request before.
// `version`: of this program. Throws Error: kInvalidInput where `in` has something other than
// requests; kIo where `out` cannot be written.
void relay_renders(JobRenderer& renderer, const std::string& version, int in, int out);

}  // namespace itn
