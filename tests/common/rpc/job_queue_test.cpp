#include "common/rpc/job_queue.h"

#include <gtest/gtest.h>

#include <atomic>
#include <functional>
#include <future>
#include <memory>
#include <string>
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

// Occupies a thread of the queue until told otherwise.
class Blocker {
 public:
  explicit Blocker(JobQueue& queue) {
    submit(queue, {{},
                   [state = state_] {
                     state->started.set_value();
                     state->release.get_future().wait();
                   },
                   [] {}});
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
  queue.drain();
  EXPECT_EQ(done, 2);
}

TEST(JobQueue, WithoutRoomToWaitStillRuns) {
  std::atomic<int> done = 0;
  JobQueue queue(1, 0);
  submit(queue, {{}, [&] { ++done; }, [] {}});
  queue.drain();
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
  queue.drain();
  EXPECT_EQ(run, 1);
  EXPECT_EQ(dropped, 1);
}

TEST(JobQueue, TakesNothingOnceDrained) {
  JobQueue queue(2, 2);
  queue.drain();
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
    const JobQueue::Place place = queue.admit(client("a"));
    EXPECT_THROW(queue.admit(client("b")), StatusError);
  }
  queue.admit(client("b"));
}

// Who was refused comes before who asks all the time.
TEST(JobQueue, KeepsAFreePlaceForWhoWasRefusedFirst) {
  JobQueue queue(1, 0);
  {
    const JobQueue::Place place = queue.admit(client("greedy"));
    EXPECT_THROW(queue.admit(client("polite")), StatusError);
    EXPECT_THROW(queue.admit(client("greedy")), StatusError);
  }
  EXPECT_THROW(queue.admit(client("greedy")), StatusError);
  EXPECT_THROW(queue.admit(client("third")), StatusError);
  { const JobQueue::Place place = queue.admit(client("polite")); }
  { const JobQueue::Place place = queue.admit(client("greedy")); }
  { const JobQueue::Place place = queue.admit(client("third")); }
}

TEST(JobQueue, KeepsThePlaceOfWhoWillComeAgainAtOnce) {
  JobQueue queue(1, 0);
  JobQueue::Place place = queue.admit(client("a"));
  EXPECT_THROW(queue.admit(client("b")), StatusError);
  place.keep_for_client();
  EXPECT_THROW(queue.admit(client("b")), StatusError);
  { const JobQueue::Place again = queue.admit(client("a")); }
  { const JobQueue::Place other = queue.admit(client("b")); }
}

TEST(JobQueue, KeepsOnePlaceForAClientHoweverOftenTheyAreToComeAgain) {
  JobQueue queue(2, 0);
  {
    JobQueue::Place first = queue.admit(client("a"));
    JobQueue::Place second = queue.admit(client("a"));
    first.keep_for_client();
    second.keep_for_client();
  }
  { const JobQueue::Place other = queue.admit(client("b")); }
}

// Connections that are told to come again, and do not: as long as there are places, nobody waits
// for them.
TEST(JobQueue, KeepsNoneOfManyFreePlaces) {
  JobQueue queue(2, 6);
  for (int i = 0; i < 100; ++i) queue.admit(client(std::to_string(i))).keep_for_client();
  std::vector<JobQueue::Place> places;
  for (int i = 0; i < 7; ++i) places.push_back(queue.admit(client("another")));
}

// Of who was refused, few may ever come again.
TEST(JobQueue, KeepsNoThreadForWhoIsToComeAgain) {
  JobQueue queue(1, 4);
  Blocker blocker(queue);
  for (const char* name : {"b", "c", "d", "e"}) submit(queue, {{}, [] {}, [] {}}, client(name));
  for (int i = 0; i < 50; ++i) {
    EXPECT_THROW(queue.admit(client(std::to_string(i))), StatusError);
  }
  blocker.release();
  ASSERT_TRUE(testing::eventually([&] { return queue.running() + queue.waiting() == 0; }));
  queue.admit(client("new"));
}

TEST(JobQueue, KeepsOnePlaceForAllConnectionsOfAnother) {
  JobQueue queue(1, 3);
  Blocker blocker(queue);
  for (const char* name : {"b", "c", "d"}) submit(queue, {{}, [] {}, [] {}}, client(name));
  for (const char* name : {"x1", "x2", "x3"}) {
    EXPECT_THROW(queue.admit({"x", name}), StatusError);
  }
  EXPECT_THROW(queue.admit(client("y")), StatusError);
  blocker.release();
  ASSERT_TRUE(testing::eventually([&] { return queue.running() + queue.waiting() == 0; }));
  const JobQueue::Place of_x = queue.admit({"x", "x1"});
  queue.admit(client("y"));
}

// Jobs that note who they are of, in the order in which they run, or that they were refused.
class Ledger {
 public:
  explicit Ledger(JobQueue& queue) : queue_(queue) {}

  // False if there was no place.
  bool add(const QueueClient& from, const std::string& name) {
    try {
      submit(queue_,
             {.stop = {},
              .run = [this, name] { ran_ += name + " "; },
              .drop = [] {},
              .refuse =
                  [this, name](const StatusError& busy) {
                    v1::Busy details;
                    EXPECT_TRUE(details.ParseFromString(busy.status().error_details()));
                    EXPECT_GT(details.retry_after_seconds(), 0);
                    refused_ += name + " ";
                  }},
             from);
      return true;
    } catch (const StatusError&) {
      return false;
    }
  }

  // After drain().
  const std::string& ran() const { return ran_; }
  const std::string& refused() const { return refused_; }

 private:
  JobQueue& queue_;
  std::string ran_, refused_;
};

