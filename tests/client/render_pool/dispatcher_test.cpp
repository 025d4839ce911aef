// The rules of the pool, with a clock that the test moves.
#include "client/render_pool/dispatcher.h"
#include "client/render_pool/outcome.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <future>
#include <limits>
#include <memory>
#include <string>

#include "tests/support/captured_log.h"
#include "tests/support/expect_error.h"
#include "tests/support/fake_worker.h"
#include "tests/support/scenes.h"

namespace itn {
namespace {

using namespace std::chrono_literals;
using grpc::StatusCode;
using namespace testing;
using ::testing::HasSubstr;
using ::testing::Not;

using Attempt = std::shared_ptr<Dispatcher::Attempt>;
using Future = std::future<v1::RenderGradReply>;

RenderJob render(uint64_t seed = 1) {
  RenderJob job;
  job.scene = serialize(testing::cube_scene());
  job.request = testing::small_request();
  job.request.set_seed(seed);
  return job;
}

Answer failure(const grpc::Status& status) {
  return {.outcome = outcome_of(status), .status = status, .reply = {}};
}

Answer failure(StatusCode code, const std::string& message = "oh") {
  return failure(grpc::Status(code, message));
}

Answer answer(double loss = 1) {
  Answer answer{.outcome = Outcome::kAnswered, .status = {}, .reply = {}};
  answer.reply.set_loss(loss);
  return answer;
}

bool is_ready(const Future& future) {
  return future.wait_for(0s) == std::future_status::ready;
}

// Dispatches to workers a, b, ..., all up.
class DispatcherTest : public ::testing::Test {
 protected:
  Dispatcher& workers(size_t count) {
    dispatcher = std::make_unique<Dispatcher>(30s);
    for (size_t i = 0; i < count; ++i) {
      dispatcher->add(std::string("worker ") + static_cast<char>('a' + i));
      come_up(i);
    }
    return *dispatcher;
  }
  void come_up(size_t worker, const v1::Capabilities& capabilities = {}) {
    dispatcher->on_probe(worker, grpc::Status::OK, capabilities, now);
  }
  void go_down(size_t worker) {
    dispatcher->on_probe(worker, {StatusCode::UNAVAILABLE, "not there"}, {}, now);
  }
  Future submit(uint64_t seed = 1) { return dispatcher->submit(render(seed), now); }
  Attempt next(size_t worker) { return dispatcher->next(worker, now).attempt; }
  bool finish(const Attempt& attempt, Answer answer) {
    return dispatcher->finish(attempt, std::move(answer), now);
  }

