// What --workers may say, and how files and names are followed.
#include "client/render_pool/worker_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "common/error.h"
#include "tests/support/captured_log.h"
#include "tests/support/expect_error.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using namespace testing;
using Addresses = WorkerList::Addresses;
using ::testing::HasSubstr;

// What a list says, from its first word on.
class Listener {
 public:
  explicit Listener(WorkerList& list) {
    list.watch([this](const Addresses& addresses) {
      const std::lock_guard lock(mutex_);
      addresses_ = addresses;
    });
  }
  Addresses addresses() const {
    const std::lock_guard lock(mutex_);
    return addresses_;
  }
  bool hears(const Addresses& wanted) const {
    return eventually([&] { return addresses() == wanted; });
  }

 private:
  mutable std::mutex mutex_;
  Addresses addresses_;
};

// The listener outlives the threads of the list.
struct Followed {
  explicit Followed(const std::vector<std::string>& entries)
      : list(std::make_unique<WorkerList>(entries)), listener(*list) {}
  ~Followed() { list.reset(); }
  std::unique_ptr<WorkerList> list;
  Listener listener;
};

TEST(WorkerList, TakesAddressesAsTheyAre) {
  const Followed followed({"a:1", "[::1]:2", "unix:/run/worker", "a:1"});
  EXPECT_EQ(followed.listener.addresses(), (Addresses{"a:1", "[::1]:2", "unix:/run/worker"}));
  EXPECT_FALSE(followed.list->can_change());
}

TEST(WorkerList, RefusesWhatIsNoWorker) {
  for (const std::string entry :
       {"host", "host:0", "host:70000", ":1", "http://host:1", "", "dns:///", "dns:///host",
        "dns:///host:x", "dns://server/host:1", "::1", "fe80::1:50051", "[::1"}) {
    expect_error(ErrorKind::kUsage, {"\"" + entry + "\"", "PORT"}, [&] { WorkerList({entry}); });
  }
}

TEST(WorkerList, ReadsLinesOfAFile) {
  const TemporaryFolder folder;
  const std::string file = folder.write("workers", "# ours\n\n  a:1  # fast\r\nb:2\na:1\nc:3");
  const Followed followed({"first:1", "file:" + file});
  EXPECT_EQ(followed.listener.addresses(), (Addresses{"first:1", "a:1", "b:2", "c:3"}));
  EXPECT_TRUE(followed.list->can_change());
}

TEST(WorkerList, NamesTheLineThatIsWrongAtTheStart) {
  const TemporaryFolder folder;
  for (const std::string bad : {"b", "dns:///b:2", "file:b", "b:2 c:3 /"}) {
    const std::string file = folder.write("workers", "a:1\n" + bad + "\n");
    expect_error(ErrorKind::kInvalidInput, {file + ":2: ", "\"" + bad + "\"", "HOST:PORT"},
                 [&] { WorkerList({"file:" + file}); });
  }
}

TEST(WorkerList, RefusesAFileThatCannotBeRead) {
  const TemporaryFolder folder;
  expect_error(ErrorKind::kIo, {folder.path().string()},
               [&] { WorkerList({"file:" + folder.path().string()}); });
  expect_error(ErrorKind::kIo, {"nowhere"},
               [&] { WorkerList({"file:" + folder.path("nowhere/workers")}); });
}

TEST(WorkerList, FollowsAFile) {
  const testing::CapturedLog log;
  const TemporaryFolder folder;
  const std::string file = folder.path("workers");
  {
    const Followed followed({"file:" + file});
    EXPECT_EQ(followed.listener.addresses(), Addresses());
    EXPECT_THAT(followed.list->unresolved(), HasSubstr("workers (no such file yet)"));
    folder.write("workers", "a:1\n");
    EXPECT_TRUE(followed.listener.hears({"a:1"}));
    folder.write("workers", "a:1\noops\nb:2\n");  // the others are used
    EXPECT_TRUE(followed.listener.hears({"a:1", "b:2"}));
    folder.write("workers", "# nobody\n");
    EXPECT_TRUE(followed.listener.hears({}));
    EXPECT_THAT(followed.list->unresolved(), HasSubstr("workers (no address in it)"));
    folder.write("workers", "c:3\n");
    EXPECT_TRUE(followed.listener.hears({"c:3"}));
    std::filesystem::remove(file);  // as for a moment when it is replaced
    EXPECT_TRUE(eventually(
        [&] { return followed.list->unresolved().find("no such file yet") != std::string::npos; }));
    EXPECT_EQ(followed.listener.addresses(), Addresses{"c:3"});
  }
  EXPECT_THAT(log.text(), HasSubstr("workers:2: \"oops\" is not the address of a server"));
}

TEST(WorkerList, SaysWhatAFileSaysNow) {
  const TemporaryFolder folder;
  WorkerList list({"file:" + folder.write("workers", "a:1\nb:2").string(), "c:3"});
  EXPECT_EQ(list.resolve({}), (Addresses{"a:1", "b:2", "c:3"}));
  folder.write("workers", "b:2");
  EXPECT_EQ(list.resolve({}), (Addresses{"b:2", "c:3"}));
  std::filesystem::remove(folder.path("workers"));
  EXPECT_EQ(list.resolve({}), (Addresses{"b:2", "c:3"}));
  EXPECT_THAT(list.unresolved(), HasSubstr("no such file yet"));
}

// Certificates may be replaced at that moment: nothing changes in the list when they are there.
TEST(WorkerList, TellsAgainWhatWasNotTaken) {
  const testing::CapturedLog log;
  const TemporaryFolder folder;
  folder.write("workers", "a:1\n");
  std::mutex mutex;
  int calls = 0;
  Addresses taken;
  {
    WorkerList list({"file:" + folder.path("workers")});
    list.watch([&](const Addresses& addresses) {
      const std::lock_guard lock(mutex);
      ++calls;
      if (calls == 2 || calls == 3) throw Error(ErrorKind::kIo, "no certificate");
      taken = addresses;
    });
    folder.write("new", "a:1\nb:2\n");
    std::filesystem::rename(folder.path("new"), folder.path("workers"));
    EXPECT_TRUE(eventually([&] {
      const std::lock_guard lock(mutex);
      return taken == Addresses{"a:1", "b:2"};
    }));
    EXPECT_EQ(calls, 4);
  }
  const std::string text = log.text();
  const size_t first = text.find("no certificate");
  EXPECT_NE(first, std::string::npos);
  EXPECT_EQ(text.find("no certificate", first + 1), std::string::npos) << text;
}

TEST(WorkerList, AsksForTheAddressesOfAName) {
  const Followed followed({"dns:///localhost:50051", "dns:///127.0.0.2:7"});
  EXPECT_TRUE(followed.list->can_change());
  const auto heard = [&](const std::string& localhost) {
    return followed.listener.addresses() ==
           Addresses{{localhost, "localhost"}, {"127.0.0.2:7", "127.0.0.2"}};
  };
  EXPECT_TRUE(eventually([&] { return heard("127.0.0.1:50051") || heard("[::1]:50051"); }));
}

TEST(WorkerList, WaitsForANameThatNobodyKnows) {
  const testing::CapturedLog log;
  const Followed followed({"dns:///nobody.invalid:1"});
  // Whatever the name server of this machine says, or that there is none.
  EXPECT_TRUE(eventually(
      [&] { return followed.list->unresolved().find("not asked yet") == std::string::npos; }));
  EXPECT_THAT(followed.list->unresolved(), HasSubstr("dns:///nobody.invalid:1 ("));
  EXPECT_EQ(followed.listener.addresses(), Addresses());
}

}  // namespace
}  // namespace itn
