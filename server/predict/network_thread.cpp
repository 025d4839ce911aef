#include "server/predict/network_thread.h"

#include <algorithm>
#include <exception>
#include <span>
#include <utility>

#include "common/error.h"

namespace itn {
namespace {

// A network that fails for one, say for want of memory, is asked for each.
template <typename Job>
void run(std::span<Job> jobs) {
  std::vector<torch::Tensor> inputs;
  for (const Job& job : jobs) inputs.push_back(job.input);
  torch::Tensor rows;
  try {
    rows = jobs.front().predictor->embed(jobs.size() == 1 ? inputs.front() : torch::cat(inputs));
  } catch (...) {
    if (jobs.size() == 1) {
      jobs.front().result.set_exception(std::current_exception());
    } else {
      for (Job& job : jobs) run(std::span(&job, 1));
    }
    return;
  }
  int64_t row = 0;
  for (Job& job : jobs) {
    const int64_t count = job.input.size(0);
    job.result.set_value(rows.slice(0, row, row + count));
    row += count;
  }
}

}  // namespace

NetworkThread::NetworkThread(int max_batch)
    : max_batch_(max_batch), thread_([this](const std::stop_token& stop) { work(stop); }) {}

torch::Tensor NetworkThread::embed(const Predictor& predictor, const torch::Tensor& input,
                                   const std::stop_token& stop) {
  std::future<torch::Tensor> result;
  {
    const std::lock_guard lock(mutex_);
    Job& job = waiting_.emplace_back(Job{&predictor, input, stop, {}});
    result = job.result.get_future();
  }
  arrived_.notify_one();
  return result.get();
}

std::vector<NetworkThread::Job> NetworkThread::take_batch() {
  std::vector<Job> batch;
  const Predictor* const predictor = waiting_.front().predictor;
  const int64_t per_image = 1 + int64_t{predictor->model().mirrored()};
  int64_t room = std::min(predictor->inputs_at_a_time(), max_batch_ * per_image);
  for (auto job = waiting_.begin(); job != waiting_.end();) {
    const int64_t rows = job->input.size(0);
    if (job->predictor != predictor || (!batch.empty() && rows > room)) {
      ++job;
      continue;
    }
    room -= rows;
    batch.push_back(std::move(*job));
    job = waiting_.erase(job);
  }
  return batch;
}

void NetworkThread::work(const std::stop_token& stop) {
  const torch::InferenceMode inference;
  std::unique_lock lock(mutex_);
  while (arrived_.wait(lock, stop, [this] { return !waiting_.empty(); })) {
    std::vector<Job> batch = take_batch();
    lock.unlock();
    const auto wanted = std::partition(batch.begin(), batch.end(),
                                       [](const Job& job) { return !job.stop.stop_requested(); });
    for (auto job = wanted; job != batch.end(); ++job) {
      job->result.set_exception(
          std::make_exception_ptr(Error(ErrorKind::kCancelled, "the prediction was cancelled")));
    }
    if (wanted != batch.begin()) run(std::span(batch.begin(), wanted));
    batch.clear();
    lock.lock();
  }
}

}  // namespace itn
