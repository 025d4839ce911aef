#include "server/rpc/listener.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/tcp.h>
#include <malloc.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <spdlog/spdlog.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <system_error>
#include <utility>

#include "common/error.h"
#include "common/printable.h"
#include "common/rpc/host_port.h"
#include "server/rpc/process_memory.h"

namespace itn {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

// Connections are closed before the limit is reached, as memory grows between two looks and what a
// connection holds takes a moment to be freed.
constexpr uint64_t kReserve = 8;  // an eighth

// How often memory is looked at: rarely, or often once half of it is taken.
constexpr milliseconds kCalm{200};
constexpr milliseconds kTight{10};
constexpr uint64_t kTightPart = 2;  // a half

// What a connection has sent counts less from look to look: when memory is tight, a megabyte is
// forgotten after a second.
constexpr double kRemembered = 7.0 / 8;

// What a connection that was closed has left in gRPC's hands is done with so soon; until then no
// other is closed, unless this part of the memory has been added to what is in use.
constexpr milliseconds kGrace{100};
constexpr uint64_t kGrowth = 64;
// So long after one was closed none is accepted while memory is short.
constexpr milliseconds kRecovery{2000};

// Calls are small, and what they leave in the heap stays resident until the heap is trimmed: when
// memory is tight and has grown, and every so often, but not always, as others wait for the heap.
constexpr milliseconds kMinTrimInterval{50};
constexpr milliseconds kTrimInterval{500};

struct AddressList {
  explicit AddressList(const HostPort& address) {
    addrinfo hints = {};
    hints.ai_socktype = SOCK_STREAM;
    hints.ai_flags = AI_PASSIVE;
    const int error =
        getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(), &hints, &first);
    if (error != 0) {
      throw Error(ErrorKind::kUsage, fmt::format("cannot listen on host \"{}\": {}",
                                                 printable(address.host), gai_strerror(error)));
    }
  }
  ~AddressList() { freeaddrinfo(first); }
  AddressList(const AddressList&) = delete;
  AddressList& operator=(const AddressList&) = delete;

  addrinfo* first = nullptr;
};

void set_option(int socket, int level, int option, int value) {
  setsockopt(socket, level, option, &value, sizeof value);
}

uint16_t port_of(int socket) {
  sockaddr_storage address = {};
  socklen_t length = sizeof address;
  getsockname(socket, reinterpret_cast<sockaddr*>(&address), &length);
  const in_port_t port = address.ss_family == AF_INET6
                             ? reinterpret_cast<const sockaddr_in6&>(address).sin6_port
                             : reinterpret_cast<const sockaddr_in&>(address).sin_port;
  return ntohs(port);
}

// Listening; -1 and errno if that fails.
int open_socket(const addrinfo& address) {
  const int fd = socket(address.ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) return fd;
  set_option(fd, SOL_SOCKET, SO_REUSEADDR, 1);  // of connections that ended; no port is shared
  set_option(fd, IPPROTO_TCP, TCP_NODELAY, 1);
  if (address.ai_family == AF_INET6) set_option(fd, IPPROTO_IPV6, IPV6_V6ONLY, 0);
  if (bind(fd, address.ai_addr, address.ai_addrlen) == 0 && listen(fd, SOMAXCONN) == 0) return fd;
  const int error = errno;
  ::close(fd);
  errno = error;
  return -1;
}

// Opens a socket in the file system. A socket that a process left behind, which nobody listens on
// any more, is replaced.
int open_socket(const std::string& path) {
  sockaddr_un address = {};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  const auto* const generic = reinterpret_cast<const sockaddr*>(&address);
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) return fd;
  const auto is_left_behind = [&] {
    std::error_code absent;
    if (!std::filesystem::is_socket(path, absent)) return false;
    const int caller = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    const bool refused = connect(caller, generic, sizeof address) != 0 && errno == ECONNREFUSED;
    ::close(caller);
    return refused;
  };
  bool bound = bind(fd, generic, sizeof address) == 0;
  int error = errno;
  if (!bound && error == EADDRINUSE && is_left_behind()) {
    unlink(path.c_str());
    bound = bind(fd, generic, sizeof address) == 0;
    error = errno;
  }
  if (bound && listen(fd, SOMAXCONN) == 0) return fd;
  if (bound) error = errno;
  ::close(fd);
  errno = error;
  return -1;
}

