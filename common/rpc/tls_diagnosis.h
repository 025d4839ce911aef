// Why a connection is not made.
#pragma once

#include <string>

#include "common/rpc/channel.h"

namespace itn {

// Connects to HOST:PORT as a channel with this security would, and says what is wrong between the
// two sides and what would be right; empty if nothing is, or if nothing answers. Takes some seconds
// at most.
std::string diagnose_connection(const std::string& address, const ClientSecurity& security);

}  // namespace itn
