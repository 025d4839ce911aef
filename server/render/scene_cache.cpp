#include "server/render/scene_cache.h"

namespace itn {
namespace {

std::string key_of(const std::string& digest) {
  return "scene" + digest;
}

}  // namespace

SceneCache::ScenePtr SceneCache::find(const std::string& digest) {
  ScenePtr scene = parts_.find<tracer::Scene>(key_of(digest));
  if (scene) parts_.touch(scene->part_keys());
  return scene;
}

SceneCache::ScenePtr SceneCache::get_or_build(const std::string& digest,
                                              const std::function<ScenePtr()>& build,
                                              const std::stop_token& stop) {
  ScenePtr scene = parts_.get<tracer::Scene>(key_of(digest), stop, build);
  parts_.touch(scene->part_keys());
  return scene;
}

}  // namespace itn
