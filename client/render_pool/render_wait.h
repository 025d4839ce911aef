// Waiting for renders without being deaf to Ctrl-C.
#pragma once

#include <future>
#include <stop_token>

#include "itn/v1/render.pb.h"

namespace itn {

// The reply; throws Error (kCancelled) within a tenth of a second after a stop is requested, and
// what the future throws.
v1::RenderGradReply wait_for_render(std::future<v1::RenderGradReply>& future,
                                    const std::stop_token& stop);

}  // namespace itn
