#include "client/render_pool/render_wait.h"

#include <chrono>

#include "common/error.h"

namespace itn {

v1::RenderGradReply wait_for_render(std::future<v1::RenderGradReply>& future,
                                    const std::stop_token& stop) {
  do {
    if (stop.stop_requested()) {
      throw Error(ErrorKind::kCancelled, "interrupted");
    }
  } while (future.wait_for(std::chrono::milliseconds(100)) != std::future_status::ready);
  return future.get();
}

}  // namespace itn
