// What scenes are compiled into, kept by key for other scenes: objects, skies, masks, whole scenes.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <span>
#include <stop_token>
#include <string>
#include <unordered_map>

namespace itn {

// A key: a name and numbers that a part depends on.
template <typename... Numbers>
std::string part_key(std::string name, const Numbers&... numbers) {
  const auto append = [&](const auto& number) {
    name.append(reinterpret_cast<const char*>(&number), sizeof number);
  };
  (append(numbers), ...);
  return name;
}

// Least recently used out first. Thread-safe.
//
// Parts may hold other parts. Who finds such a part touches those that it holds: as they are then
// the more recently used, they outlive it here, and the sum of the sizes is what the cache holds.
//
// A part that somebody holds stays, as to forget it would free nothing: memory() is what there is,
// and exceeds the budget where parts in use do.
class PartCache {
 public:
  // Keeps parts of about `budget` bytes together, and those in use.
  explicit PartCache(size_t budget) : budget_(budget) {}

  // Builds the part unless it is held: build() makes a std::shared_ptr<const T>, whose memory() is
  // asked for once. A key belongs to one T. Those who ask for the same part at the same time wait
  // for one build. If that throws, all of them get the exception and nothing is kept; but if it
  // throws Error (cancelled), which concerns its own caller alone, the next one builds. Throws
  // Error (cancelled) when a stop is requested while waiting.
  template <typename T, typename Build>
  std::shared_ptr<const T> get(const std::string& key, const std::stop_token& stop,
                               const Build& build) {
    return std::static_pointer_cast<const T>(get_any(key, stop, [&]() -> Part {
      const std::shared_ptr<const T> part = build();
      return {part, part->memory()};
    }));
  }

  // Null if the part is not held; does not wait for one that is being built.
  template <typename T>
  std::shared_ptr<const T> find(const std::string& key) {
    return std::static_pointer_cast<const T>(find_any(key));
  }

  // Makes these recent, as if they had been found.
  void touch(std::span<const std::string> keys);

  // Forgets what does not fit into the budget and is no longer in use. To be called when a part was
  // let go.
  void trim();

  // Bytes, of all that is held.
  size_t memory() const;
  // The memory of the parts of these keys, as far as they are held.
  size_t memory(std::span<const std::string> keys) const;
  size_t budget() const { return budget_; }

 private:
  struct Part {
    std::shared_ptr<const void> value;
    size_t memory = 0;
  };
  struct Build {
    bool done = false;
    std::shared_ptr<const void> value;  // null if it was cancelled
    std::exception_ptr error;
  };
  struct Entry {
    std::string key;
    Part part;
    std::shared_ptr<Build> build;  // null when it is built
  };
  using Entries = std::list<Entry>;

  std::shared_ptr<const void> get_any(const std::string& key, const std::stop_token& stop,
                                      const std::function<Part()>& build);
  std::shared_ptr<const void> find_any(const std::string& key);
  Entries::iterator move_to_front(const std::string& key);
  void finish(const std::string& key, Part part, const std::exception_ptr& error);
  void evict();

  const size_t budget_;
  mutable std::mutex mutex_;
  std::condition_variable_any built_;
  Entries entries_;  // most recently used first
  std::unordered_map<std::string, Entries::iterator> by_key_;
  size_t memory_ = 0;
};

}  // namespace itn