bool is_of_this_machine(const sockaddr& address) {
  if (address.sa_family == AF_INET) {
    const auto& four = reinterpret_cast<const sockaddr_in&>(address);
    return ntohl(four.sin_addr.s_addr) >> 24 == 127;
  }
  return address.sa_family == AF_INET6 &&
         IN6_IS_ADDR_LOOPBACK(&reinterpret_cast<const sockaddr_in6&>(address).sin6_addr);
}

// See Listener::Connection::peer. An IPv4 address in an IPv6 socket is all that its bytes say; of a
// socket in the file system, the other end is a user.
std::string peer_of(int fd, const sockaddr_storage& address) {
  if (address.ss_family == AF_UNIX) {
    ucred user = {};
    socklen_t length = sizeof user;
    getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &user, &length);
    return fmt::format("user {}", user.uid);
  }
  if (address.ss_family == AF_INET) {
    const in_addr& four = reinterpret_cast<const sockaddr_in&>(address).sin_addr;
    return {reinterpret_cast<const char*>(&four), sizeof four};
  }
  const in6_addr& six = reinterpret_cast<const sockaddr_in6&>(address).sin6_addr;
  return {reinterpret_cast<const char*>(&six), IN6_IS_ADDR_V4MAPPED(&six) ? sizeof six : 8};
}

// Ends a connection at once: what has arrived and was not read yet is read by nobody.
void cut(int fd) {
  shutdown(fd, SHUT_RDWR);
  // TCP discards what is asked for with MSG_TRUNC.
  while (recv(fd, nullptr, std::numeric_limits<int>::max(), MSG_TRUNC | MSG_DONTWAIT) > 0) {
  }
}

uint64_t bytes_received(int fd) {
  tcp_info info = {};
  socklen_t length = sizeof info;
  return getsockopt(fd, IPPROTO_TCP, TCP_INFO, &info, &length) == 0 ? info.tcpi_bytes_received : 0;
}

}  // namespace

Listener::Listener(const std::string& address, const ListenerOptions& options) : options_(options) {
  const std::optional<std::string> path = socket_path(address);
  std::optional<HostPort> place;
  if (path) {
    socket_ = open_socket(*path);
  } else {
    place = parse_host_port(address, PortZero::kAnyFree);
    const AddressList addresses(*place);
    if (options_.this_machine_only && !is_of_this_machine(*addresses.first->ai_addr)) {
      throw Error(
          ErrorKind::kUsage,
          fmt::format("other machines reach {}, and connections would be neither encrypted nor "
                      "authenticated: give --tls-cert and --tls-key, or, in a network where "
                      "everybody is trusted, --insecure",
                      address));
    }
    socket_ = open_socket(*addresses.first);
  }
  if (socket_ < 0) {
    throw Error(ErrorKind::kIo, fmt::format("cannot listen on {}: {}", printable(address),
                                            std::generic_category().message(errno)));
  }
  wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (path) {
    path_ = *path;
    address_ = "unix:" + path_;
  } else {
    place->port = port_of(socket_);
    address_ = place->text();
  }
}

Listener::~Listener() {
  close();
  if (wake_ >= 0) ::close(wake_);
}

void Listener::start(std::function<void(int)> take) {
  thread_ = std::jthread(
      [this, take = std::move(take)](const std::stop_token& stop) { run(stop, take); });
}

void Listener::close() {
  if (thread_.joinable()) {
    thread_.request_stop();
    eventfd_write(wake_, 1);
    thread_.join();
  }
  if (socket_ >= 0) {
    ::close(std::exchange(socket_, -1));
    if (!path_.empty()) unlink(path_.c_str());
  }
  for (const Connection& connection : connections_) {
    shutdown(connection.fd, SHUT_RDWR);
    ::close(connection.fd);
  }
  connections_.clear();
  open_ = 0;
}

