#include "common/files/atomic_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdio>
#include <optional>
#include <system_error>
#include <utility>

#include "common/error.h"
#include "common/files/file_descriptor.h"
#include "common/printable.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

Error cannot_write(const fs::path& target, const std::string& reason) {
  return Error(ErrorKind::kIo, fmt::format("cannot write {}: {}", name_of_output(target), reason));
}

Error cannot_write(const fs::path& target, int error_number) {
  return cannot_write(target, std::error_code(error_number, std::generic_category()).message());
}

// The status of the file that the path leads to; nothing if there is none.
std::optional<struct stat> status_of(const fs::path& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) return std::nullopt;
  return status;
}

// The file that a chain of symbolic links leads to, whether it exists or not.
fs::path follow_links(const fs::path& target) {
  if (target.native().find('\0') != std::string::npos) {
    throw invalid_input(
        fmt::format("cannot write {}: its name has a NUL", printable(target.string())));
  }
  constexpr int kMaxLinks = 40;  // as Linux
  fs::path path = target;
  for (int i = 0; i < kMaxLinks; ++i) {
    std::error_code not_a_link;
    const fs::path next = fs::read_symlink(path, not_a_link);
    if (not_a_link) {
      if (!path.has_filename()) throw cannot_write(target, "it is not the name of a file");
      return path;
    }
    path = path.parent_path() / next;
  }
  throw cannot_write(target, ELOOP);
}

// Returns 0 or the errno of what failed.
int write_all(int fd, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t count = ::write(fd, bytes.data(), bytes.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return errno;
    bytes.remove_prefix(static_cast<size_t>(count));
  }
  return 0;
}

// A file beside the target that is removed unless it is renamed to it.
class TemporaryFile {
 public:
  // `file`: the target without links. `target` is its name in messages.
  TemporaryFile(fs::path file, fs::path target)
      : target_(std::move(target)), file_(std::move(file)), fd_(create()) {}
  ~TemporaryFile() {
    if (name_.empty()) return;
    std::error_code ignored;
    fs::remove(name_, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  // Otherwise the new file has those that the umask leaves.
  void take_permissions_of(const struct stat& old) {
    if (::fchown(fd_.get(), old.st_uid, old.st_gid) != 0) {
      // Only root may give a file away: others own what they wrote.
    }
    if (::fchmod(fd_.get(), old.st_mode & 0777) != 0) fail();
  }

  void write(std::string_view bytes) {
    if (const int error_number = write_all(fd_.get(), bytes)) {
      throw cannot_write(target_, error_number);
    }
  }

  void rename() {
    if (::fsync(fd_.get()) != 0 || !fd_.close()) fail();
    if (std::rename(name_.c_str(), file_.c_str()) != 0) fail();
    name_.clear();
    // The rename itself must survive too. Some file systems cannot flush a directory; the file is
    // complete either way.
    const fs::path folder = file_.has_parent_path() ? file_.parent_path() : fs::path(".");
    const FileDescriptor directory(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (directory.get() >= 0) ::fsync(directory.get());
  }

 private:
  // A file that nobody else has.
  FileDescriptor create() {
    static std::atomic<unsigned> counter = 0;
    for (;;) {
      fs::path name = file_;
      name += fmt::format(".{}-{}.tmp", ::getpid(), counter++);
      FileDescriptor file(::open(name.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
      if (file.get() >= 0) {
        name_ = name;
        return file;
      }
      // The name may be left over from a process of the same id that was killed.
      if (errno != EEXIST) fail();
    }
  }

  [[noreturn]] void fail() const { throw cannot_write(target_, errno); }

  fs::path target_, file_, name_;
  FileDescriptor fd_;
};

// By the rights that the process has now, as opening would.
bool has_access(const fs::path& path, int mode) {
  return ::faccessat(AT_FDCWD, path.c_str(), mode, AT_EACCESS) == 0;
}

void refuse_unwritable(const fs::path& target, const struct stat& status) {
  if (S_ISDIR(status.st_mode)) throw cannot_write(target, "it is a folder");
  if (!has_access(target, W_OK)) throw cannot_write(target, errno);
}

bool is_replaced(const std::optional<struct stat>& status) {
  return !status || S_ISREG(status->st_mode);
}

void write_into(int fd, const fs::path& target, std::string_view bytes) {
  if (const int error_number = write_all(fd, bytes)) throw cannot_write(target, error_number);
}

void write_to_stdout(const fs::path& target, std::string_view bytes) {
  std::fflush(stdout);  // what was printed before comes first
  write_into(STDOUT_FILENO, target, bytes);
}

}  // namespace

void write_file_atomically(const fs::path& target, std::string_view bytes) {
  if (is_stdout(target)) return write_to_stdout(target, bytes);
  const auto status = status_of(target);
  if (status) refuse_unwritable(target, *status);
  if (is_replaced(status)) {
    TemporaryFile file(follow_links(target), target);
    if (status) file.take_permissions_of(*status);
    file.write(bytes);
    file.rename();
  } else {
    FileDescriptor stream(::open(target.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC));
    if (stream.get() < 0) throw cannot_write(target, errno);
    write_into(stream.get(), target, bytes);
    if (!stream.close()) throw cannot_write(target, errno);
  }
}

void check_writable(const fs::path& target) {
  if (is_stdout(target)) {
    if (::isatty(STDOUT_FILENO)) {
      throw cannot_write(target, "it is a terminal; redirect it to a file or a pipe");
    }
    return;
  }
  const auto status = status_of(target);
  if (status) refuse_unwritable(target, *status);
  if (is_replaced(status)) TemporaryFile(follow_links(target), target);
}

void check_folder_writable(const fs::path& folder) {
  // The nearest that exists, in which the others would be created.
  fs::path existing = fs::absolute(folder).lexically_normal();
  std::error_code ignored;
  while (!fs::exists(existing, ignored) && existing.has_relative_path())
    existing = existing.parent_path();
  if (!fs::is_directory(existing, ignored)) {
    throw cannot_write(folder, fmt::format("{} is not a folder", existing.string()));
  }
  if (!has_access(existing, W_OK | X_OK)) throw cannot_write(folder, errno);
}

std::string name_of_output(const fs::path& target) {
  return target == "-" ? "standard output" : target.string();
}

bool is_stdout(const fs::path& target) {
  if (target == "-") return true;
  struct stat out {};
  const auto status = status_of(target);
  // A device, such as a terminal or /dev/null, may be meant as such.
  return status && (S_ISREG(status->st_mode) || S_ISFIFO(status->st_mode)) &&
         ::fstat(STDOUT_FILENO, &out) == 0 && out.st_dev == status->st_dev &&
         out.st_ino == status->st_ino;
}

}  // namespace itn
