// One thread through which all images of a server go to their networks, those together that wait
// together.
#pragma once

#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <stop_token>
#include <thread>
#include <vector>

#include <torch/types.h>

#include "common/learning/predictor.h"

namespace itn {

// Thread-safe.
class NetworkThread {
 public:
  // Images of one model that are put through its network together, at most; each may have a mirror
  // image. Fewer if they take more than Predictor::inputs_at_a_time().
  explicit NetworkThread(int max_batch);

  // Does what Predictor::embed() does, with whatever others ask of the same model until its turn
  // comes: what is returned does not depend on that. The predictor lives until then. Throws Error
  // (cancelled) if a stop was requested before its turn.
  torch::Tensor embed(const Predictor& predictor, const torch::Tensor& input,
                      const std::stop_token& stop);

 private:
  struct Job {
    const Predictor* predictor;
    torch::Tensor input;
    std::stop_token stop;
    std::promise<torch::Tensor> result;
  };

  void work(const std::stop_token& stop);
  // The first that waits, and all others that go with it.
  std::vector<Job> take_batch();

  const int64_t max_batch_;
  std::mutex mutex_;
  std::condition_variable_any arrived_;
  std::deque<Job> waiting_;
  std::jthread thread_;  // last: it uses what is above
};

}  // namespace itn
