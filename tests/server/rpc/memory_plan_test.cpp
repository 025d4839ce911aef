#include "server/rpc/memory_plan.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>

#include "common/error.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using testing::TemporaryFolder;

TEST(MemoryPlan, DividesWhatThereIsAndNoMore) {
  const uint64_t mb = uint64_t{1} << 20;
  for (const uint64_t total : {300 * mb, 1024 * mb, 4096 * mb}) {
    const MemoryPlan plan = plan_memory(total, 128 * mb, 256 * mb);
    EXPECT_EQ(128 * mb + plan.transport_bytes + plan.call_bytes + total / 8, total);
    EXPECT_LE(2 * plan.message_bytes, plan.transport_bytes);
  }
  EXPECT_THROW(plan_memory(128 * mb, 128 * mb, 256 * mb), Error);
}

// The files of control groups in a folder of the test's own.
class GroupLimitTest : public ::testing::Test {
 protected:
  void write(const std::string& file, const std::string& text) const {
    const std::filesystem::path path = root_.path() / file;
    std::filesystem::create_directories(path.parent_path());
    std::ofstream(path) << text << "\n";
  }

  uint64_t limit_of(const std::string& groups) const {
    std::istringstream stream(groups);
    return least_group_limit(stream, root_.path());
  }

 private:
  TemporaryFolder root_;
};

constexpr uint64_t kNoLimit = std::numeric_limits<uint64_t>::max();

TEST_F(GroupLimitTest, IsTheLeastOfAllGroupsThatHaveOne) {
  write("system.slice/memory.max", "3000");
  write("system.slice/itn-worker.service/memory.max", "5000");
  write("system.slice/other.service/memory.max", "1000");
  EXPECT_EQ(limit_of("0::/system.slice/itn-worker.service\n"), 3000U);
  write("system.slice/itn-worker.service/memory.max", "2000");
  EXPECT_EQ(limit_of("0::/system.slice/itn-worker.service\n"), 2000U);
}

TEST_F(GroupLimitTest, IsOfTheRootInAContainer) {
  write("memory.max", "4000");
  EXPECT_EQ(limit_of("0::/\n"), 4000U);
  EXPECT_EQ(limit_of("0::/of/the/host\n"), 4000U);
}

TEST_F(GroupLimitTest, IsNoneWhereNothingSaysOne) {
  write("jobs/memory.max", "max");
  EXPECT_EQ(limit_of("0::/jobs\n"), kNoLimit);
  EXPECT_EQ(limit_of(""), kNoLimit);
  EXPECT_EQ(limit_of("4:cpu,cpuacct:/jobs\n3:hugetlb,memory:/jobs\n"), kNoLimit);  // version 1
  EXPECT_EQ(limit_of("what is this"), kNoLimit);
}

}  // namespace
}  // namespace itn
