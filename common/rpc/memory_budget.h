// What the calls of a server may take of its memory together.
#pragma once

#include <cstdint>
#include <mutex>

namespace itn {

// Thread-safe.
class MemoryBudget {
 public:
  // 0: no limit.
  explicit MemoryBudget(uint64_t bytes) : total_(bytes) {}

  // What one call has of it; gives it back when it goes out of scope. Used by one thread at a time.
  class Share {
   public:
    explicit Share(MemoryBudget& budget) : budget_(budget) {}
    ~Share() { resize(0); }
    Share(const Share&) = delete;
    Share& operator=(const Share&) = delete;

    // Before memory is allocated. Throws Error (kLimit) if so many bytes are more than the whole
    // budget, StatusError (busy) if they are more than others leave of it; then the share stays as
    // it was. Less is always to be had.
    void resize(uint64_t bytes);

    uint64_t bytes() const { return bytes_; }

   private:
    MemoryBudget& budget_;
    uint64_t bytes_ = 0;
  };

  uint64_t used() const;

 private:
  const uint64_t total_;
  mutable std::mutex mutex_;
  uint64_t used_ = 0;
};

}  // namespace itn
