#include "server/shutdown_signal.h"

#include <pthread.h>
#include <unistd.h>

#include <csignal>
#include <thread>

#include "common/error.h"

namespace itn {
namespace {

sigset_t shutdown_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGTERM);
  sigaddset(&set, SIGINT);
  return set;
}

}  // namespace

ShutdownSignal::ShutdownSignal() {
  const sigset_t set = shutdown_signals();
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
}

void ShutdownSignal::wait() {
  const sigset_t set = shutdown_signals();
  int signal = 0;
  sigwait(&set, &signal);
}

void ShutdownSignal::exit_on_next() {
  std::thread([this] {
    wait();
    _exit(exit_code(ErrorKind::kCancelled));
  }).detach();
}

}  // namespace itn