  std::unique_ptr<Dispatcher> dispatcher;
  Dispatcher::Clock::time_point now{1h};
};

TEST_F(DispatcherTest, GivesRendersInTheirOrder) {
  workers(1);
  Future first = submit(1);
  Future second = submit(2);
  const Attempt a = next(0), b = next(0);
  EXPECT_EQ(a->render().request.seed(), 1U);
  EXPECT_EQ(b->render().request.seed(), 2U);
  EXPECT_EQ(next(0), nullptr);
  finish(b, answer(2));
  finish(a, answer(1));
  EXPECT_EQ(first.get().loss(), 1);
  EXPECT_EQ(second.get().loss(), 2);
  EXPECT_EQ(dispatcher->statistics().jobs, 2U);
}

TEST_F(DispatcherTest, WaitsForABusyWorkerAsLongAsItSaysSo) {
  workers(1);
  const CapturedLog log;
  Future future = submit();
  for (int i = 0; i < 100; ++i) {  // of 2 s each: longer than anything is given up after
    const Attempt attempt = next(0);
    ASSERT_TRUE(attempt);
    EXPECT_FALSE(finish(attempt, failure(busy(2))));
    const Dispatcher::Turn turn = dispatcher->next(0, now);
    EXPECT_EQ(turn.attempt, nullptr);
    EXPECT_GE(turn.until - now, 2s);
    EXPECT_LE(turn.until - now, 2200ms);
    now = turn.until;
  }
  finish(next(0), answer());
  EXPECT_EQ(future.get().loss(), 1);
  EXPECT_EQ(dispatcher->statistics().retries, 0U);
  EXPECT_THAT(log.text(), HasSubstr("worker a: this worker is busy; waiting for a place"));
}

TEST_F(DispatcherTest, DoesNotSayThatItWaitsWhileItsOwnRendersFillTheWorker) {
  workers(1);
  const CapturedLog log;
  submit(1);
  Future second = submit(2);
  const Attempt a = next(0), b = next(0);
  finish(b, failure(busy(10)));
  EXPECT_EQ(next(0), nullptr);
  finish(a, answer());  // leaves its place
  const Attempt again = next(0);
  ASSERT_TRUE(again);
  finish(again, answer(2));
  EXPECT_EQ(second.get().loss(), 2);
  EXPECT_EQ(log.text(), "");
}

TEST_F(DispatcherTest, TriesACancelledRenderElsewhere) {
  workers(2);
  Future future = submit();
  EXPECT_TRUE(finish(next(0), failure(StatusCode::CANCELLED)));
  EXPECT_EQ(next(0), nullptr);  // it rests
  finish(next(1), answer());
  EXPECT_EQ(future.get().loss(), 1);
}

TEST_F(DispatcherTest, TriesWhatAWorkerCannotDoOnAnother) {
  for (const StatusCode code : {StatusCode::INTERNAL, StatusCode::UNKNOWN, StatusCode::ABORTED,
                                StatusCode::DATA_LOSS, StatusCode::RESOURCE_EXHAUSTED}) {
    workers(2);
    Future future = submit();
    finish(next(0), failure(code));
    come_up(0);
    EXPECT_EQ(next(0), nullptr) << code;  // not the same one again
    finish(next(1), answer());
    EXPECT_EQ(future.get().loss(), 1);
  }
}

TEST_F(DispatcherTest, FailsWhatNoWorkerCanDo) {
  workers(2);
  Future future = submit();
  finish(next(0), failure(StatusCode::RESOURCE_EXHAUSTED, "too large"));
  EXPECT_FALSE(is_ready(future));
  finish(next(1), failure(StatusCode::INTERNAL, "a fault"));
  expect_error(ErrorKind::kLimit, {"worker a: too large", "worker b: a fault"},
               [&] { future.get(); });
}

TEST_F(DispatcherTest, FailsWhatThreeWorkersCannotDo) {
  workers(5);
  Future future = submit();
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_FALSE(is_ready(future));
    finish(next(i), failure(StatusCode::RESOURCE_EXHAUSTED, "out of memory"));
  }
  expect_error(ErrorKind::kLimit, {"worker a: ", "worker b: ", "worker c: out of memory"},
               [&] { future.get(); });
}

TEST_F(DispatcherTest, EndsAtOnceWhatIsWrong) {
  workers(2);
  Future future = submit();
  finish(next(0), failure(StatusCode::INVALID_ARGUMENT, "albedo is 2"));
  expect_error(ErrorKind::kInvalidInput, {"worker a: albedo is 2"}, [&] { future.get(); });
}

TEST_F(DispatcherTest, SetsAsideAWorkerWhoseAnswerCannotBeRight) {
  workers(2);
  const CapturedLog log;
  Future future = submit();
  Answer faulty = failure(StatusCode::INTERNAL, "the loss is nan");
  faulty.outcome = Outcome::kBadReply;
  EXPECT_FALSE(finish(next(0), faulty));  // nobody asks after it any more
  come_up(0);
  Future another = submit(2);
  EXPECT_EQ(next(0), nullptr);
  finish(next(1), answer(1));
  finish(next(1), answer(2));
  EXPECT_EQ(future.get().loss(), 1);
  EXPECT_EQ(another.get().loss(), 2);
  EXPECT_THAT(log.text(), HasSubstr("worker a: the loss is nan; it is set aside"));
}

TEST_F(DispatcherTest, FailsEverythingWhenAllWorkersAreSetAside) {
  workers(1);
  Future future = submit(1), waiting = submit(2);
  Answer faulty = failure(StatusCode::INTERNAL, "the loss is nan");
  faulty.outcome = Outcome::kBadReply;
  finish(next(0), faulty);
  expect_error(ErrorKind::kInternal, {"worker a: the loss is nan"}, [&] { future.get(); });
  Future stragglers = submit(3);
  for (Future* other : {&waiting, &stragglers}) {
    expect_error(ErrorKind::kUnavailable, {"no render worker is left (worker a: the loss is nan)"},
                 [&] { other->get(); });
  }
}

TEST_F(DispatcherTest, GivesUpARenderThatThreeWorkersDiedOf) {
  workers(4);
  Future poison = submit(77);
  for (size_t i = 0; i < 3; ++i) {
    const Attempt attempt = next(i);
    ASSERT_TRUE(attempt);
    EXPECT_EQ(attempt->suspect, i > 0);
    finish(attempt, failure(StatusCode::UNAVAILABLE, "Socket closed"));
  }
  expect_error(
      ErrorKind::kUnavailable,
      {"16 x 12 pixels, 8 spp, sigma_t 8, albedo 0.9, g 0.3, seed 77",
       "was lost 3 times and is given up", "worker a: Socket closed", "worker c: Socket closed"},
      [&] { poison.get(); });
  Future harmless = submit();
  finish(next(3), answer());
  EXPECT_EQ(harmless.get().loss(), 1);
}

TEST_F(DispatcherTest, DoesNotBlameARenderThatOnlyWaitedInAWorker) {
  workers(1);
  Future rendered = submit(1), behind = submit(2);
  for (int i = 0; i < 3; ++i) {
    const Attempt a = next(0), b = next(0);
    finish(b, failure(StatusCode::UNAVAILABLE, "Socket closed"));
    finish(a, failure(StatusCode::UNAVAILABLE, "Socket closed"));
    come_up(0);
  }
  EXPECT_TRUE(is_ready(rendered));
  finish(next(0), answer(2));
  EXPECT_EQ(behind.get().loss(), 2);
}

// In whatever order the pool is told of them.
TEST_F(DispatcherTest, DoesNotBlameARenderThatIsLostAfterTheOneBeforeIt) {
  workers(1);
  Future rendered = submit(1), behind = submit(2);
  for (int i = 0; i < 3; ++i) {
    const Attempt a = next(0), b = next(0);
    ASSERT_TRUE(a && b);
    finish(a, failure(StatusCode::UNAVAILABLE, "Socket closed"));
    finish(b, failure(StatusCode::UNAVAILABLE, "Socket closed"));
    come_up(0);
  }
  EXPECT_FALSE(is_ready(rendered) || is_ready(behind));  // not given up
  for (const Attempt& attempt : {next(0), next(0)}) {
    ASSERT_TRUE(attempt);
    finish(attempt, answer());
  }
  EXPECT_EQ(rendered.get().loss() + behind.get().loss(), 2);
}

// A worker that was thought lost, and was not, renders what waited in it.
TEST_F(DispatcherTest, BlamesARenderThatHasWaitedAndIsLostLater) {
  workers(1);
  Future slow = submit(1), poison = submit(2);
  for (int i = 0; i < 3; ++i) {
    const Attempt a = next(0), b = next(0);
    finish(a, failure(StatusCode::DEADLINE_EXCEEDED, "too slow"));
    come_up(0);
    finish(b, failure(StatusCode::UNAVAILABLE, "Socket closed"));
    come_up(0);
  }
  EXPECT_TRUE(is_ready(slow) && is_ready(poison));
}

TEST_F(DispatcherTest, DoesNotBlameARenderForWorkersThatStop) {
  workers(1);
  Future future = submit();
  for (int i = 0; i < 10; ++i) {
    finish(next(0), failure(StatusCode::CANCELLED));
    come_up(0);
  }
  finish(next(0), answer());
  EXPECT_EQ(future.get().loss(), 1);
}

TEST_F(DispatcherTest, GivesUpWhenNoWorkerThatCouldDoItAnswers) {
  workers(2);
  now += 1h;
  go_down(1);
  now += 1h;
  Future future = submit();
  finish(next(0), failure(StatusCode::RESOURCE_EXHAUSTED, "too large"));
  now += 29s;
  go_down(1);
  EXPECT_FALSE(is_ready(future));
  now += 1s;
  Future other = submit(2);  // succeeds meanwhile
  finish(next(0), answer());
  go_down(1);
  EXPECT_EQ(other.get().loss(), 1);
  expect_error(ErrorKind::kLimit, {"worker a: too large"}, [&] { future.get(); });
}

TEST_F(DispatcherTest, GivesUpWhenAllWorkersStayAway) {
  workers(2);
  Future future = submit();
  go_down(0);
  go_down(1);
  now += 29s;
  go_down(0);
  EXPECT_FALSE(is_ready(future));
  now += 1s;
  go_down(1);
  expect_error(
      ErrorKind::kUnavailable,
      {"no render worker has answered for 30 s (worker a: not there; worker b: not there)"},
      [&] { future.get(); });
}

TEST_F(DispatcherTest, GivesAWorkerNothingThatIsTooLargeForIt) {
  workers(2);
  v1::Capabilities small, large;
  small.set_max_pixels(16 * 12 - 1);
  large.set_max_pixels(16 * 12);
  come_up(0, small);
  come_up(1, large);
  Future future = submit();
  EXPECT_EQ(next(0), nullptr);
  EXPECT_NE(next(1), nullptr);
}

TEST_F(DispatcherTest, LetsAWorkerSayWhyNoneCanDoIt) {
  workers(2);
  v1::Capabilities small;
  small.set_max_spp(1);
  come_up(0, small);
  come_up(1, small);
  Future future = submit();
  EXPECT_NE(next(0), nullptr);
}

// The other worker has never said what it can do, and is not there to do it.
TEST_F(DispatcherTest, DoesNotWaitForeverForALargerWorkerThatIsNotThere) {
  workers(2);
  v1::Capabilities small;
  small.set_max_spp(1);
  come_up(0, small);
  go_down(1);
  Future future = submit();
  const Attempt attempt = next(0);
  ASSERT_NE(attempt, nullptr);
  finish(attempt, failure(StatusCode::RESOURCE_EXHAUSTED, "too many samples"));
  now += 30s;
  go_down(1);
  expect_error(ErrorKind::kLimit, {"worker a: too many samples"}, [&] { future.get(); });
}

TEST_F(DispatcherTest, WaitsNeitherForDaysNorNotAtAll) {
  for (const double seconds : {1e300, std::numeric_limits<double>::infinity(), 1e-9}) {
    v1::Busy busy;
    busy.set_retry_after_seconds(seconds);
    const auto wait = retry_after({StatusCode::UNAVAILABLE, "busy", busy.SerializeAsString()});
    ASSERT_TRUE(wait.has_value());
    EXPECT_GE(*wait, 1ms);
    EXPECT_LE(*wait, 1h);
  }
}

TEST_F(DispatcherTest, GivesALateRenderToAnIdleWorker) {
  workers(2);
  for (int i = 0; i < 5; ++i) {  // a second each
    submit();
    const Attempt attempt = next(1);
    now += 1s;
    finish(attempt, answer());
  }
  Future future = submit();
  const Attempt held = next(0);
  EXPECT_EQ(next(1), nullptr);
  Dispatcher::Stragglers stragglers = dispatcher->stragglers(now);
  EXPECT_EQ(stragglers.count, 0U);
  EXPECT_EQ(stragglers.next - now, 4s);
  now = stragglers.next;
  EXPECT_EQ(dispatcher->stragglers(now).count, 1U);
  const Attempt second = next(1);
  EXPECT_EQ(dispatcher->stragglers(now).count, 0U);
  ASSERT_TRUE(second);
  EXPECT_EQ(next(1), nullptr);  // two attempts are enough
  EXPECT_FALSE(held->stop.stop_requested());
  finish(second, answer(2));
  EXPECT_EQ(future.get().loss(), 2);
  EXPECT_TRUE(held->stop.stop_requested());
  EXPECT_TRUE(finish(held, failure(StatusCode::CANCELLED)));  // rests
  EXPECT_EQ(dispatcher->statistics().hedges, 1U);
  EXPECT_EQ(dispatcher->statistics().retries, 0U);
}

TEST_F(DispatcherTest, TakesTheAnswerOfALateWorkerThatIsFirstAfterAll) {
  workers(2);
  Future future = submit();
  const Attempt held = next(0);
  now += 1h;
  const Attempt second = next(1);
  finish(held, answer(1));
  EXPECT_EQ(future.get().loss(), 1);
  EXPECT_TRUE(second->stop.stop_requested());
  finish(second, answer(1));  // too late, and no matter
  EXPECT_EQ(dispatcher->statistics().jobs, 1U);
}

TEST_F(DispatcherTest, KeepsTheOtherAttemptWhenOneFails) {
  workers(2);
  Future future = submit();
  const Attempt held = next(0);
  now += 1h;
  finish(next(1), failure(StatusCode::UNAVAILABLE, "Socket closed"));
  EXPECT_FALSE(is_ready(future));
  finish(held, answer());
  EXPECT_EQ(future.get().loss(), 1);
}

TEST_F(DispatcherTest, LeavesNoSecondAttemptToAWorkerThatIsNotIdle) {
  workers(2);
  Future future = submit(1), other = submit(2);
  const Attempt a = next(0), b = next(1);
  now += 1h;
  EXPECT_EQ(next(1), nullptr);
  finish(b, answer());
  EXPECT_EQ(next(1), nullptr);  // an hour is the measure now
}

TEST_F(DispatcherTest, DerivesTheFirstDeadlineFromMeasuredTimes) {
  workers(1);
  submit();
  const Attempt first = next(0);
  EXPECT_EQ(first->deadline, 0ms);
  now += 2s;
  finish(first, answer());
  Future future = submit(2);
  const Attempt measured = next(0);
  EXPECT_EQ(measured->deadline, 60s);
  finish(measured, failure(StatusCode::DEADLINE_EXCEEDED, "no answer within 60 s"));
  come_up(0);
  const Attempt again = next(0);
  EXPECT_EQ(again->deadline, 0ms);  // that may have been too short
  finish(again, answer());
  EXPECT_EQ(future.get().loss(), 1);
}

Answer too_late() {
  return failure(StatusCode::DEADLINE_EXCEEDED, "no answer in time");
}

RenderJob render_of_samples(uint32_t spp) {
  RenderJob job = render();
  job.request.set_spp(spp);
  return job;
}

TEST_F(DispatcherTest, LeavesTimeForTheRendersBeforeIt) {
  workers(1);
  dispatcher->submit(render_of_samples(10), now);
  const Attempt measured = next(0);
  now += 2s;
  finish(measured, answer());
  dispatcher->submit(render_of_samples(100), now);
  dispatcher->submit(render_of_samples(10), now);
  EXPECT_EQ(next(0)->deadline, 600s);
  EXPECT_EQ(next(0)->deadline, 660s);
}

// A worker that is shared renders what others ask for first, for longer than a deadline and longer
// than anything is given up after; it lives, and says so.
TEST_F(DispatcherTest, WaitsForAWorkerThatRendersForOthers) {
  workers(1);
  submit();
  const Attempt measured = next(0);
  now += 10ms;
  finish(measured, answer());
  Future first = submit(1), second = submit(2);
  for (int i = 0; i < 2; ++i) {
    const Attempt a = next(0), b = next(0);
    ASSERT_TRUE(a && b);
    EXPECT_TRUE(a->deadline == 30s || b->deadline == 30s);
    now += 30s;
    finish(a, too_late());
    finish(b, too_late());
    now += 200ms;
    come_up(0);
    EXPECT_FALSE(is_ready(first) || is_ready(second)) << i;
  }
  const Attempt a = next(0), b = next(0);
  EXPECT_EQ(a->deadline, 0ms);
  EXPECT_EQ(b->deadline, 0ms);
  now += 40s;
  finish(a, answer(1));
  finish(b, answer(2));
  EXPECT_EQ(first.get().loss() + second.get().loss(), 3);
}

// What answers when it is asked, and never with a render, is given up in the end.
TEST_F(DispatcherTest, GivesUpARenderThatIsNeverAnswered) {
  workers(1);
  Future future = submit();
  for (int i = 0; i < 3; ++i) {
    const Attempt attempt = next(0);
    ASSERT_TRUE(attempt) << i;
    now += 1h;
    finish(attempt, too_late());
    come_up(0);
  }
  expect_error(ErrorKind::kUnavailable, {"lost 3 times"}, [&] { future.get(); });
}

// The network broke, or this machine stood still: that says little about the render.
TEST_F(DispatcherTest, CountsAttemptsThatAreLostTogetherOnce) {
  workers(2);
  Future future = submit();
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(is_ready(future)) << i;
    const Attempt first = next(0);
    now += 1h;
    const Attempt second = next(1);
    ASSERT_TRUE(first && second) << i;
    now += 1s;
    finish(first, failure(StatusCode::UNAVAILABLE, "Socket closed"));
    now += 1s;
    finish(second, failure(StatusCode::UNAVAILABLE, "Socket closed"));
    come_up(0);
    come_up(1);
  }
  expect_error(ErrorKind::kUnavailable, {"lost 3 times"}, [&] { future.get(); });
}

