// Who calls, as far as a server can tell.
#pragma once

#include "common/rpc/job_queue.h"

namespace grpc {
class CallbackServerContext;
}

namespace itn {

// Who showed a certificate is who it names, however many machines and connections they call from;
// others are their machine. A token, which clients share, tells nobody apart.
QueueClient client_of(const grpc::CallbackServerContext& context);

}  // namespace itn
