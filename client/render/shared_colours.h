// Images in colour from one render, whose colours share their paths, instead of three.
#pragma once

#include <span>

#include "common/material.h"
#include "itn/v1/render.pb.h"

namespace itn {

// Whether that costs less, at equal noise, of a medium in an object whose longest side has this
// length, in mm.
bool shared_paths_pay(std::span<const Material> colours, double longest_side);

// What a render of one of the colours would have answered. Its counters are those of all.
v1::RenderGradReply reply_in_colour(const v1::RenderGradReply& reply, int colour);

}  // namespace itn
