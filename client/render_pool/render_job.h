// What the pool is asked for.
#pragma once

#include <memory>
#include <string>

#include "common/scene/scene_bytes.h"
#include "itn/v1/render.pb.h"

namespace itn {

// One render. `request` has neither scene nor digest: the pool fills in what the worker needs.
struct RenderJob {
  std::shared_ptr<const SerializedScene> scene;
  v1::RenderGradRequest request;
};

// For messages: which render it is.
std::string describe(const RenderJob& job);

}  // namespace itn
