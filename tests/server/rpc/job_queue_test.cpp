#include "server/rpc/job_queue.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "common/error.h"
#include "common/rpc/status.h"
#include "itn/v1/render.pb.h"
#include "tests/support/process.h"

namespace itn {
namespace {

// Somebody with one connection.
QueueClient client(const std::string& name) {
  return {name, name};
}

void submit(JobQueue& queue, JobQueue::Job job, const QueueClient& from = client("a")) {
  queue.submit(queue.admit(from), std::move(job));
}

void drain(JobQueue& queue) {
  EXPECT_TRUE(queue.drain_for(std::chrono::hours(1)));
}

// Occupies a thread of the queue until told otherwise.
class Blocker {
 public:
  explicit Blocker(JobQueue& queue, const QueueClient& from = client("a")) {
    submit(queue,
           {{},
            [state = state_] {
              state->started.set_value();
              state->release.get_future().wait();
            },
            [] {}},
           from);
    state_->started.get_future().wait();
  }
  void release() { state_->release.set_value(); }

 private:
  struct State {
    std::promise<void> started, release;
  };
  // The job's too, which may still look at it when the test has gone on.
  std::shared_ptr<State> state_ = std::make_shared<State>();
};

TEST(JobQueue, RefusesMoreThanItsCapacity) {
  std::atomic<int> done = 0;
  JobQueue queue(1, 2);
  Blocker blocker(queue);
  const auto add = [&] { submit(queue, {{}, [&] { ++done; }, [] {}}); };
  add();
  add();
  try {
    add();
    FAIL() << "accepted";
  } catch (const StatusError& error) {
    EXPECT_EQ(error.status().error_code(), grpc::UNAVAILABLE);
    v1::Busy details;
    ASSERT_TRUE(details.ParseFromString(error.status().error_details()));
    EXPECT_GT(details.retry_after_seconds(), 0);
    EXPECT_LE(details.retry_after_seconds(), 10);
  }
  blocker.release();
  drain(queue);
  EXPECT_EQ(done, 2);
}

TEST(JobQueue, WithoutRoomToWaitStillRuns) {
  std::atomic<int> done = 0;
  JobQueue queue(1, 0);
  submit(queue, {{}, [&] { ++done; }, [] {}});
  drain(queue);
  EXPECT_EQ(done, 1);
}

TEST(JobQueue, DropsStoppedJobsAndFreesTheirPlaces) {
  std::atomic<int> run = 0, dropped = 0;
  JobQueue queue(1, 1);
  Blocker blocker(queue);
  std::stop_source stop;
  submit(queue, {stop.get_token(), [&] { ++run; }, [&] { ++dropped; }});
  stop.request_stop();
  queue.drop_stopped();
  EXPECT_EQ(dropped, 1);
  submit(queue, {{}, [&] { ++run; }, [] {}});
  blocker.release();
  drain(queue);
  EXPECT_EQ(run, 1);
  EXPECT_EQ(dropped, 1);
}

TEST(JobQueue, TakesNothingOnceDrained) {
  JobQueue queue(2, 2);
  drain(queue);
  EXPECT_THROW(queue.admit(client("a")), Error);
}

TEST(JobQueue, DropsWhatWaitsWhenItGoesAway) {
  std::atomic<int> dropped = 0;
  auto queue = std::make_unique<JobQueue>(1, 1);
  Blocker blocker(*queue);
  submit(*queue, {{},
                  [] {},
                  [&] {
                    ++dropped;
                    blocker.release();
                  }});
  queue.reset();
  EXPECT_EQ(dropped, 1);
}

TEST(JobQueue, GivesBackAPlaceThatWasNotUsed) {
  JobQueue queue(1, 0);
  {
    const JobQueue::QueueSlot place = queue.admit(client("a"));
    EXPECT_THROW(queue.admit(client("b")), StatusError);
  }
  queue.admit(client("b"));
}

// Who was refused comes before who asks all the time.
TEST(JobQueue, KeepsAFreePlaceForWhoWasRefusedFirst) {
  JobQueue queue(1, 0);
  {
    const JobQueue::QueueSlot place = queue.admit(client("greedy"));
    EXPECT_THROW(queue.admit(client("polite")), StatusError);
    EXPECT_THROW(queue.admit(client("greedy")), StatusError);
  }
  EXPECT_THROW(queue.admit(client("greedy")), StatusError);
  EXPECT_THROW(queue.admit(client("third")), StatusError);
  { const JobQueue::QueueSlot place = queue.admit(client("polite")); }
  { const JobQueue::QueueSlot place = queue.admit(client("greedy")); }
  { const JobQueue::QueueSlot place = queue.admit(client("third")); }
}

TEST(JobQueue, KeepsThePlaceOfWhoWillComeAgainAtOnce) {
  JobQueue queue(1, 0);
  JobQueue::QueueSlot place = queue.admit(client("a"));
  EXPECT_THROW(queue.admit(client("b")), StatusError);
  place.reserve_for_client();
  EXPECT_THROW(queue.admit(client("b")), StatusError);
  { const JobQueue::QueueSlot again = queue.admit(client("a")); }
  { const JobQueue::QueueSlot other = queue.admit(client("b")); }
}

TEST(JobQueue, KeepsOnePlaceForAClientHoweverOftenTheyAreToComeAgain) {
  JobQueue queue(2, 0);
  {
    JobQueue::QueueSlot first = queue.admit(client("a"));
    JobQueue::QueueSlot second = queue.admit(client("a"));
    first.reserve_for_client();
    second.reserve_for_client();
  }
  { const JobQueue::QueueSlot other = queue.admit(client("b")); }
}

// Connections that are told to come again, and do not: as long as there are places, nobody waits
// for them.
TEST(JobQueue, KeepsNoneOfManyFreePlaces) {
  JobQueue queue(2, 6);
  for (int i = 0; i < 100; ++i) queue.admit(client(std::to_string(i))).reserve_for_client();
  std::vector<JobQueue::QueueSlot> places;
  for (int i = 0; i < 7; ++i) places.push_back(queue.admit(client("another")));
}

// Few of those who were refused may ever come again.
TEST(JobQueue, KeepsNoThreadForWhoIsToComeAgain) {
  JobQueue queue(1, 4);
  Blocker blocker(queue);
  for (const char* name : {"b", "c", "d", "e"}) submit(queue, {{}, [] {}, [] {}}, client(name));
  for (int i = 0; i < 50; ++i) EXPECT_THROW(queue.admit(client(std::to_string(i))), StatusError);
  blocker.release();
  ASSERT_TRUE(testing::eventually([&] { return queue.running() + queue.waiting() == 0; }));
  queue.admit(client("new"));
}

TEST(JobQueue, KeepsOnePlaceForAllConnectionsOfAnother) {
  JobQueue queue(1, 3);
  Blocker blocker(queue);
  for (const char* name : {"b", "c", "d"}) submit(queue, {{}, [] {}, [] {}}, client(name));
  for (const char* name : {"x1", "x2", "x3"}) EXPECT_THROW(queue.admit({"x", name}), StatusError);
  EXPECT_THROW(queue.admit(client("y")), StatusError);
  blocker.release();
  ASSERT_TRUE(testing::eventually([&] { return queue.running() + queue.waiting() == 0; }));
  const JobQueue::QueueSlot of_x = queue.admit({"x", "x1"});
  queue.admit(client("y"));
}

// Jobs that note who they are of, in the order in which they run.
class Ledger {
 public:
  explicit Ledger(JobQueue& queue) : queue_(queue) {}