TEST_F(DispatcherTest, SaysOnceWhichWorkerWasNeverThere) {
  workers(2);
  const size_t absent = dispatcher->add("worker c");
  const CapturedLog log;
  go_down(absent);
  EXPECT_EQ(log.text(), "") << "it may be about to start";
  now += 6s;
  go_down(absent);
  EXPECT_THAT(log.text(), HasSubstr("worker c: not there; it is used when it answers"));
  const std::string said = log.text();
  now += 1h;
  go_down(absent);
  EXPECT_EQ(log.text(), said);
}

TEST_F(DispatcherTest, CountsNoRetryWhileAnotherAttemptIsUnderWay) {
  workers(2);
  Future future = submit();
  const Attempt first = next(0);
  now += 1h;
  const Attempt second = next(1);
  ASSERT_TRUE(second);
  const CapturedLog log;
  finish(first, failure(StatusCode::UNAVAILABLE));
  EXPECT_EQ(dispatcher->statistics().retries, 0U);
  EXPECT_THAT(log.text(), Not(HasSubstr("next free worker")));
  finish(second, answer());
  EXPECT_EQ(future.get().loss(), 1);
}

// ---- Workers that join and leave ---------------------------------------------------------------

TEST_F(DispatcherTest, WaitsForAWorkerToJoin) {
  workers(0);
  EXPECT_FALSE(dispatcher->has_workers());
  Future future = submit();
  now += 24h;
  Future another = submit(2);
  EXPECT_FALSE(is_ready(future) || is_ready(another));
  EXPECT_EQ(dispatcher->waiting(), 2U);
  const size_t joined = dispatcher->add("worker z");
  EXPECT_EQ(next(joined), nullptr);  // not before it has answered
  come_up(joined);
  EXPECT_TRUE(dispatcher->has_render_for(joined, now));
  finish(next(joined), answer(1));
  finish(next(joined), answer(2));
  EXPECT_EQ(future.get().loss() + another.get().loss(), 3);
}

