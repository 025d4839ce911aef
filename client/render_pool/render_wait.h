// Waiting for renders without being deaf to Ctrl-C.
#pragma once

#include <future>
#include <stop_token>
#include <string>
#include <vector>

#include "itn/v1/render.pb.h"

namespace itn {

// The reply; throws Error (kCancelled) within a tenth of a second after a stop is requested, and
// what the future throws.
v1::RenderGradReply wait_for_render(std::future<v1::RenderGradReply>& future, std::stop_token stop);

// A plane of a reply (float32, little-endian). Throws Error (internal) if its size is not `count`.
std::vector<float> plane(const std::string& bytes, size_t count);

}  // namespace itn
