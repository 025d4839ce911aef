#include "common/learning/checkpoint.h"

#include <cstring>
#include <fstream>
#include <functional>
#include <sstream>
#include <vector>

#include <gmock/gmock.h>
#include <google/protobuf/unknown_field_set.h>
#include <sys/stat.h>
#include <torch/script.h>

#include "common/error.h"
#include "common/learning/predictor.h"
#include "common/scene/scene_bytes.h"
#include "tests/common/learning/model_for_tests.h"
#include "tests/support/address_space.h"
#include "tests/support/expect_error.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using namespace testing;

class CheckpointTest : public ::testing::Test {
 protected:
  CheckpointTest() {
    fs::create_directories(folder_);
    *checkpoint_.mutable_model() = small_model();
    checkpoint_.mutable_training()->set_step(7);
    write_checkpoint(path_, checkpoint_);
  }
  ~CheckpointTest() override { fs::remove_all(folder_); }

  std::string bytes() const {
    std::ostringstream content;
    content << std::ifstream(path_, std::ios::binary).rdbuf();
    return content.str();
  }
  void replace(const std::string& bytes) const {
    std::ofstream(path_, std::ios::binary | std::ios::trunc) << bytes;
  }
  ErrorKind read_error() const {
    try {
      read_checkpoint(path_);
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), ::testing::HasSubstr(path_.filename().string()));
      return error.kind();
    }
    ADD_FAILURE() << "was read";
    return ErrorKind::kInternal;
  }

  fs::path folder_ = fs::path(::testing::TempDir()) /
                     ::testing::UnitTest::GetInstance()->current_test_info()->name();
  fs::path path_ = folder_ / kCheckpointName;
  v1::Checkpoint checkpoint_;
};

TEST_F(CheckpointTest, SurvivesARoundTrip) {
  EXPECT_EQ(read_checkpoint(path_).SerializeAsString(), checkpoint_.SerializeAsString());
}

TEST_F(CheckpointTest, IsFoundInTheFolderOfARun) {
  EXPECT_EQ(read_checkpoint(folder_).training().step(), 7);
}

// Header, message and the first of the data byte by byte, the rest here and there.
std::vector<size_t> places(size_t size) {
  constexpr size_t kEach = 4096, kStride = 37;
  std::vector<size_t> places;
  for (size_t at = 0; at < size; at += at < kEach ? 1 : kStride) places.push_back(at);
  places.push_back(size - 1);
  return places;
}

TEST_F(CheckpointTest, CutShortAnywhereIsDataLoss) {
  const std::string whole = bytes();
  for (const size_t size : places(whole.size())) {
    replace(whole.substr(0, size));
    ASSERT_EQ(read_error(), ErrorKind::kDataLoss) << size;
  }
}

TEST_F(CheckpointTest, WithAByteChangedAnywhereIsDataLoss) {
  const std::string whole = bytes();
  constexpr size_t kNameSize =
      8;  // of the format, with which a file of another kind does not begin
  for (const size_t at : places(whole.size())) {
    for (const int flip : {0x01, 0x80, 0xff}) {
      std::string damaged = whole;
      damaged[at] = static_cast<char>(damaged[at] ^ flip);
      replace(damaged);
      ASSERT_EQ(read_error(), at < kNameSize ? ErrorKind::kInvalidInput : ErrorKind::kDataLoss)
          << at << " " << flip;
    }
  }
}

TEST_F(CheckpointTest, OfAnotherKindOfFileIsInvalidInput) {
  replace("PNG or so");
  EXPECT_EQ(read_error(), ErrorKind::kInvalidInput);
}

TEST_F(CheckpointTest, ThatIsMissingOrNoRegularFileIsAnIoError) {
  fs::remove(path_);
  EXPECT_EQ(read_error(), ErrorKind::kIo);
  ASSERT_EQ(mkfifo(path_.c_str(), 0600), 0);  // to open it would wait for a writer
  EXPECT_EQ(read_error(), ErrorKind::kIo);
}

// --- The one before the latest ---

TEST_F(CheckpointTest, IsKeptWhenTheNextIsWritten) {
  for (const uint64_t step : {8, 9}) {
    checkpoint_.mutable_training()->set_step(step);
    write_latest_checkpoint(folder_, checkpoint_);
    EXPECT_EQ(read_checkpoint(folder_).training().step(), step);
    EXPECT_EQ(read_checkpoint(folder_ / kPreviousCheckpointName).training().step(), step - 1);
  }
}

TEST_F(CheckpointTest, ThatIsDamagedIsNamedAndThePreviousOffered) {
  checkpoint_.mutable_training()->set_step(8);
  write_latest_checkpoint(folder_, checkpoint_);
  replace(bytes().substr(0, 100));
  expect_error(ErrorKind::kDataLoss,
               {path_.string() + " is damaged", "at step 7",
                "mv " + (folder_ / kPreviousCheckpointName).string() + " " + path_.string()},
               [&] { read_checkpoint(folder_); });
  fs::rename(folder_ / kPreviousCheckpointName, path_);
  EXPECT_EQ(read_checkpoint(folder_).training().step(), 7);
  replace(bytes().substr(0, 100));
  expect_error(ErrorKind::kDataLoss, {"no other checkpoint"}, [&] { read_checkpoint(folder_); });
}

