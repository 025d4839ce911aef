#include "client/render_pool/render_wait.h"

#include <chrono>

#include <fmt/format.h>

#include "common/error.h"
#include "common/rpc/wire_array.h"

namespace itn {

v1::RenderGradReply wait_for_render(std::future<v1::RenderGradReply>& future,
                                    std::stop_token stop) {
  do {
    if (stop.stop_requested()) {
      throw Error(ErrorKind::kCancelled, "interrupted");
    }
  } while (future.wait_for(std::chrono::milliseconds(100)) != std::future_status::ready);
  return future.get();
}

std::vector<float> plane(const std::string& bytes, size_t count) {
  if (bytes.size() != count * sizeof(float)) {
    throw Error(ErrorKind::kInternal,
                fmt::format("a worker sent an image of {} bytes rather than {}", bytes.size(),
                            count * sizeof(float)));
  }
  return from_bytes<float>(bytes);
}

}  // namespace itn
