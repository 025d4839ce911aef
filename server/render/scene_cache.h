// Compiled scenes by digest, and the parts that they share; least recently used out first.
#pragma once

#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include "server/tracer/scene/part_cache.h"
#include "server/tracer/scene/scene.h"

namespace itn {

// Thread-safe.
class SceneCache {
 public:
  using ScenePtr = std::shared_ptr<const tracer::Scene>;

  // Keeps scenes and parts of about `budget` bytes together, and in any case the one used last.
  explicit SceneCache(size_t budget) : parts_(budget) {}

  // Null if the scene is not held; does not wait for one that is being built.
  ScenePtr find(const std::string& digest);

  // Builds the scene unless it is held (see PartCache::get for what happens to those who ask at the
  // same time).
  ScenePtr get_or_build(const std::string& digest, const std::function<ScenePtr()>& build,
                        const std::stop_token& stop = {});

  // For scenes to be built with.
  tracer::PartCache& parts() { return parts_; }
  size_t memory() const { return parts_.memory(); }

 private:
  tracer::PartCache parts_;
};

}  // namespace itn
