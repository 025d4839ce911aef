#include "client/pause.h"

#include <condition_variable>
#include <mutex>

#include "client/interrupt.h"

namespace itn {

bool interrupted_within(std::chrono::duration<double> time) {
  std::mutex mutex;
  std::unique_lock lock(mutex);
  std::condition_variable_any never;
  never.wait_for(lock, interruption(), time, [] { return false; });
  return interruption().stop_requested();
}

}  // namespace itn
