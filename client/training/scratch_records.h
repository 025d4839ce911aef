// Data at hand without being in memory.
#pragma once

#include <cstddef>
#include <filesystem>

namespace itn {

// So many places for records of one size, in a file without a name, which goes when this does,
// however the process ends. The memory that it takes does not depend on how many there are, and the
// operating system keeps what it has room for.
class ScratchRecords {
 public:
  // `bytes`: of each. `folder`: where the file is. Throws Error (kIo): no room there.
  ScratchRecords(size_t count, size_t bytes, const std::filesystem::path& folder);
  ~ScratchRecords();
  ScratchRecords(const ScratchRecords&) = delete;
  ScratchRecords& operator=(const ScratchRecords&) = delete;

  // Several threads may put and get at a time, each at a place of its own. Throw Error (kIo).
  void put(size_t place, const void* record);
  void get(size_t place, void* record) const;

  size_t size() const { return count_; }
  size_t record_bytes() const { return bytes_; }

 private:
  size_t count_, bytes_;
  int descriptor_;
};

}  // namespace itn
