#include "client/interrupt.h"

#include <thread>

#include "common/error.h"
#include "common/rpc/shutdown_signal.h"

namespace itn {
namespace {

std::stop_source& source() {
  static std::stop_source source;
  return source;
}

}  // namespace

void watch_interrupts() {
  static ShutdownSignal signal;
  source();  // constructed before the thread may use it
  std::thread([] {
    signal.wait();
    signal.exit_on_next();
    source().request_stop();
  }).detach();
}

std::stop_token interruption() {
  return source().get_token();
}

void throw_if_interrupted() {
  if (source().stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
}

}  // namespace itn