  // False if there was no place.
  bool add(const QueueClient& from, const std::string& name) {
    try {
      submit(queue_, {.stop = {}, .run = [this, name] { ran_ += name + " "; }, .drop = [] {}},
             from);
      return true;
    } catch (const StatusError&) {
      return false;
    }
  }

  // After drain().
  const std::string& ran() const { return ran_; }

 private:
  JobQueue& queue_;
  std::string ran_;
};

TEST(JobQueue, RunsNextWhoseTurnWasLongestAgo) {
  JobQueue queue(1, 5);
  Ledger ledger(queue);
  Blocker blocker(queue);
  for (const char* name : {"a", "a", "a", "b", "c"}) ledger.add(client(name), name);
  blocker.release();
  drain(queue);
  EXPECT_EQ(ledger.ran(), "b c a a a ");
}

// More connections are not more turns; between those of one, turns are as fair.
TEST(JobQueue, TakesTurnsOfClientsAndThenOfTheirConnections) {
  JobQueue queue(1, 20);
  Ledger ledger(queue);
  Blocker blocker(queue);  // of "a"
  for (const char* connection : {"x1", "x1", "x1", "x2", "x2", "x3"}) {
    ledger.add({"x", connection}, connection);
  }
  for (int i = 0; i < 2; ++i) ledger.add(client("y"), "y");
  blocker.release();
  drain(queue);
  EXPECT_EQ(ledger.ran(), "x1 y x2 y x3 x1 x2 x1 ");
}

// If there are more than a thousand, the one who was served longest ago counts as new; the others
// keep their turns.
TEST(JobQueue, RemembersTheLatestThousandClients) {
  JobQueue queue(1, 5);
  const auto serve = [&](const std::string& name) {
    submit(queue, {{}, [] {}, [] {}}, client(name));
    ASSERT_TRUE(testing::eventually([&] { return queue.running() + queue.waiting() == 0; }));
  };
  for (int i = 0; i < 1500; ++i) serve(std::to_string(i));
  Ledger ledger(queue);
  Blocker blocker(queue);
  ledger.add(client("new"), "new");
  ledger.add(client("1000"), "known");
  blocker.release();
  drain(queue);
  EXPECT_EQ(ledger.ran(), "known new ");
}

// Each of whom comes when the one before is served.
TEST(JobQueue, NewcomersDoNotKeepOthersWaiting) {
  JobQueue queue(1, 5);
  Ledger ledger(queue);
  Blocker blocker(queue);  // of "a"
  ledger.add(client("a"), "a");
  std::promise<void> last_came;
  const std::function<void(int)> come = [&](int number) {
    submit(queue,
           {{},
            [&, number] {
              ledger.add(client(std::to_string(number)), std::to_string(number));
              number < 3 ? come(number + 1) : last_came.set_value();
            },
            [] {}},
           client("new " + std::to_string(number)));
  };
  come(1);
  blocker.release();
  last_came.get_future().wait();
  drain(queue);
  EXPECT_TRUE(ledger.ran().starts_with("a ")) << ledger.ran();
}

// Whoever comes first.
TEST(JobQueue, LetsNobodyHaveMoreThanIsFreeWhileOthersAreThere) {
  JobQueue queue(1, 9);
  Ledger ledger(queue);
  Blocker blocker(queue);  // of "a", as what follows
  for (int i = 0; i < 6; ++i) EXPECT_TRUE(ledger.add(client("a"), "a"));
  EXPECT_TRUE(ledger.add(client("b"), "b"));
  EXPECT_FALSE(ledger.add(client("a"), "a")) << "it has seven of ten, and two are free";
  EXPECT_FALSE(ledger.add({"a", "another connection"}, "a"));
  EXPECT_TRUE(ledger.add(client("b"), "b"));
  EXPECT_FALSE(ledger.add(client("b"), "b")) << "it has two, and one is free";
  EXPECT_TRUE(ledger.add(client("c"), "c"));
  blocker.release();
  drain(queue);
  EXPECT_EQ(ledger.ran(), "b c a b a a a a a ");
}

TEST(JobQueue, LetsNoConnectionHaveMoreThanIsFreeWhileOthersOfTheSameClientAreThere) {
  JobQueue queue(1, 9);
  Ledger ledger(queue);
  Blocker blocker(queue, {"x", "first"});
  for (int i = 0; i < 6; ++i) EXPECT_TRUE(ledger.add({"x", "first"}, "1"));
  EXPECT_TRUE(ledger.add({"x", "second"}, "2"));
  EXPECT_FALSE(ledger.add({"x", "first"}, "1"));
  EXPECT_TRUE(ledger.add({"x", "second"}, "2"));
  blocker.release();
  drain(queue);
  EXPECT_EQ(ledger.ran(), "2 1 2 1 1 1 1 1 ");
}

double told_time(JobQueue& queue, const QueueClient& from) {
  try {
    queue.admit(from);
  } catch (const StatusError& error) {
    v1::Busy details;
    EXPECT_TRUE(details.ParseFromString(error.status().error_details()));
    return details.retry_after_seconds();
  }
  ADD_FAILURE() << "accepted";
  return 0;
}

// Each of the connections of one; all of another are one.
TEST(JobQueue, TellsWhoIsRefusedTheTimeOfTheirTurn) {
  JobQueue queue(1, 2);
  submit(queue, {{}, [] { std::this_thread::sleep_for(std::chrono::milliseconds(200)); }, [] {}});
  ASSERT_TRUE(testing::eventually([&] { return queue.running() + queue.waiting() == 0; }));
  Blocker blocker(queue);
  for (const char* name : {"b", "c"}) submit(queue, {{}, [] {}, [] {}}, client(name));
  const double first = told_time(queue, {"x", "x1"});
  EXPECT_GE(first, 0.2);
  for (const int turn : {2, 3, 4}) {
    EXPECT_DOUBLE_EQ(told_time(queue, {"x", "x" + std::to_string(turn)}), turn * first);
  }
  EXPECT_DOUBLE_EQ(told_time(queue, client("y")), 2 * first);
  EXPECT_DOUBLE_EQ(told_time(queue, {"x", "x1"}), first) << "it has its turn already";
  blocker.release();
}

}  // namespace
}  // namespace itn
