// The addresses of the render workers that --workers names, while names and files change.
#pragma once

#include <chrono>
#include <concepts>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace itn {

// Entries are:
//   HOST:PORT             one worker, for good
//   dns:///NAME:PORT      all addresses that the name has
//   file:PATH             a file of HOST:PORT lines; what follows a # is a comment
// Names are resolved and files are read again every few seconds, and when a worker fails. If that
// fails (no answer from the name server, an unreadable file), the last addresses stay, with a
// warning. Thread-safe.
class WorkerList {
 public:
  struct Address {
    template <std::convertible_to<std::string> Text>
    Address(const Text& text, std::string n = "") : address(text), name(std::move(n)) {}

    std::string address;  // HOST:PORT
    std::string name;     // that was resolved to it, which a certificate should say; or empty

    bool operator==(const Address&) const = default;
  };
  using Addresses = std::vector<Address>;  // no two the same
  using Changed = std::function<void(const Addresses&)>;

  // Throws Error: kUsage (an entry), kInvalidInput (a line of a file, with its number), kIo (a file
  // that cannot be read; one that is not there yet is waited for if its folder is there).
  explicit WorkerList(const std::vector<std::string>& entries);
  ~WorkerList();

  // Calls `changed` with all addresses: once before it returns, as far as they are known by then,
  // and when they change, from one thread at a time. What `changed` throws the first time, this
  // throws; Error later is a warning, and `changed` is called again at each look until it throws
  // none: what it could not take may be mended without any change here.
  void watch(Changed changed);
  // Without watch(): asks all names and files now, unless a stop is requested, and returns all
  // addresses; of what cannot be told at the moment, those that it told before.
  Addresses resolve(const std::stop_token& stop);
  // Looks at names and files at once, though not more often than once a second.
  void refresh();

  // Whether it has names or files.
  bool can_change() const;
  // What each name or file has to say: "dns:///workers:50051 (Name or service not known)".
  std::string unresolved() const;

 private:
  struct Source;
  void follow(Source& source, const std::stop_token& stop);
  // With the lock held, after a look at the source.
  void notify(const Source& source);
  Addresses all() const;

  std::vector<std::unique_ptr<Source>> sources_;
  Changed changed_;
  mutable std::mutex mutex_;
  std::condition_variable_any wanted_;
  uint64_t times_wanted_ = 0;
  std::string refusal_;                // what `changed` threw the last time; empty: nothing
  std::vector<std::jthread> threads_;  // last: they use what is above
};

}  // namespace itn
