#include "server/render/scene_cache.h"

#include <algorithm>
#include <utility>

namespace itn {
namespace {

std::string key_of(const std::string& digest) {
  return "scene" + digest;
}

}  // namespace

SceneCache::ScenePtr SceneCache::find(const std::string& digest) {
  ScenePtr scene = in_use(parts_.find<tracer::Scene>(key_of(digest)));
  if (scene) ++hits_;
  return scene;
}

SceneCache::ScenePtr SceneCache::get_or_build(const std::string& digest,
                                              const std::function<ScenePtr()>& build,
                                              const std::stop_token& stop) {
  bool built = false;
  const auto noted_build = [&] {
    ScenePtr scene = build();
    built = true;
    return scene;
  };
  try {
    ScenePtr scene = in_use(parts_.get<tracer::Scene>(key_of(digest), stop, noted_build));
    ++(built ? misses_ : hits_);
    return scene;
  } catch (...) {
    parts_.trim();  // of the parts that were finished
    throw;
  }
}

SceneCache::DescribedPtr SceneCache::find_described(const std::string& digest) {
  DescribedPtr described = parts_.find<Described>("described" + digest);
  if (described) parts_.touch(std::span(&described->description.object_key, 1));
  return described;
}

SceneCache::DescribedPtr SceneCache::get_or_describe(const std::string& digest,
                                                     const std::function<DescribedPtr()>& describe,
                                                     const std::stop_token& stop) {
  return parts_.get<Described>("described" + digest, stop, describe);
}

uint64_t SceneCache::excess_of(const tracer::Scene& scene) const {
  return over_budget(scene.memory() + parts_.memory(scene.part_keys()));
}

uint64_t SceneCache::over_budget(size_t bytes) const {
  return bytes - std::min(bytes, parts_.budget());
}

// For a caller, who has the cache trimmed when he lets go of it.
SceneCache::ScenePtr SceneCache::in_use(ScenePtr held) {
  if (!held) return nullptr;
  parts_.touch(held->part_keys());
  const tracer::Scene* const scene = held.get();
  return {scene, [this, held = std::move(held)](const tracer::Scene*) mutable {
            held.reset();
            parts_.trim();
          }};
}

}  // namespace itn
