// What a JobRenderer is asked for.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "common/scene/scene_bytes.h"
#include "itn/v1/render.pb.h"

namespace itn {

// One render. `request` has neither scene nor digest, which are filled in where they are needed.
struct RenderJob {
  std::shared_ptr<const SerializedScene> scene;
  v1::RenderGradRequest request;
};

// Sets a number of the scene or the medium (RenderGradRequest.values).
void set_value(v1::RenderGradRequest& request, const std::string& name, double value);

// For messages: which render it is.
std::string describe(const RenderJob& job);

}  // namespace itn
