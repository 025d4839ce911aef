#include "common/learning/checkpoint.h"

#include <fstream>
#include <sstream>

#include <gmock/gmock.h>

#include "common/error.h"
#include "tests/common/learning/model_for_tests.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

class CheckpointTest : public testing::Test {
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
      EXPECT_THAT(error.what(), testing::HasSubstr(path_.filename().string()));
      return error.kind();
    }
    ADD_FAILURE() << "was read";
    return ErrorKind::kInternal;
  }

  fs::path folder_ =
      fs::path(testing::TempDir()) / testing::UnitTest::GetInstance()->current_test_info()->name();
  fs::path path_ = folder_ / kCheckpointName;
  v1::Checkpoint checkpoint_;
};

TEST_F(CheckpointTest, SurvivesARoundTrip) {
  EXPECT_EQ(read_checkpoint(path_).SerializeAsString(), checkpoint_.SerializeAsString());
}

TEST_F(CheckpointTest, IsFoundInTheFolderOfARun) {
  EXPECT_EQ(read_checkpoint(folder_).training().step(), 7);
}

TEST_F(CheckpointTest, CutShortAnywhereIsDataLoss) {
  const std::string whole = bytes();
  for (const size_t size : {size_t{0}, size_t{4}, size_t{8}, size_t{20}, size_t{47}, size_t{48},
                            whole.size() / 2, whole.size() - 1}) {
    replace(whole.substr(0, size));
    EXPECT_EQ(read_error(), ErrorKind::kDataLoss) << size;
  }
}

TEST_F(CheckpointTest, WithAFlippedBitIsDataLoss) {
  std::string damaged = bytes();
  damaged[damaged.size() / 2] ^= 1;
  replace(damaged);
  EXPECT_EQ(read_error(), ErrorKind::kDataLoss);
}

TEST_F(CheckpointTest, OfAnotherKindOfFileIsInvalidInput) {
  replace("PNG or so");
  EXPECT_EQ(read_error(), ErrorKind::kInvalidInput);
}

TEST_F(CheckpointTest, ThatIsMissingIsAnIoError) {
  fs::remove(path_);
  EXPECT_EQ(read_error(), ErrorKind::kIo);
}

}  // namespace
}  // namespace itn
