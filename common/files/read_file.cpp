#include "common/files/read_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "common/error.h"
#include "common/files/file_descriptor.h"
#include "common/printable.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

Error cannot_read(const std::string& name, const std::string& reason) {
  return Error(ErrorKind::kIo, fmt::format("cannot read {}: {}", name, reason));
}

Error cannot_read(const std::string& name, int error_number) {
  return cannot_read(name, std::error_code(error_number, std::generic_category()).message());
}

// To the end of the file, which may have grown, or never have said its size (as those of /proc).
std::string read_to_end(int fd, uint64_t expected_bytes, uint64_t max_bytes,
                        const std::string& name) {
  constexpr uint64_t kMinStep = 1 << 16;
  std::string content;
  uint64_t size = 0;
  for (;;) {
    if (size == content.size()) {
      // One byte beyond what is expected sees the end.
      content.resize(std::max(size + std::max(size / 2, kMinStep), expected_bytes + 1));
    }
    const ssize_t count = ::read(fd, content.data() + size, content.size() - size);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw cannot_read(name, errno);
    if (count == 0) break;
    size += static_cast<uint64_t>(count);
    if (size > max_bytes) {
      throw invalid_input(
          fmt::format("{} has more than {} bytes, the most that is accepted", name, max_bytes));
    }
  }
  content.resize(size);
  return content;
}

}  // namespace

std::string read_file(const fs::path& path, const std::string& what, uint64_t max_bytes) {
  if (path.native().find('\0') != std::string::npos) {
    throw invalid_input(
        fmt::format("cannot read the {} {}: its name has a NUL", what, printable(path.string())));
  }
  const std::string name = fmt::format("the {} {}", what, path.string());
  // Without O_NONBLOCK, opening a FIFO waits for its writer.
  const FileDescriptor file(::open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  if (file.get() < 0) throw cannot_read(name, errno);
  struct stat status {};
  if (::fstat(file.get(), &status) != 0) throw cannot_read(name, errno);
  if (!S_ISREG(status.st_mode)) {
    throw cannot_read(name, fmt::format("it is a {}, not a file", kind_of_file(status.st_mode)));
  }
  const auto claimed = static_cast<uint64_t>(status.st_size);
  if (claimed > max_bytes) {
    throw invalid_input(
        fmt::format("{} has {} bytes; at most {} are accepted", name, claimed, max_bytes));
  }
  return read_to_end(file.get(), claimed, max_bytes, name);
}

std::string read_file_or_stdin(const fs::path& path, const std::string& what, uint64_t max_bytes) {
  if (path != "-") return read_file(path, what, max_bytes);
  return read_to_end(STDIN_FILENO, 0, max_bytes, fmt::format("the {} on standard input", what));
}

}  // namespace itn
