// One process at a time in a folder.
#pragma once

#include <filesystem>
#include <string>

namespace itn {

// Held from construction to destruction. The kernel lets go of it however the process ends: a lock
// file that is left over is taken over. On file systems without locks (flock) there is a warning
// instead.
class FolderLock {
 public:
  // `purpose`: what this process does there, for the message to another one. Creates the folder if
  // there is none. Throws Error (kIo) that says which process (id and machine) holds the lock, or
  // why it cannot be taken.
  FolderLock(std::filesystem::path folder, const std::string& purpose);
  // Removes the lock file; the folder too if this lock created it and nothing is in it.
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

  // Removes what processes that were killed had begun to write (*.tmp) in the folder, or in a
  // folder below it that the lock stands for too.
  void remove_temporary_files(const std::filesystem::path& below = {}) const;

  // The name of the lock file, which is in the folder.
  static constexpr const char* kName = ".itn.lock";

 private:
  std::filesystem::path folder_;
  bool created_folder_ = false;
  int descriptor_ = -1;
};

}  // namespace itn
