#include "client/render/local_renderer.h"

#include <algorithm>
#include <cstdint>
#include <exception>
#include <utility>

#include "common/error.h"
#include "common/threads.h"

namespace itn {

LocalRenderer::LocalRenderer(SceneCache& cache, int threads)
    : cache_(cache), threads_(thread_count(threads)), free_(threads_) {}

LocalRenderer::~LocalRenderer() {
  for (std::jthread& server : servers_) server.request_stop();
  servers_.clear();
  for (Waiting& waiting : waiting_) {
    waiting.reply.set_exception(
        std::make_exception_ptr(Error(ErrorKind::kCancelled, "the renderer has gone")));
  }
}

std::future<v1::RenderGradReply> LocalRenderer::submit(RenderJob job) {
  const std::lock_guard lock(mutex_);
  std::future<v1::RenderGradReply> reply =
      waiting_.emplace_back(std::move(job), std::promise<v1::RenderGradReply>()).reply.get_future();
  // For one render, one server alone is begun.
  if (idle_ < waiting_.size() && servers_.size() < threads_) {
    servers_.emplace_back([this](const std::stop_token& stop) { serve(stop); });
  }
  submitted_.notify_one();
  return reply;
}

void LocalRenderer::serve(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (true) {
    ++idle_;
    submitted_.wait(lock, stop, [&] { return !waiting_.empty() && free_ > 0; });
    --idle_;
    if (stop.stop_requested()) return;
    const size_t threads = std::max(size_t{1}, free_ / waiting_.size());
    Waiting next = std::move(waiting_.front());
    waiting_.pop_front();
    free_ -= threads;
    lock.unlock();
    try {
      next.reply.set_value(render(next.job, threads, stop));
    } catch (...) {
      next.reply.set_exception(std::current_exception());
    }
    lock.lock();
    free_ += threads;
    submitted_.notify_all();
  }
}

v1::RenderGradReply LocalRenderer::render(const RenderJob& job, size_t threads,
                                          const std::stop_token& stop) {
  const RenderMeans means{
      .limits = {}, .threads = static_cast<int>(threads), .max_seconds = 0, .cache = cache_};
  RequestRender render(means, [](uint64_t /*bytes*/, uint64_t /*beyond_cache*/) {});
  v1::RenderGradRequest request = job.request;
  request.set_scene_digest(job.scene->digest);
  if (!render.accept(request, request.ByteSizeLong())) {
    request.set_scene(job.scene->bytes);
    const uint64_t bytes = request.ByteSizeLong();
    render.accept(std::move(request), bytes);
  }
  return render.render(stop);
}

}  // namespace itn
