#include "common/rpc/job_queue.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <memory>

#include "common/error.h"

namespace itn {
namespace {

// Occupies a thread of the queue until told otherwise.
class Blocker {
 public:
  explicit Blocker(JobQueue& queue) {
    queue.submit({{}, [this] { started_.set_value(), release_.get_future().wait(); }, [] {}});
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
  const auto submit = [&] { queue.submit({{}, [&] { ++done; }, [] {}}); };
  submit();
  submit();
  try {
    submit();
    FAIL() << "accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::kUnavailable);
  }
  blocker.release();
  queue.drain();
  EXPECT_EQ(done, 2);
}

TEST(JobQueue, WithoutRoomToWaitStillRuns) {
  std::atomic<int> done = 0;
  JobQueue queue(1, 0);
  queue.submit({{}, [&] { ++done; }, [] {}});
  queue.drain();
  EXPECT_EQ(done, 1);
}

TEST(JobQueue, DropsStoppedJobsAndFreesTheirPlaces) {
  std::atomic<int> run = 0, dropped = 0;
  JobQueue queue(1, 1);
  Blocker blocker(queue);
  std::stop_source stop;
  queue.submit({stop.get_token(), [&] { ++run; }, [&] { ++dropped; }});
  stop.request_stop();
  queue.drop_stopped();
  EXPECT_EQ(dropped, 1);
  queue.submit({{}, [&] { ++run; }, [] {}});
  blocker.release();
  queue.drain();
  EXPECT_EQ(run, 1);
  EXPECT_EQ(dropped, 1);
}

TEST(JobQueue, TakesNothingOnceDrained) {
  JobQueue queue(2, 2);
  queue.drain();
  EXPECT_THROW(queue.submit({{}, [] {}, [] {}}), Error);
}

TEST(JobQueue, DropsWhatWaitsWhenItGoesAway) {
  std::atomic<int> dropped = 0;
  auto queue = std::make_unique<JobQueue>(1, 1);
  Blocker blocker(*queue);
  queue->submit({{},
                 [] {},
                 [&] {
                   ++dropped;
                   blocker.release();
                 }});
  queue.reset();
  EXPECT_EQ(dropped, 1);
}

}  // namespace
}  // namespace itn
