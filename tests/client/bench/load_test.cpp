// Load on a fake that holds every call until the test ends it.
#include "client/bench/load.h"

#include <gtest/gtest.h>

#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <utility>

#include "itn/v1/render.pb.h"
#include "tests/support/process.h"

namespace itn {
namespace {

using namespace std::chrono_literals;
using Clock = Load::Clock;

class HeldCalls {
 public:
  Load::StartCall start_call() {
    return [this](const std::stop_token& /*stop*/, Load::Done done) {
      const std::lock_guard lock(mutex_);
      ++made_;
      held_.push_back(std::move(done));
      changed_.notify_all();
    };
  }

  size_t made() const {
    const std::lock_guard lock(mutex_);
    return made_;
  }
  size_t held() const {
    const std::lock_guard lock(mutex_);
    return held_.size();
  }

  bool wait_until_made(size_t count) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, testing::kPatience, [&] { return made_ >= count; });
  }

  void end_one(const grpc::Status& status = grpc::Status::OK) {
    std::unique_lock lock(mutex_);
    const Load::Done done = std::move(held_.front());
    held_.pop_front();
    lock.unlock();
    done(status);
  }
  void end_all() {
    while (held() > 0) end_one(grpc::Status::CANCELLED);
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  size_t made_ = 0;
  std::deque<Load::Done> held_;
};

// The load, stopped at the end of the test, with the calls that it still waits for.
class RunningLoad {
 public:
  RunningLoad(const LoadOptions& options, HeldCalls& calls)
      : calls_(calls), load_(std::make_unique<Load>(options, calls.start_call())) {}
  ~RunningLoad() {
    std::jthread ending([this](const std::stop_token& stop) {
      while (!stop.stop_requested()) {
        calls_.end_all();
        std::this_thread::yield();
      }
    });
    load_.reset();
  }
  Load* operator->() const { return load_.get(); }

