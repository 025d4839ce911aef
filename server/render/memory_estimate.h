// What a render takes of memory beside its scene, known before it is allocated.
#pragma once

#include <cstdint>

#include "itn/v1/render.pb.h"
#include "server/tracer/request/request.h"

namespace itn {

// In bytes: the sums, those of the pilot, the images that are made of them, and the reply, of a
// checked request and what it asks for. A little more than what is taken. `map_pixels`: see
// tracer::map_pixels.
uint64_t film_memory(uint64_t pixels, const v1::RenderGradRequest& request,
                     const tracer::RenderRequest& asked, uint64_t map_pixels = 0);

}  // namespace itn
