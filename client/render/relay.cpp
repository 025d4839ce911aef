#include "client/render/relay.h"

#include <google/protobuf/io/zero_copy_stream_impl.h>
#include <google/protobuf/util/delimited_message_util.h>

#include <condition_variable>
#include <deque>
#include <exception>
#include <future>
#include <memory>
#include <mutex>
#include <stop_token>
#include <thread>
#include <utility>

#include "common/error.h"
#include "itn/v1/relay.pb.h"

namespace itn {
namespace {

using google::protobuf::util::ParseDelimitedFromZeroCopyStream;
using google::protobuf::util::SerializeDelimitedToFileDescriptor;

using PendingReply = std::future<v1::RenderGradReply>;

PendingReply failed(std::exception_ptr error) {
  std::promise<v1::RenderGradReply> reply;
  reply.set_exception(std::move(error));
  return reply.get_future();
}

// Makes jobs of requests, each of which has its scene or names that of the one before.
class JobReader {
 public:
  RenderJob job_of(v1::RenderGradRequest request) {
    if (!request.scene().empty()) {
      v1::Scene scene;
      require(scene.ParseFromString(request.scene()), "scene: it is no serialized Scene");
      scene_ = serialize(scene);
      digest_ = request.scene_digest();
    }
    require(scene_ != nullptr && request.scene_digest() == digest_,
            "scene: it is missing, and scene_digest is not that of the request before");
    request.clear_scene();
    return {.scene = scene_, .request = std::move(request)};
  }

 private:
  std::shared_ptr<const SerializedScene> scene_;
  std::string digest_;  // that requests call it by
};

void fail(v1::RelayReply& reply, ErrorKind kind, const char* message) {
  reply.mutable_failure()->set_exit_code(static_cast<uint32_t>(exit_code(kind)));
  reply.mutable_failure()->set_message(message);
}

v1::RelayReply answer(PendingReply& pending, const std::stop_token& stop) {
  v1::RelayReply reply;
  try {
    *reply.mutable_render() = wait_for_render(pending, stop);
  } catch (const Error& error) {
    fail(reply, error.kind(), error.what());
  } catch (const std::exception& error) {
    fail(reply, ErrorKind::kInternal, error.what());
  }
  return reply;
}

}  // namespace

void relay_renders(JobRenderer& renderer, const std::string& version, int in, int out) {
  std::mutex mutex;  // guards `pending`
  std::condition_variable_any submitted;
  std::deque<PendingReply> pending;
  const std::jthread writer([&](const std::stop_token& stop) {
    while (true) {
      std::unique_lock lock(mutex);
      if (!submitted.wait(lock, stop, [&] { return !pending.empty(); })) return;
      PendingReply next = std::move(pending.front());
      pending.pop_front();
      lock.unlock();
      v1::RelayReply reply = answer(next, stop);
      reply.set_parallelism(static_cast<uint32_t>(renderer.parallelism()));
      reply.set_version(version);
      SerializeDelimitedToFileDescriptor(reply, out);  // where nobody reads, `in` ends soon
    }
  });
  google::protobuf::io::FileInputStream stream(in);
  JobReader jobs;
  v1::RenderGradRequest request;
  bool ended = false;
  while (ParseDelimitedFromZeroCopyStream(&request, &stream, &ended)) {
    PendingReply reply;
    try {
      reply = renderer.submit(jobs.job_of(std::move(request)));
    } catch (const Error&) {
      reply = failed(std::current_exception());
    }
    request.Clear();
    const std::lock_guard lock(mutex);
    pending.push_back(std::move(reply));
    submitted.notify_one();
  }
  require(ended, "what is read is no RenderGradRequest, or was cut short");
}

}  // namespace itn
