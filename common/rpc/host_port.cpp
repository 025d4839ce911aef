#include "common/rpc/host_port.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/un.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <system_error>
#include <utility>

#include "common/error.h"
#include "common/printable.h"

namespace itn {
namespace {

constexpr std::string_view kDns = "dns:", kUnix = "unix:";
constexpr std::array<std::string_view, 5> kSchemes = {kDns, kUnix,
                                                      "ipv4:", "ipv6:", "unix-abstract:"};

Error not_an_address(std::string_view text, std::string_view why) {
  return Error(ErrorKind::kUsage,
               fmt::format("\"{}\" is not the address of a server: {}; give HOST:PORT or "
                           "[IPV6]:PORT, e.g. 127.0.0.1:50051",
                           printable(text), why));
}

// A scope ("%eth0") may follow the number.
bool is_ipv6(std::string_view host) {
  in6_addr ignored{};
  return inet_pton(AF_INET6, std::string(host.substr(0, host.find('%'))).c_str(), &ignored) == 1;
}

std::string parse_host(std::string_view text, std::string_view host) {
  if (host.empty()) {
    throw not_an_address(text, "it has no host (0.0.0.0 is all of this machine's IPv4 addresses)");
  }
  const bool strange =
      std::ranges::any_of(host, [](unsigned char c) { return c <= ' ' || c >= 0x7f || c == '/'; });
  if (strange) throw not_an_address(text, "its host is neither a name nor a number");
  if (host.starts_with('[') && host.ends_with(']')) {
    host = host.substr(1, host.size() - 2);
    if (!is_ipv6(host)) throw not_an_address(text, "what is in brackets must be an IPv6 address");
  } else if (host.find_first_of(":[]") != std::string_view::npos) {
    throw not_an_address(text, "an IPv6 address must be in brackets");
  }
  return std::string(host);
}

uint16_t parse_port(std::string_view text, std::string_view port, PortZero zero) {
  const unsigned int least = zero == PortZero::kAnyFree ? 0 : 1;
  unsigned int value = 0;
  const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), value);
  if (error != std::errc() || end != port.data() + port.size() || value < least || value > 65535) {
    throw not_an_address(text, fmt::format("its port must be a number in [{}, 65535]", least));
  }
  return static_cast<uint16_t>(value);
}

}  // namespace

std::string HostPort::text() const {
  const bool ipv6 = host.find(':') != std::string::npos;
  return ipv6 ? fmt::format("[{}]:{}", host, port) : fmt::format("{}:{}", host, port);
}

bool HostPort::is_loopback() const {
  in_addr four{};
  if (inet_pton(AF_INET, host.c_str(), &four) == 1) return ntohl(four.s_addr) >> 24 == 127;
  in6_addr six{};
  if (inet_pton(AF_INET6, host.c_str(), &six) == 1) return IN6_IS_ADDR_LOOPBACK(&six);
  return host == "localhost";
}

HostPort parse_host_port(std::string_view text, PortZero zero) {
  const size_t colon = text.rfind(':');
  if (colon == std::string_view::npos || text.ends_with(']')) {
    throw not_an_address(text, "it has no port");
  }
  std::string host = parse_host(text, text.substr(0, colon));
  return {std::move(host), parse_port(text, text.substr(colon + 1), zero)};
}

std::optional<std::string> socket_path(std::string_view text) {
  constexpr size_t kLongest = sizeof sockaddr_un::sun_path - 1;
  std::string_view path = text;
  if (!path.starts_with(kUnix)) return std::nullopt;
  path.remove_prefix(kUnix.size());
  if (path.starts_with("///")) path.remove_prefix(2);
  if (path.empty() || path.size() > kLongest || path.find('\0') != std::string_view::npos) {
    throw Error(ErrorKind::kUsage,
                fmt::format("\"{}\" is not the address of a socket: its path must "
                            "have 1 to {} bytes, e.g. unix:/run/itn/worker",
                            printable(text), kLongest));
  }
  return std::string(path);
}

bool has_scheme(std::string_view target) {
  return std::ranges::any_of(kSchemes,
                             [&](std::string_view scheme) { return target.starts_with(scheme); });
}

std::optional<HostPort> endpoint_of_target(std::string_view target) {
  if (target.starts_with(kDns)) {
    target.remove_prefix(kDns.size());
    if (target.starts_with("///")) target.remove_prefix(3);
  } else if (has_scheme(target)) {
    return std::nullopt;
  }
  try {
    return parse_host_port(target);
  } catch (const Error&) {
    return std::nullopt;
  }
}

std::string host_of_peer(std::string_view peer) {
  const bool has_port = peer.starts_with("ipv4:") || peer.starts_with("ipv6:");
  return std::string(has_port ? peer.substr(0, peer.rfind(':')) : peer);
}

}  // namespace itn
