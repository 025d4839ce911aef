#include "common/rpc/call_statistics.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace itn {
namespace {

constexpr double kFirst = 1e-4;  // seconds

}  // namespace

// ---- LatencyCounts -----------------------------------------------------------------------------

void LatencyCounts::add(double seconds) {
  const double place = seconds > kFirst ? std::ceil(std::log2(seconds / kFirst) * kParts) : 0;
  ++counts_[static_cast<size_t>(std::min(place, static_cast<double>(counts_.size() - 1)))];
  ++count_;
  sum_ += seconds;
}

void LatencyCounts::add(const LatencyCounts& other) {
  for (size_t i = 0; i < counts_.size(); ++i) counts_[i] += other.counts_[i];
  count_ += other.count_;
  sum_ += other.sum_;
}

double LatencyCounts::quantile(double p) const {
  if (count_ == 0) return 0;
  const auto wanted = static_cast<uint64_t>(std::ceil(p * static_cast<double>(count_)));
  uint64_t below = 0;
  size_t place = 0;
  while (below + counts_[place] < wanted) below += counts_[place++];
  // The middle of its interval.
  return kFirst * std::exp2((static_cast<double>(place) - 0.5) / kParts);
}

v1::Quantiles LatencyCounts::quantiles() const {
  v1::Quantiles result;
  result.set_p50(quantile(0.5));
  result.set_p90(quantile(0.9));
  result.set_p99(quantile(0.99));
  return result;
}

v1::LatencyHistogram LatencyCounts::histogram() const {
  v1::LatencyHistogram result;
  result.add_counts(counts_.front());
  for (size_t octave = 0; octave < kOctaves; ++octave) {
    uint64_t count = 0;
    for (size_t part = 1; part <= kParts; ++part) count += counts_[octave * kParts + part];
    result.add_counts(count);
  }
  result.add_counts(counts_.back());
  result.set_sum_seconds(sum_);
  return result;
}

// ---- CallStatistics ----------------------------------------------------------------------------

int64_t CallStatistics::minute_of(Clock::time_point now) const {
  return std::chrono::duration_cast<std::chrono::minutes>(now - start_).count();
}

void CallStatistics::record(const CallRecord& call, Clock::time_point now) {
  const int64_t number = minute_of(now);
  const std::lock_guard lock(mutex_);
  auto there = methods_.find(call.method);
  if (there == methods_.end()) there = methods_.emplace(call.method, Method()).first;
  Method& method = there->second;
  ++method.answers[call.status];
  method.unit = call.unit;
  if (!call.times) return;
  Minute& minute = method.minutes[static_cast<size_t>(number) % kMinutes];
  if (minute.number != number) minute = {.number = number, .queue = {}, .work = {}, .units = 0};
  for (LatencyCounts* queue : {&method.queue, &minute.queue}) queue->add(call.times->queue);
  for (LatencyCounts* work : {&method.work, &minute.work}) work->add(call.times->work);
  for (double* units : {&method.units, &minute.units}) *units += call.units;
}

void CallStatistics::describe(v1::ServerStatus& status, Clock::time_point now) const {
  const std::lock_guard lock(mutex_);
  for (const auto& [name, method] : methods_) {
    v1::MethodStatus& described = *status.add_methods();
    described = describe(method, now);
    described.set_method(name);
  }
}

v1::MethodStatus CallStatistics::describe(const Method& method, Clock::time_point now) const {
  v1::MethodStatus status;
  for (const auto& [code, count] : method.answers) {
    v1::AnswerCount& answers = *status.add_answers();
    answers.set_status(status_name(code));
    answers.set_count(count);
  }
  *status.mutable_queue() = method.queue.histogram();
  *status.mutable_work() = method.work.histogram();
  status.set_units(method.units);
  status.set_unit(method.unit);
  // Lately.
  const int64_t newest = minute_of(now);
  const int64_t oldest = std::max<int64_t>(0, newest - static_cast<int64_t>(kMinutes) + 1);
  Minute lately;
  for (const Minute& minute : method.minutes) {
    if (minute.number < oldest) continue;
    lately.queue.add(minute.queue);
    lately.work.add(minute.work);
    lately.units += minute.units;
  }
  const double seconds =
      std::chrono::duration<double>(now - (start_ + std::chrono::minutes(oldest))).count();
  status.set_lately_answered(lately.work.count());
  *status.mutable_lately_queue() = lately.queue.quantiles();
  *status.mutable_lately_work() = lately.work.quantiles();
  if (seconds > 0) {
    status.set_lately_per_second(static_cast<double>(lately.work.count()) / seconds);
    status.set_lately_units_per_second(lately.units / seconds);
  }
  return status;
}

std::string status_name(grpc::StatusCode code) {
  constexpr std::array<const char*, 17> kNames = {"OK",
                                                  "CANCELLED",
                                                  "UNKNOWN",
                                                  "INVALID_ARGUMENT",
                                                  "DEADLINE_EXCEEDED",
                                                  "NOT_FOUND",
                                                  "ALREADY_EXISTS",
                                                  "PERMISSION_DENIED",
                                                  "RESOURCE_EXHAUSTED",
                                                  "FAILED_PRECONDITION",
                                                  "ABORTED",
                                                  "OUT_OF_RANGE",
                                                  "UNIMPLEMENTED",
                                                  "INTERNAL",
                                                  "UNAVAILABLE",
                                                  "DATA_LOSS",
                                                  "UNAUTHENTICATED"};
  const auto number = static_cast<size_t>(code);
  return number < kNames.size() ? kNames[number] : fmt::format("{}", number);
}

}  // namespace itn
