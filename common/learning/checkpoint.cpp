#include "common/learning/checkpoint.h"

#include <bit>
#include <cstring>
#include <limits>
#include <optional>
#include <system_error>
#include <vector>

#include <fmt/format.h>

#include "common/error.h"
#include "common/files/atomic_file.h"
#include "common/files/read_file.h"
#include "common/scene/scene_bytes.h"

namespace itn {
namespace fs = std::filesystem;

namespace {

constexpr std::string_view kMagic = "ITNCKPT2";
constexpr std::string_view kOldMagic = "ITNCKPT1";
constexpr size_t kDigestSize = 32;

// A parsed message takes some forty times its bytes at most. A network of a hundred layers needs a
// tenth of this.
constexpr uint64_t kMaxMessageSize = uint64_t{1} << 18;

// The largest network of today has 1.6 GB of weights, and twice that in its optimizer.
constexpr uint64_t kMaxFileSize = uint64_t{8} << 30;

static_assert(std::endian::native == std::endian::little, "the file's numbers are little-endian");

struct Header {
  uint64_t message_size = 0;
  uint64_t data_size = 0;
  std::string digest;
};
constexpr size_t kHeaderSize = kMagic.size() + 2 * sizeof(uint64_t) + kDigestSize;

Error damaged(const fs::path& path, const std::string& how) {
  return Error(ErrorKind::kDataLoss, fmt::format("{} is damaged: {}", path.string(), how));
}

// In the order in which their data follow the message.
std::vector<v1::Tensor*> tensors_of(v1::Checkpoint& checkpoint) {
  std::vector<v1::Tensor*> tensors;
  for (v1::Tensor& tensor : *checkpoint.mutable_model()->mutable_weights()) {
    tensors.push_back(&tensor);
  }
  if (checkpoint.model().has_outlier_model()) {
    v1::OutlierModel& outlier_model = *checkpoint.mutable_model()->mutable_outlier_model();
    for (v1::PrincipalGaussian* gaussian :
         {outlier_model.mutable_embedding(), outlier_model.mutable_statistics()}) {
      tensors.push_back(gaussian->mutable_mean());
      tensors.push_back(gaussian->mutable_axes());
    }
  }
  if (checkpoint.training().has_optimizer()) {
    auto& optimizer = *checkpoint.mutable_training()->mutable_optimizer();
    for (v1::Tensor& tensor : *optimizer.mutable_tensors()) tensors.push_back(&tensor);
  }
  if (checkpoint.training().weights_size() > 0) {
    for (v1::Tensor& tensor : *checkpoint.mutable_training()->mutable_weights()) {
      tensors.push_back(&tensor);
    }
  }
  return tensors;
}

Header read_header(std::string_view file, const fs::path& path) {
  const std::string_view magic = file.substr(0, kMagic.size());
  if (magic == kOldMagic) {
    throw invalid_input(fmt::format(
        "{} was written by an earlier version of itn, as an archive that can carry code; it is not "
        "opened. Train the network again: itn train",
        path.string()));
  }
  if (!kMagic.starts_with(magic)) {
    throw invalid_input(fmt::format("{} is not a checkpoint of itn train", path.string()));
  }
  if (file.size() < kHeaderSize) {
    throw damaged(path, fmt::format("it ends within its header, after {} bytes", file.size()));
  }
  Header header;
  std::memcpy(&header.message_size, file.data() + kMagic.size(), sizeof(uint64_t));
  std::memcpy(&header.data_size, file.data() + kMagic.size() + sizeof(uint64_t), sizeof(uint64_t));
  header.digest = file.substr(kHeaderSize - kDigestSize, kDigestSize);
  const uint64_t content = file.size() - kHeaderSize;
  if (header.message_size > content || header.data_size != content - header.message_size) {
    throw damaged(path, fmt::format("its content has {} bytes rather than {} + {}", content,
                                    header.message_size, header.data_size));
  }
  if (header.message_size > kMaxMessageSize) {
    throw damaged(path, fmt::format("its message has {} bytes; at most {} are accepted",
                                    header.message_size, kMaxMessageSize));
  }
  return header;
}

// The bytes of a tensor of this shape, if it is at most `limit`.
std::optional<uint64_t> data_size(const v1::Tensor& tensor, uint64_t limit) {
  uint64_t size = sizeof(float);
  for (const uint64_t n : tensor.shape()) {
    if (n != 0 && size > limit / n) return std::nullopt;
    size *= n;
  }
  return size <= limit ? std::optional(size) : std::nullopt;
}

// Hands the data out to the tensors.
void distribute(std::string_view data, v1::Checkpoint& checkpoint, const fs::path& path) {
  for (v1::Tensor* tensor : tensors_of(checkpoint)) {
    const std::optional<uint64_t> size = data_size(*tensor, data.size());
    if (!size || !tensor->data().empty()) {
      throw damaged(path, "its tensors do not have the sizes that they state");
    }
    tensor->set_data(data.data(), *size);
    data.remove_prefix(*size);
  }
  if (!data.empty()) {
    throw damaged(path, fmt::format("{} bytes of its data belong to no tensor", data.size()));
  }
}

// Says what files leave out that were written before there was a choice.
void complete(v1::Checkpoint& checkpoint) {
  const auto set = [](auto& message) {
    if (message.input() == v1::NETWORK_INPUT_UNSPECIFIED) {
      message.set_input(v1::LUMINANCE_AND_WEIGHT);
    }
    if (message.exposure() == v1::EXPOSURE_UNSPECIFIED) message.set_exposure(v1::EXPOSURE_KNOWN);
  };
  set(*checkpoint.mutable_model());
  if (checkpoint.training().has_config()) set(*checkpoint.mutable_training()->mutable_config());
}

v1::Checkpoint read_one(const fs::path& path) {
  const std::string file = read_file(path, "checkpoint", kMaxFileSize);
  const Header header = read_header(file, path);
  const std::string_view content = std::string_view(file).substr(kHeaderSize);
  if (sha256(std::string(content)) != header.digest) {
    throw damaged(path, "its content does not have the checksum that it should");
  }
  v1::Checkpoint checkpoint;
  if (!checkpoint.ParseFromArray(content.data(), static_cast<int>(header.message_size))) {
    throw damaged(path, "it cannot be parsed");
  }
  distribute(content.substr(header.message_size), checkpoint, path);
  complete(checkpoint);
  return checkpoint;
}

// What can be done about a damaged checkpoint in the folder of a run.
std::string recovery_hint(const fs::path& folder) {
  const fs::path previous = folder / kPreviousCheckpointName;
  try {
    const v1::Checkpoint checkpoint = read_one(previous);
    return fmt::format("The one before it is whole, at step {}; to go on from there: mv {} {}",
                       checkpoint.training().step(), previous.string(),
                       (folder / kCheckpointName).string());
  } catch (const Error&) {
    return "There is no other checkpoint beside it";
  }
}

// `from` under a second name, or a copy of it where the file system knows no links.
void keep_as(const fs::path& from, const fs::path& to) {
  fs::path temporary = to;
  temporary += ".tmp";
  std::error_code error;
  fs::remove(temporary, error);
  fs::create_hard_link(from, temporary, error);
  if (error) fs::copy_file(from, temporary, error);
  if (!error) fs::rename(temporary, to, error);
  if (error) {
    std::error_code ignored;
    fs::remove(temporary, ignored);
    throw Error(ErrorKind::kIo, fmt::format("cannot write {}: {}", to.string(), error.message()));
  }
}

}  // namespace

void write_checkpoint(const fs::path& path, v1::Checkpoint checkpoint) {
  std::string data;
  for (v1::Tensor* tensor : tensors_of(checkpoint)) {
    data += tensor->data();
    tensor->clear_data();
  }
  const std::string message = checkpoint.SerializeAsString();
  const uint64_t message_size = message.size(), data_size = data.size();
  const std::string content = message + data;
  std::string file(kMagic);
  file.append(reinterpret_cast<const char*>(&message_size), sizeof message_size);
  file.append(reinterpret_cast<const char*>(&data_size), sizeof data_size);
  file += sha256(content);
  file += content;
  write_file_atomically(path, file);
}

void write_latest_checkpoint(const fs::path& folder, v1::Checkpoint checkpoint) {
  const fs::path latest = folder / kCheckpointName;
  if (fs::exists(latest)) keep_as(latest, folder / kPreviousCheckpointName);
  write_checkpoint(latest, std::move(checkpoint));
}

v1::Checkpoint read_checkpoint(const fs::path& path) {
  if (!fs::is_directory(path)) return read_one(path);
  const fs::path latest = path / kCheckpointName;
  try {
    if (!fs::exists(latest) && fs::exists(path / kPreviousCheckpointName)) {
      throw Error(ErrorKind::kDataLoss, fmt::format("{} is missing", latest.string()));
    }
    return read_one(latest);
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::kDataLoss) throw;
    throw Error(error.kind(), fmt::format("{}. {}", error.what(), recovery_hint(path)));
  }
}

std::optional<v1::Checkpoint> find_checkpoint(const fs::path& folder) {
  if (!fs::exists(folder / kCheckpointName) && !fs::exists(folder / kPreviousCheckpointName)) {
    return std::nullopt;
  }
  return read_checkpoint(folder);
}

std::string weights_sha256(const v1::Model& model) {
  std::string digests;
  for (const v1::Tensor& tensor : model.weights()) digests += sha256(tensor.SerializeAsString());
  return to_hex(sha256(digests));
}

}  // namespace itn
