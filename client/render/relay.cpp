#include "client/render/relay.h"

#include <google/protobuf/io/zero_copy_stream_impl.h>
#include <google/protobuf/util/delimited_message_util.h>
#include <poll.h>
#include <unistd.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <future>
#include <memory>
#include <mutex>
#include <stop_token>
#include <system_error>
#include <thread>
#include <utility>

#include "common/error.h"
#include "itn/v1/relay.pb.h"

namespace itn {
namespace {

using google::protobuf::util::ParseDelimitedFromZeroCopyStream;
using google::protobuf::util::SerializeDelimitedToFileDescriptor;

using std::chrono::milliseconds;

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

// Whether nobody will read `out` any more. `events`: what poll() said of it.
bool is_deaf(short events) {
  return (events & (POLLERR | POLLHUP)) != 0;
}

// Ends where `in` does, or nobody reads `out` any more.
class Input final : public google::protobuf::io::CopyingInputStream {
 public:
  Input(int in, int out) : in_(in), out_(out) {}

  int Read(void* buffer, int size) override {
    std::array<pollfd, 2> both{pollfd{in_, POLLIN, 0}, pollfd{out_, 0, 0}};
    while (::poll(both.data(), both.size(), -1) < 0 && errno == EINTR) {
    }
    has_gone_ = is_deaf(both[1].revents);
    return has_gone_ ? 0 : static_cast<int>(::read(in_, buffer, static_cast<size_t>(size)));
  }
  bool has_gone() const { return has_gone_; }

 private:
  const int in_, out_;
  bool has_gone_ = false;
};

// Answers in the order of requests.
class Writer {
 public:
  Writer(const JobRenderer& renderer, std::string version, int out)
      : renderer_(renderer), version_(std::move(version)), out_(out) {}

  void add(PendingReply reply) {
    const std::lock_guard lock(mutex_);
    pending_.push_back(std::move(reply));
    changed_.notify_all();
  }

  // Waits until all is answered, or nobody reads. Throws Error (kIo).
  void finish() {
    std::unique_lock lock(mutex_);
    while (!pending_.empty() && !nobody_reads()) changed_.wait_for(lock, milliseconds(50));
    if (failure_ != 0 && failure_ != EPIPE) {
      throw Error(ErrorKind::kIo, fmt::format("cannot write an answer: {}",
                                              std::generic_category().message(failure_)));
    }
  }

 private:
  bool nobody_reads() const {
    pollfd out{out_, 0, 0};
    return failure_ != 0 || (::poll(&out, 1, 0) > 0 && is_deaf(out.revents));
  }

  void write(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    while (changed_.wait(lock, stop, [&] { return !pending_.empty(); })) {
      PendingReply& next = pending_.front();  // which nobody else touches
      lock.unlock();
      v1::RelayReply reply = answer(next, stop);
      reply.set_parallelism(static_cast<uint32_t>(renderer_.parallelism()));
      reply.set_version(version_);
      errno = 0;
      const bool written = SerializeDelimitedToFileDescriptor(reply, out_);
      const int error = written ? 0 : std::max(1, errno);
      lock.lock();
      if (error != 0) failure_ = error;
      pending_.pop_front();
      changed_.notify_all();
    }
  }

  const JobRenderer& renderer_;
  const std::string version_;
  const int out_;

  std::mutex mutex_;  // guards what follows
  std::condition_variable_any changed_;
  std::deque<PendingReply> pending_;
  int failure_ = 0;  // of a write, an errno

  std::jthread thread_{[this](const std::stop_token& stop) { write(stop); }};  // last
};

}  // namespace

void relay_renders(JobRenderer& renderer, const std::string& version, int in, int out) {
  Writer writer(renderer, version, out);
  Input input(in, out);
  google::protobuf::io::CopyingInputStreamAdaptor stream(&input);
  JobReader jobs;
  v1::RenderGradRequest request;
  bool ended = false;  // or begins with what is no length
  while (ParseDelimitedFromZeroCopyStream(&request, &stream, &ended)) {
    try {
      writer.add(renderer.submit(jobs.job_of(std::move(request))));
    } catch (const Error&) {
      writer.add(failed(std::current_exception()));
    }
    request.Clear();
  }
  writer.finish();
  const void* rest = nullptr;
  int size = 0;
  require(input.has_gone() || (ended && !stream.Next(&rest, &size)),
          "what is read is no RenderGradRequest, or was cut short");
}

}  // namespace itn
