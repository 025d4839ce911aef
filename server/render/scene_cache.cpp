#include "server/render/scene_cache.h"

namespace itn {

SceneCache::ScenePtr SceneCache::find(const std::string& digest) {
  const std::lock_guard lock(mutex_);
  const auto entry = touch(digest);
  if (entry == entries_.end() || entry->memory == 0) return nullptr;
  return entry->scene.get();
}

SceneCache::ScenePtr SceneCache::get_or_build(const std::string& digest,
                                              const std::function<ScenePtr()>& build) {
  std::promise<ScenePtr> promise;
  {
    std::unique_lock lock(mutex_);
    if (const auto entry = touch(digest); entry != entries_.end()) {
      const auto scene = entry->scene;
      lock.unlock();
      return scene.get();
    }
    entries_.push_front({digest, promise.get_future().share(), 0});
    by_digest_[digest] = entries_.begin();
  }
  try {
    const ScenePtr scene = build();
    promise.set_value(scene);
    account(digest, scene->memory());
    return scene;
  } catch (...) {
    forget(digest);
    promise.set_exception(std::current_exception());
    throw;
  }
}

// Moves the entry to the front. Requires the lock.
SceneCache::Entries::iterator SceneCache::touch(const std::string& digest) {
  const auto found = by_digest_.find(digest);
  if (found == by_digest_.end()) return entries_.end();
  entries_.splice(entries_.begin(), entries_, found->second);
  return entries_.begin();
}

void SceneCache::forget(const std::string& digest) {
  const std::lock_guard lock(mutex_);
  const auto found = by_digest_.find(digest);
  entries_.erase(found->second);
  by_digest_.erase(found);
}

void SceneCache::account(const std::string& digest, size_t memory) {
  const std::lock_guard lock(mutex_);
  const auto added = by_digest_.at(digest);
  added->memory = memory + 1;  // 0 says that it is being built
  memory_ += added->memory;
  // Entries that are being built have no size yet and stay.
  for (auto entry = entries_.end(); memory_ > budget_ && entry != entries_.begin();) {
    --entry;
    if (entry == added || entry->memory == 0) continue;
    memory_ -= entry->memory;
    by_digest_.erase(entry->digest);
    entry = entries_.erase(entry);
  }
}

}  // namespace itn
