#include "common/files/atomic_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>
#include <utility>

#include "common/error.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

Error cannot_write(const fs::path& target, int error_number) {
  return Error(ErrorKind::kIo,
               fmt::format("cannot write {}: {}", target.string(),
                           std::error_code(error_number, std::generic_category()).message()));
}

// Creates a file that nobody else has, with the permissions that the umask leaves.
fs::path create_beside(const fs::path& target) {
  static std::atomic<unsigned> counter = 0;
  for (;;) {
    fs::path name = target;
    name += fmt::format(".{}-{}.tmp", ::getpid(), counter++);
    const int fd = ::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd >= 0) {
      ::close(fd);
      return name;
    }
    // The name may be left over from a process of the same id that was killed.
    if (errno != EEXIST) throw cannot_write(target, errno);
  }
}

// 0 or the errno of what failed.
int flush_to_disk(const fs::path& path, int flags) {
  const int fd = ::open(path.c_str(), flags | O_CLOEXEC);
  if (fd < 0) return errno;
  const int error_number = ::fsync(fd) == 0 ? 0 : errno;
  ::close(fd);
  return error_number;
}

}  // namespace

AtomicFile::AtomicFile(fs::path target)
    : target_(std::move(target)), temporary_(create_beside(target_)) {}

AtomicFile::~AtomicFile() {
  if (temporary_.empty()) return;
  std::error_code ignored;
  fs::remove(temporary_, ignored);
}

void AtomicFile::commit() {
  if (const int error_number = flush_to_disk(temporary_, O_RDONLY)) {
    throw cannot_write(target_, error_number);
  }
  if (std::rename(temporary_.c_str(), target_.c_str()) != 0) throw cannot_write(target_, errno);
  temporary_.clear();
  // The rename itself must survive too. Some file systems cannot flush a directory; the file is
  // complete either way.
  const fs::path folder = target_.has_parent_path() ? target_.parent_path() : fs::path(".");
  flush_to_disk(folder, O_RDONLY | O_DIRECTORY);
}

void write_file_atomically(const fs::path& target, std::string_view bytes) {
  AtomicFile file(target);
  std::ofstream out(file.temporary(), std::ios::binary);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (!out) throw cannot_write(target, errno != 0 ? errno : EIO);
  file.commit();
}

}  // namespace itn
