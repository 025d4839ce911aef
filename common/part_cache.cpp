#include "common/part_cache.h"

#include <utility>

#include "common/error.h"

namespace itn {
namespace {

// What an entry takes beside its part: the key twice, the nodes of a list and of a table.
constexpr size_t kEntryOverhead = 256;

bool is_cancelled(const std::exception_ptr& error) {
  try {
    std::rethrow_exception(error);
  } catch (const Error& e) {
    return e.kind() == ErrorKind::kCancelled;
  } catch (...) {
    return false;
  }
}

}  // namespace

std::shared_ptr<const void> PartCache::get_any(const std::string& key, const std::stop_token& stop,
                                               const std::function<Part()>& build) {
  {
    std::unique_lock lock(mutex_);
    for (auto entry = move_to_front(key); entry != entries_.end(); entry = move_to_front(key)) {
      const std::shared_ptr<Build> under_way = entry->build;
      if (!under_way) return entry->part.value;
      if (!built_.wait(lock, stop, [&] { return under_way->done; })) {
        throw Error(ErrorKind::kCancelled, "stopped while a part of the scene was being compiled");
      }
      if (under_way->error) std::rethrow_exception(under_way->error);
      if (under_way->value) return under_way->value;
    }
    Entries added;  // in both tables, or, where there is no memory for it, in none
    added.push_front({key, {}, std::make_shared<Build>()});
    by_key_.emplace(key, added.begin());
    entries_.splice(entries_.begin(), added);
  }
  try {
    Part part = build();
    finish(key, part, nullptr);
    return part.value;
  } catch (...) {
    finish(key, {}, std::current_exception());
    throw;
  }
}

std::shared_ptr<const void> PartCache::find_any(const std::string& key) {
  const std::lock_guard lock(mutex_);
  const auto entry = move_to_front(key);
  return entry == entries_.end() ? nullptr : entry->part.value;
}

void PartCache::touch(std::span<const std::string> keys) {
  const std::lock_guard lock(mutex_);
  for (const std::string& key : keys) move_to_front(key);
}

void PartCache::trim() {
  const std::lock_guard lock(mutex_);
  evict();
}

size_t PartCache::memory() const {
  const std::lock_guard lock(mutex_);
  return memory_;
}

size_t PartCache::memory(std::span<const std::string> keys) const {
  const std::lock_guard lock(mutex_);
  size_t sum = 0;
  for (const std::string& key : keys) {
    const auto found = by_key_.find(key);
    sum += found == by_key_.end() ? 0 : found->second->part.memory;
  }
  return sum;
}

// Requires the lock.
PartCache::Entries::iterator PartCache::move_to_front(const std::string& key) {
  const auto found = by_key_.find(key);
  if (found == by_key_.end()) return entries_.end();
  entries_.splice(entries_.begin(), entries_, found->second);
  return entries_.begin();
}

// Tells those who wait what has become of the part, and keeps it.
void PartCache::finish(const std::string& key, Part part, const std::exception_ptr& error) {
  const std::lock_guard lock(mutex_);
  const auto entry = by_key_.at(key);
  Build& build = *entry->build;
  build.done = true;
  build.value = part.value;
  if (error && !is_cancelled(error)) build.error = error;
  built_.notify_all();
  if (error) {
    by_key_.erase(key);
    entries_.erase(entry);
    return;
  }
  part.memory += 2 * key.size() + kEntryOverhead;
  memory_ += part.memory;
  entry->part = std::move(part);
  entry->build = nullptr;
  evict();
}

// Requires the lock. Entries that are being built have no size yet and stay. What held a part goes
// before it, as it is the less recently used: then the part is free, too.
void PartCache::evict() {
  for (auto entry = entries_.end(); memory_ > budget_ && entry != entries_.begin();) {
    --entry;
    const bool in_use = entry->part.value.use_count() > 1;
    if (entry->build || in_use) continue;
    memory_ -= entry->part.memory;
    by_key_.erase(entry->key);
    entry = entries_.erase(entry);
  }
}

}  // namespace itn
