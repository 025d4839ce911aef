// The socket that a server listens on, and the connections that it accepts for gRPC: gRPC 1.51
// itself takes addresses that are none, opens IPv6 for 0.0.0.0, accepts any number of connections,
// and cannot end one.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>
#include <vector>

namespace itn {

struct ListenerOptions {
  // More are closed at once. So are those of an address that would then hold more than are free:
  // whoever opens all that they can leaves others half.
  size_t max_connections = 1024;
  // The most that the process may take, resident: close to it, the connection that sent most lately
  // is closed, again and again, and until that has helped, for two seconds at most, none is
  // accepted. 0: none.
  uint64_t max_memory_bytes = 0;
  bool this_machine_only = false;  // refuse addresses that other machines reach
};

class Listener {
 public:
  // HOST:PORT: opens the first address that the host has: 0.0.0.0 is IPv4 alone, [::] both IPv4 and
  // IPv6. unix:PATH: makes a socket there, in place of one that nobody listens on; who may connect
  // is a matter of the folder's permissions. What such connections send is not counted for
  // `max_memory_bytes`.
  // Throws Error if that fails: kUsage for an address that is none, or not to be listened on; kIo.
  Listener(const std::string& address, const ListenerOptions& options);
  // Closes everything.
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  // Accepts from now on: `take` gets each connection's socket and owns it.
  void start(std::function<void(int fd)> take);

  // Accepts no more, and ends all connections once what was written to them has left; to who is at
  // their other end, the server is then unavailable.
  void close();

  // HOST:PORT, with the port that was taken; or unix:PATH.
  const std::string& address() const { return address_; }

  // That are open. From any thread.
  size_t connections() const { return open_; }
  size_t max_connections() const { return options_.max_connections; }

 private:
  struct Connection {
    int fd = -1;            // a duplicate of gRPC's: ours to watch and to shut down
    std::string peer;       // bytes of the other end's address, of IPv6 the network's 64 bits
    uint64_t received = 0;  // bytes, in all
    double lately = 0;      // bytes, the older the less

    void look();
  };

  bool has_place_for(const std::string& peer) const;
  // False if the system has no room for one more.
  bool accept_all(const std::function<void(int)>& take);
  void forget(const std::vector<int>& fds);
  // Resident; if that is more than a half, mostly after the heap was trimmed.
  uint64_t trimmed_memory(uint64_t most);
  void relieve_memory();
  void run(const std::stop_token& stop, const std::function<void(int)>& take);

  const ListenerOptions options_;
  std::string address_;
  std::string path_;  // of the socket, if it is one of the file system: removed at the end
  int socket_ = -1;
  int wake_ = -1;  // an eventfd
  // The thread's alone while it runs:
  std::vector<Connection> connections_;
  std::atomic<size_t> open_ = 0;  // of them, for others
  std::chrono::steady_clock::time_point last_look_, last_trim_, last_cut_;
  uint64_t after_trim_ = 0, at_last_cut_ = 0;  // bytes resident
  bool short_of_memory_ = false;               // for one more connection
  std::jthread thread_;                        // last: it uses what is above
};

}  // namespace itn