 private:
  HeldCalls& calls_;
  std::unique_ptr<Load> load_;
};

bool wait_until(auto time) {
  return testing::eventually([&] { return Clock::now() >= time; });
}

// A window of what has ended by now.
BenchWindow so_far(const RunningLoad& load, size_t calls) {
  return load->measure(0, calls, std::chrono::duration<double>(testing::kPatience).count(), {});
}

TEST(ClosedLoop, HasAsManyCallsUnderWayAsCallers) {
  HeldCalls calls;
  const RunningLoad load({.callers = 3}, calls);
  ASSERT_TRUE(calls.wait_until_made(3));
  for (size_t ended = 1; ended <= 10; ++ended) {
    EXPECT_EQ(calls.held(), 3U);
    calls.end_one();  // whose caller calls again at once
    EXPECT_EQ(calls.made(), 3 + ended);
  }
  const BenchWindow window = so_far(load, 10);
  EXPECT_EQ(window.answered(), 10U);
  EXPECT_EQ(window.ended(), 10U);
  EXPECT_EQ(so_far(load, 0).ended(), 0U) << "each call is in one window";
}

TEST(ClosedLoop, TellsWhatFailedByItsStatus) {
  HeldCalls calls;
  const RunningLoad load({.callers = 2}, calls);
  ASSERT_TRUE(calls.wait_until_made(2));
  v1::Busy busy;
  busy.set_retry_after_seconds(0.001);
  calls.end_one({grpc::StatusCode::UNAVAILABLE, "busy", busy.SerializeAsString()});
  calls.end_one({grpc::StatusCode::INTERNAL, "broken"});
  ASSERT_TRUE(calls.wait_until_made(4)) << "both call again, a little later";
  calls.end_one({grpc::StatusCode::UNAVAILABLE, "gone"});
  const BenchWindow window = so_far(load, 3);
  EXPECT_EQ(window.answered(), 0U);
  EXPECT_EQ(window.refused, 1U);
  EXPECT_EQ(window.failed.at("INTERNAL"), 1U);
  EXPECT_EQ(window.failed.at("UNAVAILABLE"), 1U);
}

TEST(ClosedLoop, WaitsAsLongAsABusyServerSays) {
  HeldCalls calls;
  const RunningLoad load({.callers = 2}, calls);
  ASSERT_TRUE(calls.wait_until_made(2));
  v1::Busy busy;
  busy.set_retry_after_seconds(3600);
  calls.end_one({grpc::StatusCode::UNAVAILABLE, "busy", busy.SerializeAsString()});
  calls.end_one();
  ASSERT_TRUE(calls.wait_until_made(3));
  EXPECT_EQ(calls.held(), 1U) << "the other's";
}

// The call that began when another ended is the last that ends, and is still being begun.
TEST(ClosedLoop, EndsWhenItsCallsHaveBegunAndEnded) {
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<Load::Done> held;
  bool may_go_on = false, destroyed = false;
  auto load = std::make_unique<Load>(LoadOptions{.callers = 1},
                                     [&](const std::stop_token& /*stop*/, Load::Done done) {
                                       std::unique_lock lock(mutex);
                                       const bool first = held.empty();
                                       held.push_back(std::move(done));
                                       changed.notify_all();
                                       changed.wait(lock, [&] { return first || may_go_on; });
                                     });
  const auto call = [&](size_t number) {
    std::unique_lock lock(mutex);
    changed.wait(lock, [&] { return held.size() > number; });
    return held[number];
  };
  std::jthread ends_the_first(call(0), grpc::Status::OK);
  const Load::Done end_second = call(1);
  std::jthread destroys([&] {
    load.reset();
    const std::lock_guard lock(mutex);
    destroyed = true;
    changed.notify_all();
  });
  end_second(grpc::Status::CANCELLED);
  std::unique_lock lock(mutex);
  EXPECT_FALSE(changed.wait_for(lock, 50ms, [&] { return destroyed; }));
  may_go_on = true;
  changed.notify_all();
  EXPECT_TRUE(changed.wait_for(lock, testing::kPatience, [&] { return destroyed; }));
}

TEST(OpenLoop, MakesCallsWhetherOrNotOthersEnd) {
  HeldCalls calls;
  const RunningLoad load({.rate = 1000}, calls);
  EXPECT_TRUE(calls.wait_until_made(50));
}

TEST(OpenLoop, HasNoMoreCallsUnderWayThanTheMost) {
  HeldCalls calls;
  const RunningLoad load({.rate = 1000, .max_outstanding = 4}, calls);
  for (size_t made = 4; made < 50; ++made) {
    ASSERT_TRUE(calls.wait_until_made(made));
    EXPECT_LE(calls.held(), 4U);
    calls.end_one();
  }
}

TEST(OpenLoop, TellsHowManyCallsWait) {
  HeldCalls calls;
  const RunningLoad load({.rate = 1000, .max_outstanding = 4}, calls);
  const auto after = Clock::now();  // the first was due before
  ASSERT_TRUE(calls.wait_until_made(4));
  ASSERT_TRUE(wait_until(after + 50ms));
  EXPECT_GE(so_far(load, 0).unfinished, 50U);
}

// The server answers none for a while, in which most calls wait for others to end: what their
// callers would have waited is in their latencies.
TEST(OpenLoop, CountsFromWhenACallWasDue) {
  constexpr double kRate = 200;
  constexpr size_t kCalls = 40;
  HeldCalls calls;
  const RunningLoad load({.rate = kRate, .max_outstanding = 2}, calls);
  const auto after = Clock::now();  // the first was due before
  const auto due = [&](size_t i) {
    return after + std::chrono::duration<double>(static_cast<double>(i) / kRate);
  };
  ASSERT_TRUE(calls.wait_until_made(2));
  ASSERT_TRUE(wait_until(due(kCalls)));
  const auto released = Clock::now();
  for (size_t i = 0; i < kCalls; ++i) {
    ASSERT_TRUE(calls.wait_until_made(i + 1));
    calls.end_one();
  }
  const BenchWindow window = so_far(load, kCalls);
  ASSERT_EQ(window.answered(), kCalls);
  for (size_t i = 0; i < kCalls; ++i) {
    EXPECT_GE(window.latencies[i], std::chrono::duration<double>(released - due(i)).count()) << i;
  }
  // The third was made when the first ended.
  EXPECT_GE(window.lateness[2], std::chrono::duration<double>(released - due(2)).count());
}

}  // namespace
}  // namespace itn