TEST(JobQueue, RunsNextWhoseTurnWasLongestAgo) {
  JobQueue queue(1, 5);
  Ledger ledger(queue);
  Blocker blocker(queue);
  for (const char* name : {"a", "a", "a", "b", "c"}) ledger.add(client(name), name);
  blocker.release();
  queue.drain();
  EXPECT_EQ(ledger.ran(), "b c a a a ");
}

// More connections are not more turns; between those of one, turns are as fair.
TEST(JobQueue, TakesTurnsOfClientsAndThenOfTheirConnections) {
  JobQueue queue(1, 8);
  Ledger ledger(queue);
  Blocker blocker(queue);  // of "a"
  for (const char* connection : {"x1", "x1", "x1", "x2", "x2", "x3"}) {
    ledger.add({"x", connection}, connection);
  }
  for (int i = 0; i < 2; ++i) ledger.add(client("y"), "y");
  blocker.release();
  queue.drain();
  EXPECT_EQ(ledger.ran(), "x1 y x2 y x3 x1 x2 x1 ");
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
  queue.drain();
  EXPECT_TRUE(ledger.ran().starts_with("a ")) << ledger.ran();
}

TEST(JobQueue, GivesWhoHasFewAPlaceOfWhoHasMost) {
  JobQueue queue(1, 4);
  Ledger ledger(queue);
  Blocker blocker(queue);  // of "a", as what follows
  for (const char* name : {"a1", "a2", "a3", "a4"}) EXPECT_TRUE(ledger.add(client("a"), name));
  EXPECT_FALSE(ledger.add(client("a"), "a5"));
  EXPECT_TRUE(ledger.add(client("b"), "b1"));
  EXPECT_EQ(ledger.refused(), "a4 ");
  EXPECT_TRUE(ledger.add(client("b"), "b2"));
  EXPECT_EQ(ledger.refused(), "a4 a3 ") << "a has three places, b two";
  EXPECT_FALSE(ledger.add(client("b"), "b3")) << "it would have more than a";
  EXPECT_EQ(queue.waiting(), 4U);
  blocker.release();
  queue.drain();
  EXPECT_EQ(ledger.ran(), "b1 a1 b2 a2 ");
}

TEST(JobQueue, GivesAConnectionAPlaceOfAnotherOfTheSameClient) {
  JobQueue queue(1, 3);
  Ledger ledger(queue);
  Blocker blocker(queue);
  for (const char* name : {"1", "2", "3"}) EXPECT_TRUE(ledger.add({"a", "first"}, name));
  EXPECT_TRUE(ledger.add({"a", "second"}, "4"));
  EXPECT_EQ(ledger.refused(), "3 ");
  blocker.release();
  queue.drain();
  EXPECT_EQ(ledger.ran(), "1 4 2 ");
}

// Although another client has more, but not two more than these have together.
TEST(JobQueue, GivesAConnectionAPlaceOfAnotherWhoeverHasMost) {
  JobQueue queue(1, 6);
  Ledger ledger(queue);
  Blocker blocker(queue);  // of "a"
  for (const char* name : {"a1", "a2", "a3"}) EXPECT_TRUE(ledger.add(client("a"), name));
  for (const char* name : {"1", "2", "3"}) EXPECT_TRUE(ledger.add({"b", "first"}, name));
  EXPECT_TRUE(ledger.add({"b", "second"}, "4"));
  EXPECT_EQ(ledger.refused(), "3 ");
  blocker.release();
  queue.drain();
}

// A place was free when the job came that was to take another's.
TEST(JobQueue, TakesNoPlaceAwayThatIsNotNeeded) {
  JobQueue queue(2, 2);
  Ledger ledger(queue);
  Blocker first(queue), second(queue);
  std::promise<void> third_runs, release_third;
  submit(queue, {{}, [&] { third_runs.set_value(), release_third.get_future().wait(); }, [] {}});
  EXPECT_TRUE(ledger.add(client("a"), "a4"));
  JobQueue::Place place = queue.admit(client("b"));
  first.release();
  third_runs.get_future().wait();
  queue.submit(std::move(place), {{}, [] {}, [] {}});
  EXPECT_EQ(ledger.refused(), "");
  second.release();
  release_third.set_value();
  queue.drain();
}

TEST(JobQueue, PromisesEachPlaceOnce) {
  JobQueue queue(1, 1);
  Ledger ledger(queue);
  Blocker blocker(queue);
  EXPECT_TRUE(ledger.add(client("a"), "a1"));
  const JobQueue::Place place = queue.admit(client("b"));
  EXPECT_THROW(queue.admit(client("c")), StatusError);
  blocker.release();
  queue.drain();
}

// What is admitted and then found to be wrong costs nobody a place.
TEST(JobQueue, TakesNoPlaceAwayBeforeThereIsAJobForIt) {
  JobQueue queue(1, 3);
  Ledger ledger(queue);
  Blocker blocker(queue);
  for (const char* name : {"a1", "a2", "a3"}) ledger.add(client("a"), name);
  { const JobQueue::Place place = queue.admit(client("b")); }
  EXPECT_EQ(ledger.refused(), "");
  {
    JobQueue::Place place = queue.admit(client("b"));
    place.keep_for_client();
  }
  EXPECT_EQ(ledger.refused(), "");
  blocker.release();
  queue.drain();
  EXPECT_EQ(ledger.ran(), "a1 a2 a3 ");
}

TEST(JobQueue, TakesNoPlaceAwayFromAJobThatRuns) {
  JobQueue queue(1, 0);
  Blocker blocker(queue);
  EXPECT_THROW(queue.admit(client("b")), StatusError);
  blocker.release();
}

}  // namespace
}  // namespace itn
