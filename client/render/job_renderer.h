// Who renders jobs: the workers of a pool (client/render_pool/render_pool.h), or this process
// (client/render/local_renderer.h).
#pragma once

#include <functional>
#include <future>
#include <span>
#include <stop_token>
#include <vector>

#include "client/render/render_job.h"
#include "itn/v1/render.pb.h"

namespace itn {

// Thread-safe. As answers depend on the request alone, they are the same whoever renders, bit for
// bit.
class JobRenderer {
 public:
  virtual ~JobRenderer() = default;

  // The future throws Error: kInvalidInput; kLimit, kInternal; kUnavailable; kCancelled.
  virtual std::future<v1::RenderGradReply> submit(RenderJob job) = 0;

  // Jobs that can be under way at once; keep somewhat more submitted. It may change; never zero.
  virtual int parallelism() const = 0;

  // Called on the caller's thread every 10 ms, with the fraction done, in [0, 1]. May throw to give
  // up; what was submitted by then is still rendered.
  using Progress = std::function<void(double fraction)>;

  // Renders one job (not a loss) in tiles at the same time and puts them together. How many are
  // rendered at the same time does not matter; without a pilot, neither does it that there are
  // tiles: the images are those of `submit`, bit for bit, and a gradient is the same but for
  // rounding. Throws what the futures of `submit` throw.
  v1::RenderGradReply render_split(const RenderJob& job, const Progress& progress = {});
  // Several, one after the other, and nobody idles between them.
  std::vector<v1::RenderGradReply> render_split(std::span<const RenderJob> jobs,
                                                const Progress& progress = {});
};

// A reply that was submitted. Throws Error (kCancelled) within a tenth of a second after a stop is
// requested, and what the future throws.
v1::RenderGradReply wait_for_render(std::future<v1::RenderGradReply>& future,
                                    const std::stop_token& stop);

}  // namespace itn
