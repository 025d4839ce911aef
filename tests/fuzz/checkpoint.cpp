// Checkpoints, as they are and with a checksum that is right, as a stranger can make it; of what
// can be read a predictor is made.
#include <algorithm>
#include <cstring>

#include "common/learning/checkpoint.h"
#include "common/learning/predictor.h"
#include "common/scene/scene_bytes.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/message_mutation.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

constexpr size_t kSizesAt = 8, kContentAt = 56;  // see checkpoint.h

uint64_t message_size(const std::string& file) {
  uint64_t size = 0;
  std::memcpy(&size, file.data() + kSizesAt, sizeof size);
  return std::min<uint64_t>(size, file.size() - kContentAt);
}

// A file of this message and data, with this file's beginning.
std::string completed(const std::string& file, const std::string& message,
                      const std::string& data) {
  const uint64_t sizes[] = {message.size(), data.size()};
  std::string result = file.substr(0, kSizesAt);
  result.append(reinterpret_cast<const char*>(sizes), sizeof sizes);
  return result + sha256(message + data) + message + data;
}

struct Content {
  std::string message, data;
};

Content content_of(const std::string& file) {
  const size_t data_at = kContentAt + message_size(file);
  return {file.substr(kContentAt, data_at - kContentAt), file.substr(data_at)};
}

}  // namespace
}  // namespace itn

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace itn;
  static const testing::TemporaryFolder folder;
  const auto expect_answer = [](const std::string& file) {
    testing::expect_answer([&] {
      const v1::Checkpoint checkpoint = read_checkpoint(folder.write("checkpoint.itn", file));
      Predictor(checkpoint.model());
    });
  };
  const std::string file = testing::to_string(data, size);
  expect_answer(file);
  if (file.size() < kContentAt) return 0;
  const Content content = content_of(file);
  expect_answer(completed(file, content.message, content.data));
  return 0;
}

extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t max_size,
                                          unsigned seed) {
  using namespace itn;
  const auto change = [](const std::string& file,
                         std::mt19937& random) -> std::optional<std::string> {
    if (file.size() < kContentAt) return std::nullopt;
    const Content content = content_of(file);
    const auto message = testing::change_serialized<v1::Checkpoint>()(content.message, random);
    if (!message) return std::nullopt;
    return completed(file, *message, content.data);
  };
  return testing::mutated_input(data, size, max_size, seed, change);
}
