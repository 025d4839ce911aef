// A render request but for its scene: what it asks for, checked, and what that takes.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "itn/v1/render.pb.h"
#include "server/scene_compiler/derivatives.h"
#include "server/scene_compiler/scene_builder.h"
#include "server/tracer/request/request.h"

namespace itn {

struct BuiltRequest {
  tracer::RenderRequest asked;
  DerivativeWeights derivative_weights;  // of asked.derivatives
  // Values of the scene's parameters, in the order of the request.
  std::vector<std::pair<tracer::Parameter, double>> values = {};
};

// Checks the request but for its scene. Its material has the mean cosine of its phase function.
// This and the following throw Error as in common/scene/field_check.h.
BuiltRequest build_request(const v1::RenderGradRequest& request, const RenderLimits& limits);

// The pixels of the tile that is asked for, or of the film.
uint64_t pixel_count(int width, int height, const v1::RenderGradRequest& request);

// Checks the request against its scene: throws kInvalidInput if the loss's image has another size,
// kLimit if the reply to this (checked) request would not fit into a message. `gradient_numbers`:
// see tracer::gradient_numbers.
void check_reply_size(int width, int height, const v1::RenderGradRequest& request,
                      const RenderLimits& limits, uint64_t gradient_numbers = 0);

// What a render takes of memory beside its scene, known before it is allocated, in bytes: the sums,
// those of the pilot, the images that are made of them, and the reply. A little more than what is
// taken.
uint64_t film_memory(uint64_t pixels, const v1::RenderGradRequest& request,
                     const tracer::RenderRequest& asked, uint64_t gradient_numbers = 0);

}  // namespace itn
