// What the calls of a server may take of its memory together.
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <utility>

namespace itn {

// Thread-safe.
class MemoryBudget {
 public:
  struct Hooks {
    // What is taken of it but by no call alone.
    std::function<uint64_t()> beside = [] { return 0; };
    // When some of it is expected to be given back, in seconds from now.
    std::function<double()> retry_after = [] { return 1; };
  };

  // 0: no limit.
  explicit MemoryBudget(uint64_t bytes) : MemoryBudget(bytes, {}) {}
  MemoryBudget(uint64_t bytes, Hooks hooks) : total_(bytes), hooks_(std::move(hooks)) {}

  // What one call has of it; gives it back when it goes out of scope. Used by one thread at a time.
  class Share {
   public:
    explicit Share(MemoryBudget& budget) : budget_(budget) {}
    ~Share();
    Share(const Share&) = delete;
    Share& operator=(const Share&) = delete;

    // Before memory is allocated. Throws Error (kLimit) if so many bytes are more than the whole
    // budget, StatusError (busy) if they are more than others leave of it; then the share stays as
    // it was. Less is always to be had. `own_beside`: how much of what is counted beside the calls
    // the call needs itself, and will whenever it comes.
    void resize(uint64_t bytes, uint64_t own_beside = 0);

    uint64_t bytes() const { return bytes_; }

   private:
    MemoryBudget& budget_;
    uint64_t bytes_ = 0;
  };

  // What is beside included.
  uint64_t used() const;

 private:
  const uint64_t total_;
  const Hooks hooks_;
  mutable std::mutex mutex_;
  uint64_t used_ = 0;
};

}  // namespace itn
