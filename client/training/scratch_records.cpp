#include "client/training/scratch_records.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <stdlib.h>
#include <unistd.h>

#include <cerrno>
#include <string>
#include <system_error>

#include "common/error.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

Error cannot(const std::string& what, const std::string& where, int error_number) {
  return Error(ErrorKind::kIo,
               fmt::format("cannot {} the inputs of the network in {}: {}", what, where,
                           std::error_code(error_number, std::generic_category()).message()));
}

// A file that no name leads to.
int open_unnamed(const fs::path& folder) {
  int descriptor = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (descriptor < 0) {  // not every file system has such files
    std::string name = (folder / "inputs-XXXXXX").string();
    descriptor = ::mkostemp(name.data(), O_CLOEXEC);
    if (descriptor >= 0) ::unlink(name.c_str());
  }
  if (descriptor < 0) throw cannot("write", folder.string(), errno);
  return descriptor;
}

// All or nothing: 0 or the errno of what failed.
template <typename Call, typename Byte>
int transfer(Call call, Byte* data, size_t size, size_t offset) {
  while (size > 0) {
    const ssize_t done = call(data, size, static_cast<off_t>(offset));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return done < 0 ? errno : EIO;
    data += done;
    size -= static_cast<size_t>(done);
    offset += static_cast<size_t>(done);
  }
  return 0;
}

}  // namespace

ScratchRecords::ScratchRecords(size_t count, size_t bytes, const fs::path& folder)
    : count_(count), bytes_(bytes), descriptor_(open_unnamed(folder)) {
  // Room is missed now rather than after half of the records.
  if (const int error = ::posix_fallocate(descriptor_, 0, static_cast<off_t>(count * bytes))) {
    ::close(descriptor_);
    throw cannot(fmt::format("write {} MB of", (count * bytes) >> 20), folder.string(), error);
  }
}

ScratchRecords::~ScratchRecords() {
  ::close(descriptor_);
}

void ScratchRecords::put(size_t place, const void* record) {
  const int error = transfer([&](const char* from, size_t size,
                                 off_t at) { return ::pwrite(descriptor_, from, size, at); },
                             static_cast<const char*>(record), bytes_, place * bytes_);
  if (error != 0) throw cannot("write", "a temporary file", error);
}

void ScratchRecords::get(size_t place, void* record) const {
  const int error =
      transfer([&](char* to, size_t size, off_t at) { return ::pread(descriptor_, to, size, at); },
               static_cast<char*>(record), bytes_, place * bytes_);
  if (error != 0) throw cannot("read", "a temporary file", error);
}

}  // namespace itn
