#include "common/rpc/job_queue.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <memory>
#include <string>
#include <utility>

#include "common/error.h"
#include "common/rpc/status.h"
#include "itn/v1/render.pb.h"

namespace itn {
namespace {

void submit(JobQueue& queue, JobQueue::Job job, const std::string& peer = "a") {
  queue.submit(queue.admit(peer), std::move(job));
}

// Occupies a thread of the queue until told otherwise.
class Blocker {
 public:
  explicit Blocker(JobQueue& queue) {
    submit(queue, {{}, [this] { started_.set_value(), release_.get_future().wait(); }, [] {}});
    started_.get_future().wait();
  }
  void release() { release_.set_value(); }

 private:
  std::promise<void> started_, release_;
};

TEST(JobQueue, RefusesMoreThanItsCapacity) {
  std::atomic<int> done = 0;
  JobQueue queue(1, 2);
  Blocker blocker(queue);
  const auto add = [&] { submit(queue, {{}, [&] { ++done; }, [] {}}); };
  add();
  EXPECT_FALSE(queue.full());
  add();
  EXPECT_TRUE(queue.full());
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
  EXPECT_THROW(queue.admit("a"), Error);
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
    const JobQueue::Place place = queue.admit("a");
    EXPECT_TRUE(queue.full());
  }
  EXPECT_FALSE(queue.full());
}

// Who was refused comes before who asks all the time.
TEST(JobQueue, KeepsAFreePlaceForWhoWasRefusedFirst) {
  JobQueue queue(1, 0);
  {
    const JobQueue::Place place = queue.admit("greedy");
    EXPECT_THROW(queue.admit("polite"), StatusError);
    EXPECT_THROW(queue.admit("greedy"), StatusError);
  }
  EXPECT_THROW(queue.admit("greedy"), StatusError);
  EXPECT_THROW(queue.admit("third"), StatusError);
  { const JobQueue::Place place = queue.admit("polite"); }
  { const JobQueue::Place place = queue.admit("greedy"); }
  { const JobQueue::Place place = queue.admit("third"); }
}

TEST(JobQueue, KeepsThePlaceOfWhoWillComeAgainAtOnce) {
  JobQueue queue(1, 0);
  JobQueue::Place place = queue.admit("a");
  EXPECT_THROW(queue.admit("b"), StatusError);
  place.keep_for_peer();
  EXPECT_THROW(queue.admit("b"), StatusError);
  { const JobQueue::Place again = queue.admit("a"); }
  { const JobQueue::Place other = queue.admit("b"); }
}

TEST(JobQueue, KeepsOnePlaceForAPeerHoweverOftenItIsToComeAgain) {
  JobQueue queue(2, 0);
  {
    JobQueue::Place first = queue.admit("a");
    JobQueue::Place second = queue.admit("a");
    first.keep_for_peer();
    second.keep_for_peer();
  }
  { const JobQueue::Place other = queue.admit("b"); }
}

TEST(JobQueue, RunsNextWhoseTurnWasLongestAgo) {
  std::string order;
  JobQueue queue(1, 5);
  Blocker blocker(queue);
  for (const char* peer : {"a", "a", "a", "b", "c"}) {
    submit(queue, {{}, [&order, peer] { order += peer; }, [] {}}, peer);
  }
  blocker.release();
  queue.drain();
  EXPECT_EQ(order, "bcaaa");
}

}  // namespace
}  // namespace itn
