#include "client/bench/bench_call.h"

#include <grpcpp/client_context.h>
#include <grpcpp/impl/codegen/proto_utils.h>

#include <future>
#include <optional>
#include <utility>

#include "client/interrupt.h"
#include "client/pause.h"
#include "client/render_pool/outcome.h"
#include "client/render_pool/worker_connection.h"
#include "common/error.h"
#include "common/rpc/deadline.h"
#include "common/rpc/request_id.h"
#include "common/rpc/wire_check.h"
#include "itn/v1/render.pb.h"

namespace itn {
namespace {

template <typename Reply>
Reply parsed(const grpc::ByteBuffer& bytes) {
  grpc::ByteBuffer copy = bytes;  // of references
  Reply reply;
  const grpc::Status status = grpc::SerializationTraits<Reply>::Deserialize(&copy, &reply);
  if (!status.ok()) throw Error(ErrorKind::kInternal, "the server's answer cannot be read");
  return reply;
}

}  // namespace

BenchRequest bench_request(const RenderJob& job) {
  v1::RenderGradRequest request = job.request;
  request.set_scene_digest(job.scene->digest);
  BenchRequest result;
  result.method = "/itn.v1.RenderService/RenderGrad";
  result.message = serialized(request);
  result.scene_digest = job.scene->digest;
  request.set_scene(job.scene->bytes);
  result.with_scene = serialized(request);
  result.units = [](const grpc::ByteBuffer& reply) {
    return static_cast<double>(parsed<v1::RenderGradReply>(reply).counters().paths());
  };
  result.unit = "paths";
  return result;
}

BenchRequest bench_request(const v1::PredictRequest& request) {
  BenchRequest result;
  result.method = "/itn.v1.PredictService/Predict";
  result.message = serialized(request);
  result.units = [](const grpc::ByteBuffer& reply) {
    return parsed<v1::PredictReply>(reply).materials().empty() ? 0.0 : 1.0;
  };
  result.unit = "images";
  return result;
}

// One call, of two attempts if the server does not hold the scene. Deletes itself at the end.
class BenchCaller::Call {
 public:
  using Done = std::function<void(const grpc::Status&, const grpc::ByteBuffer& reply)>;

  static void start(BenchCaller& caller, const std::stop_token& stop, Done done) {
    auto* const call = new Call(caller, stop, std::move(done));
    call->attempt(caller.request_.message);
  }

 private:
  Call(BenchCaller& caller, const std::stop_token& stop, Done done)
      : caller_(caller),
        stub_(*caller.stubs_[caller.next_++ % caller.stubs_.size()]),
        stop_(stop),
        done_(std::move(done)),
        deadline_(deadline_in(caller.timeout_)) {}

  void attempt(const grpc::ByteBuffer& message) {
    cancel_.reset();
    context_.emplace();
    context_->set_deadline(deadline_);
    name_request(*context_);
    reply_.Clear();
    // First, as the call may end before UnaryCall() returns.
    cancel_.emplace(stop_, Cancel{&*context_});
    stub_.UnaryCall(&*context_, caller_.request_.method, grpc::StubOptions(), &message, &reply_,
                    [this](const grpc::Status& status) { end(status); });
  }

  void end(const grpc::Status& status) {
    const BenchRequest& request = caller_.request_;
    if (!request.scene_digest.empty() && asks_for_scene(status, request.scene_digest) &&
        !scene_sent_) {
      scene_sent_ = true;
      attempt(request.with_scene);
      return;
    }
    const Done done = std::move(done_);
    const grpc::ByteBuffer reply = reply_;  // references to it
    delete this;  // nothing is left of the call when it is said to be done
    done(status, reply);
  }

  struct Cancel {
    grpc::ClientContext* context;
    void operator()() const { context->TryCancel(); }
  };

  BenchCaller& caller_;
  grpc::GenericStub& stub_;
  const std::stop_token stop_;
  Done done_;
  const gpr_timespec deadline_;
  bool scene_sent_ = false;
  std::optional<grpc::ClientContext> context_;
  grpc::ByteBuffer reply_;
  std::optional<std::stop_callback<Cancel>> cancel_;
};

BenchCaller::BenchCaller(const std::vector<std::shared_ptr<grpc::Channel>>& channels,
                         BenchRequest request, std::chrono::milliseconds timeout)
    : request_(std::move(request)), timeout_(timeout) {
  for (const auto& channel : channels) {
    stubs_.push_back(std::make_unique<grpc::GenericStub>(channel));
  }
}

void BenchCaller::start(const std::stop_token& stop, Load::Done done) {
  Call::start(*this, stop,
              [done = std::move(done)](const grpc::Status& status, const grpc::ByteBuffer&) {
                done(status);
              });
}

grpc::Status BenchCaller::try_once(double& units) {
  using Ended = std::promise<std::pair<grpc::Status, grpc::ByteBuffer>>;
  while (true) {
    const auto ended = std::make_shared<Ended>();
    Call::start(*this, interruption(),
                [ended](const grpc::Status& status, const grpc::ByteBuffer& reply) {
                  ended->set_value({status, reply});
                });
    const auto [status, reply] = ended->get_future().get();
    if (status.ok()) units = request_.units(reply);
    if (outcome_of(status) != Outcome::kBusy) return status;
    if (interrupted_within(*retry_after(status))) return grpc::Status::CANCELLED;
  }
}

}  // namespace itn
