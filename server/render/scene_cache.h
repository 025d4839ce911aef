// Compiled scenes by digest, and the parts that they share; least recently used out first.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>

#include "common/part_cache.h"
#include "server/tracer/scene/scene.h"

namespace itn {

// Thread-safe.
class SceneCache {
 public:
  using ScenePtr = std::shared_ptr<const tracer::Scene>;

  // Keeps scenes and parts of about `budget` bytes together, and those in use: what does not fit is
  // forgotten when the last who has it lets go of it, which must be while the cache is there.
  explicit SceneCache(size_t budget) : parts_(budget) {}

  // Null if the scene is not held; does not wait for one that is being built.
  ScenePtr find(const std::string& digest);

  // Builds the scene unless it is held (see PartCache::get for what happens to those who ask at the
  // same time).
  ScenePtr get_or_build(const std::string& digest, const std::function<ScenePtr()>& build,
                        const std::stop_token& stop = {});

  // A scene that others differ from in some numbers, before it is compiled.
  struct Described {
    tracer::SceneDescription description;  // its object is compiled, unless it has others beside it
    // Memory of all that it holds itself, be it named in the message by a word.
    size_t memory() const { return sizeof(*this) + tracer::memory_of(description); }
  };
  using DescribedPtr = std::shared_ptr<const Described>;
  // Finds a description by the digest of its scene, like the two functions above.
  DescribedPtr find_described(const std::string& digest);
  DescribedPtr get_or_describe(const std::string& digest,
                               const std::function<DescribedPtr()>& describe,
                               const std::stop_token& stop = {});

  // For scenes to be built with.
  PartCache& parts() { return parts_; }
  size_t memory() const { return parts_.memory(); }

  // How often a scene was there that was asked for, and how often one was built.
  uint64_t hits() const { return hits_; }
  uint64_t misses() const { return misses_; }

  // Bytes beyond the budget, of all that is held; and those that this scene, one of the cache,
  // would take beyond it if it were alone.
  uint64_t excess() const { return over_budget(parts_.memory()); }
  uint64_t excess_of(const tracer::Scene& scene) const;

 private:
  uint64_t over_budget(size_t bytes) const;
  ScenePtr in_use(ScenePtr held);

  PartCache parts_;
  std::atomic<uint64_t> hits_ = 0, misses_ = 0;
};

}  // namespace itn
