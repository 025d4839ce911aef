#include "common/learning/checkpoint.h"

#include <bit>
#include <cstring>
#include <limits>

#include <fmt/format.h>

#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace {

constexpr std::string_view kMagic = "ITNCKPT1";
constexpr size_t kDigestSize = 32;
constexpr size_t kHeaderSize = kMagic.size() + sizeof(uint64_t) + kDigestSize;

static_assert(std::endian::native == std::endian::little, "the file's size field is little-endian");

// The content, once the header has been found to fit.
std::string_view checked_content(const std::filesystem::path& path, std::string_view file) {
  const auto damaged = [&](const std::string& how) {
    return Error(ErrorKind::kDataLoss, fmt::format("{} is damaged: {}", path.string(), how));
  };
  if (!file.starts_with(kMagic.substr(0, file.size()))) {
    throw invalid_input(fmt::format("{} is not a checkpoint of itn train", path.string()));
  }
  if (file.size() < kHeaderSize) {
    throw damaged(fmt::format("it ends within its header, after {} bytes", file.size()));
  }
  uint64_t size = 0;
  std::memcpy(&size, file.data() + kMagic.size(), sizeof size);
  const std::string_view content = file.substr(kHeaderSize);
  if (content.size() != size) {
    throw damaged(fmt::format("its content has {} bytes rather than {}", content.size(), size));
  }
  if (sha256(std::string(content)) != file.substr(kHeaderSize - kDigestSize, kDigestSize)) {
    throw damaged("its content does not have the checksum that it should");
  }
  return content;
}

}  // namespace

void write_checkpoint(const std::filesystem::path& path, const v1::Checkpoint& checkpoint) {
  if (checkpoint.ByteSizeLong() > std::numeric_limits<int>::max()) {
    throw invalid_input("a network of this size does not fit into a checkpoint of 2 GiB");
  }
  const std::string content = checkpoint.SerializeAsString();
  const uint64_t size = content.size();
  std::string file(kMagic);
  file.append(reinterpret_cast<const char*>(&size), sizeof size);
  file += sha256(content);
  file += content;
  write_file_atomically(path, file);
}

v1::Checkpoint read_checkpoint(const std::filesystem::path& path) {
  const auto file_path = std::filesystem::is_directory(path) ? path / kCheckpointName : path;
  const std::string file = read_file(file_path, "checkpoint");
  const std::string_view content = checked_content(file_path, file);
  v1::Checkpoint checkpoint;
  if (!checkpoint.ParseFromArray(content.data(), static_cast<int>(content.size()))) {
    throw Error(ErrorKind::kDataLoss,
                fmt::format("{} is damaged: it cannot be parsed", file_path.string()));
  }
  return checkpoint;
}

}  // namespace itn
