#include "server/predict/model_watcher.h"

#include <semaphore.h>

#include <cerrno>
#include <cmath>
#include <csignal>
#include <ctime>
#include <exception>
#include <stop_token>
#include <utility>

#include <spdlog/spdlog.h>

namespace itn {
namespace {

// Counts the signals, and the end of the watcher. Never destroyed: the handler may run until the
// process ends. sem_post is one of the few functions that a handler may call.
sem_t arrived;

extern "C" void count_hangup(int /*signal*/) {
  const int saved = errno;
  sem_post(&arrived);
  errno = saved;
}

// False if nothing has arrived within that time.
bool wait_for(std::chrono::duration<double> interval) {
  if (interval.count() <= 0) {
    while (sem_wait(&arrived) == -1 && errno == EINTR) {
    }
    return true;
  }
  timespec until{};
  clock_gettime(CLOCK_MONOTONIC, &until);
  const double end = static_cast<double>(until.tv_sec) + 1e-9 * static_cast<double>(until.tv_nsec) +
                     interval.count();
  until.tv_sec = static_cast<time_t>(end);
  until.tv_nsec = static_cast<long>(1e9 * (end - std::floor(end)));
  while (sem_clockwait(&arrived, CLOCK_MONOTONIC, &until) == -1) {
    if (errno != EINTR) return false;
  }
  return true;
}

}  // namespace

ModelWatcher::ModelWatcher(std::shared_ptr<ModelStore> models,
                           std::chrono::duration<double> interval) {
  sem_init(&arrived, 0, 0);
  struct sigaction action = {};
  action.sa_handler = count_hangup;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  sigaction(SIGHUP, &action, nullptr);
  thread_ = std::jthread([models = std::move(models), interval](const std::stop_token& stop) {
    for (;;) {
      const bool hangup = wait_for(interval);
      if (stop.stop_requested()) return;
      if (hangup) spdlog::info("SIGHUP: looking at the models again");
      try {
        models->refresh(hangup);
      } catch (const std::exception& error) {
        spdlog::error("the models stay as they are: {}", error.what());
      }
    }
  });
}

ModelWatcher::~ModelWatcher() {
  thread_.request_stop();
  sem_post(&arrived);
}

}  // namespace itn