TEST_F(DispatcherTest, TakesTheAnswerOfAWorkerThatHasLeft) {
  workers(1);
  Future future = submit(1), waiting = submit(2);
  const Attempt attempt = next(0);
  dispatcher->remove(0, now);
  EXPECT_FALSE(dispatcher->has_workers() || dispatcher->any_connected());
  EXPECT_FALSE(finish(attempt, answer(1)));
  EXPECT_EQ(future.get().loss(), 1);
  EXPECT_FALSE(is_ready(waiting));
  EXPECT_EQ(dispatcher->add("worker a"), 1U);  // back, as another one
}

TEST_F(DispatcherTest, GivesWhatAWorkerThatHasLeftLosesToAnother) {
  workers(2);
  Future rendered = submit(1), behind = submit(2);
  const Attempt a = next(0), b = next(0);
  dispatcher->remove(0, now);
  for (const Attempt& attempt : {a, b}) {
    EXPECT_FALSE(finish(attempt, failure(StatusCode::UNAVAILABLE, "Socket closed")));
  }
  const Attempt second = next(1), first = next(1);
  ASSERT_TRUE(first && second);
  EXPECT_TRUE(first->suspect);
  EXPECT_FALSE(second->suspect);  // it only waited
  finish(first, answer());
  finish(second, answer());
  EXPECT_EQ(rendered.get().loss() + behind.get().loss(), 2);
}