// --- From a stranger ---

// The file with other sizes in its header, a message and data, under a digest that fits.
std::string file_of(uint64_t message_size, uint64_t data_size, const std::string& content) {
  std::string file = "ITNCKPT2";
  file.append(reinterpret_cast<const char*>(&message_size), sizeof message_size);
  file.append(reinterpret_cast<const char*>(&data_size), sizeof data_size);
  return file + sha256(content) + content;
}
std::string file_of(const v1::Checkpoint& message, const std::string& data) {
  const std::string bytes = message.SerializeAsString();
  return file_of(bytes.size(), data.size(), bytes + data);
}

// A LibTorch archive that writes the file `marker` when it is loaded.
std::string executable_archive(const fs::path& marker) {
  torch::jit::Module module("Hostile");
  module.define(R"(
    def __getstate__(self) -> int:
      return 0
    def __setstate__(self, state: int) -> None:
      torch.save(torch.ones(1), ")" +
                marker.string() + R"(")
    def forward(self, x: Tensor) -> Tensor:
      return x
  )");
  std::ostringstream archive;
  module.save(archive);
  return archive.str();
}

TEST_F(CheckpointTest, NeverExecutesAnything) {
  const fs::path marker = folder_ / "executed";
  const std::string archive = executable_archive(marker);
  // The archive does what it says when LibTorch loads it.
  std::istringstream stream(archive);
  torch::jit::load(stream);
  ASSERT_TRUE(fs::remove(marker));

  struct Row {
    const char* what;
    std::function<std::string()> file;
  };
  const Row rows[] = {
      {"a file of the earlier version, which held the archive in field 10 of the model",
       [&] {
         v1::Checkpoint c = checkpoint_;
         c.mutable_model()->clear_weights();
         c.GetReflection()
             ->MutableUnknownFields(c.mutable_model())
             ->AddLengthDelimited(10, archive);
         const std::string content = c.SerializeAsString();
         const uint64_t size = content.size();
         std::string file = "ITNCKPT1";
         file.append(reinterpret_cast<const char*>(&size), sizeof size);
         return file + sha256(content) + content;
       }},
      {"the same under today's name",
       [&] {
         v1::Checkpoint c = checkpoint_;
         c.mutable_model()->clear_weights();
         c.GetReflection()
             ->MutableUnknownFields(c.mutable_model())
             ->AddLengthDelimited(10, archive);
         return file_of(c, "");
       }},
      {"the archive as the data of a tensor",
       [&] {
         v1::Checkpoint c = checkpoint_;
         c.mutable_model()->clear_weights();
         v1::Tensor& tensor = *c.mutable_model()->add_weights();
         tensor.set_name("convolutions.0.weight");
         tensor.set_type(v1::Tensor::FLOAT32);
         tensor.add_shape(archive.size() / sizeof(float));
         return file_of(c, archive.substr(0, archive.size() / 4 * 4));
       }},
      {"the archive itself", [&] { return archive; }},
  };
  for (const Row& row : rows) {
    replace(row.file());
    expect_error(ErrorKind::kInvalidInput, {path_.filename().string()},
                 [&] { Predictor::load(path_); });
    EXPECT_FALSE(fs::exists(marker)) << row.what;
  }
  replace(rows[0].file());
  expect_error(ErrorKind::kInvalidInput,
               {"earlier version", "can carry code", "Train the network again"},
               [&] { read_checkpoint(path_); });
}

// Sizes that a file states but does not have are refused before memory is asked for them.
TEST_F(CheckpointTest, ThatIsSmallCannotMakeALargeAllocation) {
  constexpr uint64_t kHuge = uint64_t{1} << 40;
  v1::Checkpoint huge = checkpoint_;
  huge.mutable_model()->clear_weights();
  v1::Tensor& tensor = *huge.mutable_model()->add_weights();
  tensor.set_name("convolutions.0.weight");
  tensor.add_shape(kHuge);
  v1::Checkpoint wrapping = huge;  // 4 * 2^40 * 2^22 bytes are 0 in 64 bits
  wrapping.mutable_model()->mutable_weights(0)->add_shape(uint64_t{1} << 22);
  v1::Checkpoint crowded = checkpoint_;
  for (int i = 0; i < 200'000; ++i) crowded.mutable_model()->add_weights();
  v1::Checkpoint with_data = huge;
  with_data.mutable_model()->mutable_weights(0)->set_data("data");
  const std::string files[] = {
      file_of(kHuge, 0, "content"),
      file_of(3, kHuge, "content"),
      file_of(UINT64_MAX, 8, "content"),
      file_of(huge, "data"),
      file_of(wrapping, ""),
      file_of(crowded, ""),
      file_of(with_data, "data"),
      file_of(checkpoint_, "more data than tensors"),
  };
  for (const std::string& file : files) {
    replace(file);
    const AddressSpaceLimit limit(size_t{64} << 20);
    EXPECT_EQ(read_error(), ErrorKind::kDataLoss);
  }
}

}  // namespace
}  // namespace itn
