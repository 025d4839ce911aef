// How many derivatives a request asks for, and how many images of them are answered.
#pragma once

#include <algorithm>
#include <cstdint>

#include "itn/v1/render.pb.h"

namespace itn {

inline int derivative_count(const v1::RenderGradRequest& request) {
  return request.derivatives_size() + request.scene_derivatives_size() + request.parameters_size();
}

// A request of a loss or of a gradient is answered with numbers instead.
inline uint64_t derivative_images(const v1::RenderGradRequest& request) {
  const int images = request.has_loss() || request.has_gradient() ? 0 : derivative_count(request);
  return static_cast<uint64_t>(images) * std::max(request.colours_size(), 1);
}

}  // namespace itn
