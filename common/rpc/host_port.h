// The address of a server: HOST:PORT, as people write it and as gRPC does. Text alone: no name is
// looked up here.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace itn {

struct HostPort {
  std::string host;  // a name or number; IPv6 without its brackets, perhaps with its %scope
  uint16_t port = 0;

  // What parse_host_port() reads: "[IPV6]:PORT" where the host has a ':'.
  std::string text() const;
  // 127.0.0.0/8 and ::1 as numbers, and "localhost": what begins like them may be anywhere.
  bool is_loopback() const;

  bool operator==(const HostPort&) const = default;
};

enum class PortZero {
  kRefused,  // to connect to
  kAnyFree,  // to listen on
};

// "HOST:PORT" or "[IPV6]:PORT". Throws Error (kUsage) that says what is wrong with anything else,
// and what would be right.
HostPort parse_host_port(std::string_view text, PortZero zero = PortZero::kRefused);

// The path in "unix:PATH" or "unix:///PATH", of a socket in the file system of this machine;
// nothing for what does not begin like that. Throws Error (kUsage) for a path that no socket can
// have.
std::optional<std::string> socket_path(std::string_view text);

// Whether a client's target names the scheme by which gRPC resolves it: "dns:///workers:50051",
// "unix:/run/worker".
bool has_scheme(std::string_view target);

// The address of a client's target: HOST:PORT, dns:NAME:PORT or dns:///NAME:PORT. Nothing for those
// of other schemes, and for what is none.
std::optional<HostPort> endpoint_of_target(std::string_view target);

// The host of a peer as grpc::ServerContext::peer() calls it, "ipv4:10.0.0.1:50123": without the
// port, which each connection has of its own.
std::string host_of_peer(std::string_view peer);

}  // namespace itn