void Listener::run(const std::stop_token& stop, const std::function<void(int)>& take) {
  bool paused = false;  // no file descriptor was left for a connection
  while (!stop.stop_requested()) {
    const int accepting = paused || short_of_memory_ ? -1 : socket_;
    std::vector<pollfd> polled = {{wake_, POLLIN, 0}, {accepting, POLLIN, 0}};
    for (const Connection& connection : connections_) {
      polled.push_back({connection.fd, POLLRDHUP, 0});
    }
    const uint64_t most = options_.max_memory_bytes;
    const bool tight = most > 0 && resident_memory() > most / kTightPart;
    poll(polled.data(), polled.size(), static_cast<int>((tight ? kTight : kCalm).count()));
    std::vector<int> closed;
    for (size_t i = 2; i < polled.size(); ++i) {
      if (polled[i].revents != 0) closed.push_back(polled[i].fd);
    }
    forget(closed);
    paused = false;
    if (polled[1].revents != 0) paused = !accept_all(take);
    if (most > 0) relieve_memory();
  }
}

bool Listener::has_place_for(const std::string& peer) const {
  const size_t held = std::ranges::count(connections_, peer, &Connection::peer);
  return connections_.size() + held < options_.max_connections;
}

bool Listener::accept_all(const std::function<void(int)>& take) {
  for (;;) {
    sockaddr_storage address = {};
    socklen_t length = sizeof address;
    const int fd = accept4(socket_, reinterpret_cast<sockaddr*>(&address), &length,
                           SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd < 0) return errno != EMFILE && errno != ENFILE && errno != ENOMEM && errno != ENOBUFS;
    std::string peer = peer_of(fd, address);
    const int watched = has_place_for(peer) ? fcntl(fd, F_DUPFD_CLOEXEC, 0) : -1;
    if (watched < 0) {
      spdlog::warn(
          "a connection was closed: there are {} of {} already, and too many of its address",
          connections_.size(), options_.max_connections);
      ::close(fd);
      continue;
    }
    connections_.push_back({watched, std::move(peer)});
    open_ = connections_.size();
    take(fd);
  }
}

// gRPC's own descriptor of the socket stays as it is.
void Listener::forget(const std::vector<int>& fds) {
  std::erase_if(connections_, [&](const Connection& connection) {
    if (std::find(fds.begin(), fds.end(), connection.fd) == fds.end()) return false;
    ::close(connection.fd);
    return true;
  });
  open_ = connections_.size();
}

uint64_t Listener::trimmed_memory(uint64_t most) {
  const uint64_t resident = resident_memory();
  if (resident <= options_.max_memory_bytes / kTightPart) return resident;
  const auto since = steady_clock::now() - last_trim_;
  const bool grown = resident > after_trim_ + options_.max_memory_bytes / kGrowth;
  if (resident > most || (grown && since > kMinTrimInterval) || since > kTrimInterval) {
    malloc_trim(0);
    last_trim_ = steady_clock::now();
    after_trim_ = resident_memory();
    return after_trim_;
  }
  return resident;
}

// gRPC goes on for many looks with what it has read.
void Listener::Connection::look() {
  const uint64_t now = bytes_received(fd);
  lately += static_cast<double>(now - std::min(received, now));
  lately *= kRemembered;
  received = now;
}

void Listener::relieve_memory() {
  const auto now = steady_clock::now();
  if (now < last_look_ + kTight) return;
  last_look_ = now;
  for (Connection& connection : connections_) connection.look();
  const uint64_t most = options_.max_memory_bytes - options_.max_memory_bytes / kReserve;
  const uint64_t resident = trimmed_memory(most);
  short_of_memory_ = resident > most && now < last_cut_ + kRecovery;
  const bool recovers =
      now < last_cut_ + kGrace && resident < at_last_cut_ + options_.max_memory_bytes / kGrowth;
  if (resident <= most || connections_.empty() || recovers) return;
  const auto hungriest =
      std::max_element(connections_.begin(), connections_.end(),
                       [](const auto& a, const auto& b) { return a.lately < b.lately; });
  if (hungriest->lately < 1) return;  // what grows is not what they send
  spdlog::warn("more than {} MiB of memory are in use: the connection that sends most is closed",
               most >> 20);
  cut(hungriest->fd);
  forget({hungriest->fd});
  short_of_memory_ = true;
  last_cut_ = now;
  at_last_cut_ = resident;
}

}  // namespace itn
