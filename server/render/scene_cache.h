// Compiled scenes by digest, least recently used out first.
#pragma once

#include <cstdint>
#include <functional>
#include <future>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>

#include "server/tracer/scene/scene.h"

namespace itn {

// Thread-safe.
class SceneCache {
 public:
  using ScenePtr = std::shared_ptr<const tracer::Scene>;

  // Keeps scenes of about `budget` bytes together, and in any case the one used last.
  explicit SceneCache(size_t budget) : budget_(budget) {}

  // Null if the scene is not held; does not wait for one that is being built.
  ScenePtr find(const std::string& digest);

  // Builds the scene unless it is held. Callers that ask for the same scene at the same time wait
  // for one build; if it throws, all of them get the exception, and nothing is kept.
  ScenePtr get_or_build(const std::string& digest, const std::function<ScenePtr()>& build);

 private:
  struct Entry {
    std::string digest;
    std::shared_future<ScenePtr> scene;
    size_t memory = 0;  // 0 while it is being built
  };
  using Entries = std::list<Entry>;

  Entries::iterator touch(const std::string& digest);
  void forget(const std::string& digest);
  void account(const std::string& digest, size_t memory);

  const size_t budget_;
  std::mutex mutex_;
  Entries entries_;  // most recently used first
  std::unordered_map<std::string, Entries::iterator> by_digest_;
  size_t memory_ = 0;
};

}  // namespace itn
