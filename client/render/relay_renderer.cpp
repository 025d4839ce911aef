#include "client/render/relay_renderer.h"

#include <google/protobuf/io/zero_copy_stream_impl.h>
#include <google/protobuf/util/delimited_message_util.h>
#include <sys/socket.h>
#include <unistd.h>

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <exception>
#include <sstream>
#include <string_view>
#include <utility>

#include "common/error.h"
#include "itn/v1/relay.pb.h"

namespace itn {
namespace {

// As what has gone does not read, that is no signal here. Returns false then.
bool send_all(int socket, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(socket, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent < 0) return false;
    bytes.remove_prefix(static_cast<size_t>(sent));
  }
  return true;
}

void fail(std::promise<v1::RenderGradReply>& promise, ErrorKind kind, const std::string& message) {
  promise.set_exception(std::make_exception_ptr(Error(kind, message)));
}

// The kind that has this exit code.
ErrorKind kind_of_exit_code(uint32_t code) {
  for (int kind = 0; kind <= static_cast<int>(ErrorKind::kCancelled); ++kind) {
    if (exit_code(static_cast<ErrorKind>(kind)) == static_cast<int>(code)) {
      return static_cast<ErrorKind>(kind);
    }
  }
  return ErrorKind::kInternal;
}

constexpr const char* kEnded = "the program itn relay has ended";

}  // namespace

RelayRenderer::RelayRenderer(int socket, std::string version)
    : socket_(socket),
      version_(std::move(version)),
      writer_([this] { send_requests(); }),
      reader_([this] { read_replies(); }) {}

RelayRenderer::~RelayRenderer() {
  ::shutdown(socket_, SHUT_RDWR);
  reader_.join();
  writer_.join();
  ::close(socket_);
}

std::future<v1::RenderGradReply> RelayRenderer::submit(RenderJob job) {
  const std::lock_guard lock(mutex_);
  std::promise<v1::RenderGradReply> promise;
  std::future<v1::RenderGradReply> reply = promise.get_future();
  if (ended_) {
    fail(promise, ErrorKind::kUnavailable, kEnded);
  } else {
    pending_.push_back(std::move(promise));
    unsent_.push_back(std::move(job));
    submitted_.notify_one();
  }
  return reply;
}

void RelayRenderer::send_requests() {
  std::string last_digest;  // of the scene that the program holds
  while (true) {
    std::unique_lock lock(mutex_);
    submitted_.wait(lock, [this] { return ended_ || !unsent_.empty(); });
    if (ended_) return;
    RenderJob job = std::move(unsent_.front());
    unsent_.pop_front();
    lock.unlock();
    job.request.set_scene_digest(job.scene->digest);
    if (job.scene->digest != last_digest) job.request.set_scene(job.scene->bytes);
    last_digest = job.scene->digest;
    std::ostringstream message;
    google::protobuf::util::SerializeDelimitedToOstream(job.request, &message);
    if (!send_all(socket_, message.view())) return;  // replies end, too
  }
}

int RelayRenderer::parallelism() const {
  const std::lock_guard lock(mutex_);
  return parallelism_;
}

void RelayRenderer::read_replies() {
  google::protobuf::io::FileInputStream stream(socket_);
  v1::RelayReply reply;
  while (google::protobuf::util::ParseDelimitedFromZeroCopyStream(&reply, &stream, nullptr)) {
    std::promise<v1::RenderGradReply> promise;
    {
      const std::lock_guard lock(mutex_);
      if (pending_.empty()) break;
      promise = std::move(pending_.front());
      pending_.pop_front();
      parallelism_ = std::max(1, static_cast<int>(reply.parallelism()));
    }
    if (reply.version() != version_) {
      fail(promise, ErrorKind::kInternal,
           fmt::format("the program itn is of version {}, not {}", reply.version(), version_));
    } else if (reply.has_render()) {
      promise.set_value(std::move(*reply.mutable_render()));
    } else {
      fail(promise, kind_of_exit_code(reply.failure().exit_code()), reply.failure().message());
    }
    reply.Clear();
  }
  end();
}

void RelayRenderer::end() {
  const std::lock_guard lock(mutex_);
  ended_ = true;
  unsent_.clear();
  for (std::promise<v1::RenderGradReply>& promise : pending_) {
    fail(promise, ErrorKind::kUnavailable, kEnded);
  }
  pending_.clear();
  submitted_.notify_one();
}

}  // namespace itn
