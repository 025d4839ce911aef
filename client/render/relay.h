// Passes renders on for a process that has no gRPC, through a pipe or a socket (relay.proto says
// what goes through it; relay_renderer.h is the other end).
#pragma once

#include <string>

#include "client/render/job_renderer.h"

namespace itn {

// Answers what it reads from `in` on `out`, which are file descriptors, until `in` ends; renders
// that are under way then are given up. SIGPIPE should be ignored. A request may leave out its
// scene if it is that of the request before. `version`: of this program. Throws Error (invalid
// input) where `in` has something other than requests.
void relay_renders(JobRenderer& renderer, const std::string& version, int in, int out);

}  // namespace itn
