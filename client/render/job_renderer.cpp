#include "client/render/job_renderer.h"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <utility>

#include "client/render/tiles.h"
#include "common/error.h"

namespace itn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kProgressEvery{10};

// Tiles on a side of a gradient: the weights of all pixels travel with each.
constexpr uint32_t kMostOfAGradient = 4;

}  // namespace

v1::RenderGradReply JobRenderer::render_split(const RenderJob& job, const Progress& progress) {
  return std::move(render_split(std::span(&job, 1), progress).front());
}

std::vector<v1::RenderGradReply> JobRenderer::render_split(std::span<const RenderJob> jobs,
                                                           const Progress& progress) {
  struct Part {
    size_t job;
    v1::Tile tile;
  };
  std::vector<Part> parts;
  std::vector<TiledReply> replies;
  for (size_t i = 0; i < jobs.size(); ++i) {
    const v1::Tile whole = pixels_of(jobs[i]);
    replies.emplace_back(whole);
    const v1::RenderGradRequest& request = jobs[i].request;
    for (const v1::Tile& tile : request.has_gradient()
                                    ? tiles_of(whole, request.spp(), kMostOfAGradient)
                                    : tiles_of(whole, request.spp())) {
      parts.push_back({i, tile});
    }
  }
  std::deque<std::future<v1::RenderGradReply>> pending;
  for (size_t next = 0, done = 0; done < parts.size(); ++done) {
    // Enough for all, and not many that have been answered and wait for an earlier one.
    const size_t ahead = 2 * static_cast<size_t>(parallelism()) + 1;
    for (; next < parts.size() && pending.size() < ahead; ++next) {
      RenderJob part = jobs[parts[next].job];
      *part.request.mutable_tile() = parts[next].tile;
      pending.push_back(submit(std::move(part)));
    }
    do {
      if (progress) progress(static_cast<double>(done) / static_cast<double>(parts.size()));
    } while (pending.front().wait_for(kProgressEvery) != std::future_status::ready);
    replies[parts[done].job].add(parts[done].tile, pending.front().get());
    pending.pop_front();
  }
  if (progress) progress(1);
  std::vector<v1::RenderGradReply> images;
  images.reserve(replies.size());
  for (TiledReply& reply : replies) images.push_back(reply.take());
  return images;
}

v1::RenderGradReply wait_for_render(std::future<v1::RenderGradReply>& future,
                                    const std::stop_token& stop) {
  do {
    if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
  } while (future.wait_for(milliseconds(100)) != std::future_status::ready);
  return future.get();
}

}  // namespace itn
