#include "client/files/line_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

#include "common/error.h"

namespace itn {

namespace {

Error cannot_write(const std::filesystem::path& path) {
  return Error(ErrorKind::kIo,
               fmt::format("cannot write {}: {}", path.string(),
                           std::error_code(errno, std::generic_category()).message()));
}

}  // namespace

LineFile::LineFile(std::filesystem::path path)
    : path_(std::move(path)),
      file_(::open(path_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666)) {
  if (file_.get() < 0) throw cannot_write(path_);
}

void LineFile::flush() {
  while (!missing_.empty()) {
    const ssize_t count = ::write(file_.get(), missing_.data(), missing_.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw cannot_write(path_);
    missing_.erase(0, static_cast<size_t>(count));
  }
}

}  // namespace itn
