#include "client/files/folder_lock.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <climits>
#include <system_error>
#include <utility>

#include "common/error.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

std::string text_of(int error_number) {
  return std::error_code(error_number, std::generic_category()).message();
}

// What the holder wrote: its process, machine and purpose. It may not have come to that yet.
std::string holder(int descriptor) {
  std::array<char, 200> buffer{};
  const ssize_t size = ::pread(descriptor, buffer.data(), buffer.size(), 0);
  std::string text(buffer.data(), size > 0 ? static_cast<size_t>(size) : 0);
  for (char& c : text) {
    if (c < ' ' || c > '~') c = ' ';
  }
  text.erase(text.find_last_not_of(' ') + 1);
  return text.empty() ? "another process" : text;
}

std::string self(const std::string& purpose) {
  std::array<char, HOST_NAME_MAX + 1> host{};
  ::gethostname(host.data(), HOST_NAME_MAX);
  return fmt::format("process {} on {} ({})\n", ::getpid(), host.data(), purpose);
}

// Whether the name still stands for the file that is open: its last holder removes it.
bool is_current(int descriptor, const fs::path& path) {
  struct stat opened {
  }, named{};
  return ::fstat(descriptor, &opened) == 0 && ::lstat(path.c_str(), &named) == 0 &&
         opened.st_ino == named.st_ino && opened.st_dev == named.st_dev;
}

}  // namespace

FolderLock::FolderLock(fs::path folder, const std::string& purpose) : folder_(std::move(folder)) {
  std::error_code error;
  created_folder_ = fs::create_directories(folder_, error);
  if (error) {
    throw Error(ErrorKind::kIo,
                fmt::format("cannot create {}: {}", folder_.string(), error.message()));
  }
  const fs::path path = folder_ / kName;
  for (;;) {
    descriptor_ =
        ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
    if (descriptor_ < 0) {
      throw Error(ErrorKind::kIo,
                  fmt::format("cannot write {}: {}", path.string(), text_of(errno)));
    }
    if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0) {
      const int error_number = errno;
      if (error_number == EWOULDBLOCK) {
        const std::string who = holder(descriptor_);
        ::close(descriptor_);
        throw Error(ErrorKind::kIo,
                    fmt::format("{} is in use by {}; wait until it has ended, or choose another "
                                "folder",
                                folder_.string(), who));
      }
      spdlog::warn("{} cannot be locked ({}); see to it that no other process writes there",
                   folder_.string(), text_of(error_number));
    }
    if (is_current(descriptor_, path)) break;
    ::close(descriptor_);
  }
  // Only the message to others depends on it.
  const std::string text = self(purpose);
  if (::ftruncate(descriptor_, 0) != 0 || ::pwrite(descriptor_, text.data(), text.size(), 0) < 0) {
    spdlog::debug("cannot write into {}: {}", path.string(), text_of(errno));
  }
}

FolderLock::~FolderLock() {
  const fs::path path = folder_ / kName;
  if (is_current(descriptor_, path)) ::unlink(path.c_str());
  ::close(descriptor_);
  if (created_folder_) ::rmdir(folder_.c_str());
}

void FolderLock::remove_temporary_files(const fs::path& below) const {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_ / below, error)) {
    if (entry.path().extension() == ".tmp") fs::remove(entry.path(), error);
  }
}

}  // namespace itn
