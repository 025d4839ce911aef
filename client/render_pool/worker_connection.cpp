#include "client/render_pool/worker_connection.h"

#include <fmt/format.h>

#include "client/render_pool/reply_check.h"
#include "client/rpc/deadline.h"
#include "common/error.h"
#include "common/printable.h"
#include "common/rpc/request_id.h"

namespace itn {
namespace {

using std::chrono::milliseconds;

// The deadline of the call that asks a worker whether it is there.
constexpr milliseconds kProbeDeadline{2000};

}  // namespace

bool asks_for_scene(const grpc::Status& status, const std::string& digest) {
  v1::SceneNotHeld details;
  return status.error_code() == grpc::StatusCode::FAILED_PRECONDITION &&
         details.ParseFromString(status.error_details()) && details.scene_digest() == digest;
}

grpc::Status WorkerConnection::probe(bool patient, const std::stop_token& stop,
                                     v1::Capabilities& capabilities) {
  grpc::ClientContext context;
  // gRPC 1.51 attends to a connection that is being made only while a call waits for it.
  context.set_wait_for_ready(patient);
  context.set_deadline(deadline_in(kProbeDeadline));
  const std::stop_callback cancel(stop, [&] { context.TryCancel(); });
  grpc::Status status =
      stub_->GetCapabilities(&context, v1::GetCapabilitiesRequest(), &capabilities);
  if (status.ok() && capabilities.version() != ITN_VERSION) {
    return {grpc::StatusCode::FAILED_PRECONDITION,
            fmt::format("its version is {}, this is " ITN_VERSION
                        ": only the same version gives the same results",
                        printable(capabilities.version()))};
  }
  return patient || !explain_ ? status : explain_(status);
}

Answer WorkerConnection::render(const RenderJob& job, milliseconds deadline,
                                const std::stop_token& stop) {
  Answer answer;
  v1::RenderGradRequest request = job.request;
  request.set_scene_digest(job.scene->digest);
  answer.status = call(request, deadline, stop, answer.reply);
  if (asks_for_scene(answer.status, job.scene->digest)) {
    answer.scene_sent = true;
    request.set_scene(job.scene->bytes);
    answer.status = call(request, deadline, stop, answer.reply);
  }
  answer.outcome = outcome_of(answer.status);
  if (answer.outcome != Outcome::kAnswered) return answer;
  try {
    check_reply(answer.reply, job);
  } catch (const Error& error) {
    answer.outcome = Outcome::kBadReply;
    answer.status = {grpc::StatusCode::INTERNAL, error.what()};
  }
  return answer;
}

grpc::Status WorkerConnection::call(const v1::RenderGradRequest& request, milliseconds deadline,
                                    const std::stop_token& stop, v1::RenderGradReply& reply) {
  grpc::ClientContext context;
  context.set_deadline(deadline_in(deadline));
  const std::stop_callback cancel(stop, [&] { context.TryCancel(); });
  const std::string name = assign_request_id(context);
  reply.Clear();
  grpc::Status status = stub_->RenderGrad(&context, request, &reply);
  if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED) {
    const double seconds = std::chrono::duration<double>(deadline).count();
    status = {status.error_code(), fmt::format("no answer within {} s", seconds)};
  }
  return explain_ ? with_request_id(status, name) : status;
}

}  // namespace itn
