// Files that appear under their name only when they are complete.
#pragma once

#include <filesystem>
#include <string_view>

namespace itn {

// Write to temporary(), then commit(). A reader of the target sees the old file or the new one,
// never a part, even if the process or the machine stops in between.
class AtomicFile {
 public:
  // Creates an empty temporary file beside `target`. Throws Error (kIo) if that is impossible.
  explicit AtomicFile(std::filesystem::path target);
  // Removes the temporary file unless it was committed.
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  const std::filesystem::path& temporary() const { return temporary_; }

  // Flushes the temporary file to the disk and renames it to the target. Throws Error (kIo).
  void commit();

 private:
  std::filesystem::path target_;
  std::filesystem::path temporary_;
};

// Throws Error (kIo).
void write_file_atomically(const std::filesystem::path& target, std::string_view bytes);

}  // namespace itn
