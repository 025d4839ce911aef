#include "common/rpc/shutdown_signal.h"

#include <semaphore.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <thread>

#include "common/error.h"

namespace itn {
namespace {

// Counts the signals that nobody has waited for yet. Never destroyed: the handler may run until the
// process ends. sem_post is one of the few functions that a handler may call.
sem_t arrived;

extern "C" void count_signal(int /*signal*/) {
  const int saved = errno;
  sem_post(&arrived);
  errno = saved;
}

void wait_for_signal() {
  while (sem_wait(&arrived) == -1 && errno == EINTR) {
  }
}

}  // namespace

ShutdownSignal::ShutdownSignal() {
  sem_init(&arrived, 0, 0);
  struct sigaction action = {};
  action.sa_handler = count_signal;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
}

void ShutdownSignal::wait() {
  wait_for_signal();
}

void ShutdownSignal::exit_on_next() {
  // Shells and supervisors send a signal to the process and to its group: that is one, not two.
  static constexpr auto kOneSignal = std::chrono::milliseconds(500);
  std::thread([begin = std::chrono::steady_clock::now()] {
    do {
      wait_for_signal();
    } while (std::chrono::steady_clock::now() - begin < kOneSignal);
    std::fputs("interrupted again: ended at once\n", stderr);
    _exit(exit_code(ErrorKind::kCancelled));
  }).detach();
}

}  // namespace itn
