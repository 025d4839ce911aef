// A render worker that does as a test says, behind a port of this process.
#pragma once

#include <grpcpp/security/server_credentials.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "common/scene/wire_array.h"
#include "itn/v1/render.grpc.pb.h"

namespace itn::testing {

// Holds calls until a test opens it.
class Gate {
 public:
  void open() {
    const std::lock_guard lock(mutex_);
    open_ = true;
    opened_.notify_all();
  }

  // False if the call was cancelled first.
  bool pass(const grpc::ServerContext& context) {
    std::unique_lock lock(mutex_);
    while (!open_ && !context.IsCancelled()) {
      opened_.wait_for(lock, std::chrono::milliseconds(1));  // no event tells of a cancellation
    }
    return open_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable opened_;
  bool open_ = false;
};

// The answer of a worker, in its form, for a film of 16 x 12 pixels. All values are the seed.
inline grpc::Status constant_answer(const v1::RenderGradRequest& request,
                                    v1::RenderGradReply& reply) {
  const auto value = static_cast<float>(request.seed());
  const std::string image = to_bytes(std::vector<float>(16 * 12, value));
  reply.set_width(16);
  reply.set_height(12);
  if (request.has_loss()) {
    reply.set_loss(value);
    for (int i = 0; i < request.derivatives_size(); ++i) reply.add_loss_gradient(value);
    return grpc::Status::OK;
  }
  for (uint32_t k = 0; k < std::max(request.estimates(), 1U); ++k) {
    v1::Estimate& estimate = *reply.add_estimates();
    estimate.set_radiance(image);
    const int colours = request.colours_size();
    for (int i = 0; i < request.derivatives_size() * std::max(colours, 1); ++i) {
      estimate.add_derivatives(image);
    }
    for (int c = 0; c < colours; ++c) estimate.add_colours(image);
    for (int i = 0; i < request.albedos_size(); ++i) estimate.add_at_albedos(image);
  }
  reply.set_mask(to_bytes(std::vector<float>(16 * 12, 1)));
  reply.set_standard_error(image);
  for (int c = 0; c < request.colours_size(); ++c) reply.add_colour_standard_errors(image);
  return grpc::Status::OK;
}

inline grpc::Status busy(double retry_after_seconds) {
  v1::Busy details;
  details.set_retry_after_seconds(retry_after_seconds);
  return {grpc::StatusCode::UNAVAILABLE, "this worker is busy", details.SerializeAsString()};
}

class FakeWorker final : public v1::RenderService::Service {
 public:
  using Render =
      std::function<grpc::Status(const grpc::ServerContext& context,
                                 const v1::RenderGradRequest& request, v1::RenderGradReply& reply)>;

  explicit FakeWorker(Render render, v1::Capabilities capabilities = {})
      : render_(std::move(render)), capabilities_(std::move(capabilities)) {
    if (capabilities_.version().empty()) capabilities_.set_version(ITN_VERSION);
    grpc::ServerBuilder builder;
    int port = 0;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
    address_ = "127.0.0.1:" + std::to_string(port);
  }
  ~FakeWorker() override { server_->Shutdown(std::chrono::system_clock::now()); }

  const std::string& address() const { return address_; }
  int renders() const { return renders_; }  // that it was asked for

  grpc::Status RenderGrad(grpc::ServerContext* context, const v1::RenderGradRequest* request,
                          v1::RenderGradReply* reply) override {
    ++renders_;
    return render_(*context, *request, *reply);
  }

  grpc::Status GetCapabilities(grpc::ServerContext* /*context*/,
                               const v1::GetCapabilitiesRequest* /*request*/,
                               v1::Capabilities* reply) override {
    *reply = capabilities_;
    return grpc::Status::OK;
  }

 private:
  const Render render_;
  v1::Capabilities capabilities_;
  std::string address_;
  std::atomic<int> renders_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

// Answers whatever it is asked.
inline grpc::Status answers(const grpc::ServerContext& /*context*/,
                            const v1::RenderGradRequest& request, v1::RenderGradReply& reply) {
  return constant_answer(request, reply);
}

}  // namespace itn::testing