TEST_F(DispatcherTest, GivesWhatIsLateInAWorkerThatHasLeftToAnother) {
  workers(2);
  Future future = submit();
  const Attempt held = next(0);
  dispatcher->remove(0, now);
  now += 1h;
  finish(next(1), answer());
  EXPECT_EQ(future.get().loss(), 1);
  EXPECT_TRUE(held->stop.stop_requested());
  EXPECT_FALSE(finish(held, failure(StatusCode::CANCELLED)));
}

TEST_F(DispatcherTest, FailsWhatOnlyTheWorkerThatLeavesCouldHaveDone) {
  workers(2);
  Future future = submit();
  finish(next(0), failure(StatusCode::RESOURCE_EXHAUSTED, "too large"));
  EXPECT_FALSE(is_ready(future));
  dispatcher->remove(1, now);
  expect_error(ErrorKind::kLimit, {"worker a: too large"}, [&] { future.get(); });
}

TEST_F(DispatcherTest, CancelsEverythingWhenItIsClosed) {
  workers(1);
  Future under_way = submit(1), waiting = submit(2);
  const Attempt attempt = next(0);
  dispatcher->close();
  EXPECT_TRUE(attempt->stop.stop_requested());
  finish(attempt, failure(StatusCode::CANCELLED));
  for (Future* future : {&under_way, &waiting}) {
    expect_error(ErrorKind::kCancelled, {"closed"}, [&] { future->get(); });
  }
  EXPECT_EQ(next(0), nullptr);
}

}  // namespace
}  // namespace itn
