#include "client/render_pool/worker_list.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <future>
#include <optional>
#include <string_view>
#include <utility>

#include "client/rpc/client_security.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/printable.h"
#include "common/rpc/host_port.h"

namespace itn {
namespace {

namespace fs = std::filesystem;
using std::chrono::seconds;

// A name server is asked this often, a file, which costs nothing, more often.
constexpr seconds kAskNameEvery{5};
constexpr seconds kReadFileEvery{1};
constexpr seconds kAtMostEvery{1};

constexpr uint64_t kMaxFileBytes = 1 << 20;

constexpr std::string_view kName = "dns:", kFile = "file:";

// What a name or a file says.
struct Finding {
  std::optional<WorkerList::Addresses> addresses;  // nothing: that cannot be told
  std::string problem;                             // what is wrong or missing, for people
  std::optional<Error> mistake;                    // of the user, where the problem is one
};

// ---- Names -------------------------------------------------------------------------------------

HostPort name_in(const std::string& entry) {
  if (std::optional<HostPort> name = endpoint_of_target(entry)) return std::move(*name);
  throw Error(ErrorKind::kUsage,
              fmt::format("\"{}\" is not the name of workers; give dns:///NAME:PORT, e.g. "
                          "dns:///workers:50051",
                          printable(entry)));
}

HostPort numeric(const sockaddr* address, uint16_t port) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  if (address->sa_family == AF_INET) {
    sockaddr_in ipv4{};
    std::memcpy(&ipv4, address, sizeof(ipv4));
    inet_ntop(AF_INET, &ipv4.sin_addr, text.data(), text.size());
  } else {
    sockaddr_in6 ipv6{};
    std::memcpy(&ipv6, address, sizeof(ipv6));
    inet_ntop(AF_INET6, &ipv6.sin6_addr, text.data(), text.size());
  }
  return {text.data(), port};
}

// gRPC's own resolver gives its addresses to a balancing policy of its own alone, and none of those
// of gRPC 1.51 keeps one render for each free place: so the system's is asked.
//
// A worker with an address of each family is one worker: IPv6 counts where there is no IPv4.
Finding addresses_of(const HostPort& name) {
  Finding finding;
  for (const int family : {AF_INET, AF_INET6}) {
    addrinfo wanted{};
    wanted.ai_family = family;
    wanted.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    const int error = getaddrinfo(name.host.c_str(), nullptr, &wanted, &found);
    const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(found, &freeaddrinfo);
    if (error == EAI_NONAME || error == EAI_NODATA || error == EAI_ADDRFAMILY) {
      finding.addresses = WorkerList::Addresses();
      finding.problem = gai_strerror(error);
      continue;
    }
    if (error != 0) return {std::nullopt, gai_strerror(error), {}};
    WorkerList::Addresses addresses;
    for (const addrinfo* a = found; a; a = a->ai_next) {
      addresses.push_back({numeric(a->ai_addr, name.port).text(), name.host});
    }
    return {std::move(addresses), "", {}};
  }
  return finding;
}

// ---- Files -------------------------------------------------------------------------------------

std::string without_comment(std::string line) {
  line.resize(std::min(line.find('#'), line.size()));
  constexpr const char* kSpace = " \t\r";
  const size_t first = line.find_first_not_of(kSpace);
  if (first == std::string::npos) return "";
  return line.substr(first, line.find_last_not_of(kSpace) + 1 - first);
}

void check_line(const std::string& address, const std::string& path, size_t number) {
  try {
    if (address.starts_with(kName) || address.starts_with(kFile)) {
      throw Error(ErrorKind::kUsage, fmt::format("\"{}\" stands in a file of workers; there, give "
                                                 "HOST:PORT",
                                                 printable(address)));
    }
    check_address(address);
  } catch (const Error& error) {
    throw Error(ErrorKind::kInvalidInput,
                fmt::format("{}:{}: {}", printable(path), number, error.what()));
  }
}

// Lines that cannot be used are left out.
Finding addresses_in(const std::string& path) {
  // Opened each time, however old the file says that it is: over NFS, that is what asks the server.
  std::string text;
  try {
    std::error_code absent;
    const fs::path folder = fs::absolute(path, absent).parent_path();
    if (!fs::exists(path, absent) && fs::is_directory(folder, absent)) {
      return {std::nullopt, "no such file yet", {}};
    }
    text = read_file(path, "file of workers", kMaxFileBytes);
  } catch (const Error& error) {
    return {std::nullopt, error.what(), error};
  }
  Finding finding{WorkerList::Addresses(), "", {}};
  for (size_t begin = 0, number = 1; begin < text.size(); ++number) {
    const size_t end = std::min(text.find('\n', begin), text.size());
    const std::string address = without_comment(text.substr(begin, end - begin));
    begin = end + 1;
    if (address.empty()) continue;
    try {
      check_line(address, path, number);
      finding.addresses->emplace_back(address);
    } catch (const Error& error) {
      if (!finding.mistake) finding.mistake = error;
    }
  }
  if (finding.mistake) finding.problem = finding.mistake->what();
  if (finding.addresses->empty() && finding.problem.empty()) finding.problem = "no address in it";
  return finding;
}

}  // namespace

struct WorkerList::Source {
  std::string entry;
  std::function<Finding()> look;  // holds nothing but its own values: it may outlive the list
  seconds every{0};               // 0: never again
  Addresses addresses;
  std::string problem;
};

WorkerList::WorkerList(const std::vector<std::string>& entries) {
  for (const std::string& entry : entries) {
    auto source = std::make_unique<Source>();
    source->entry = entry;
    if (entry.starts_with(kName)) {
      source->look = [name = name_in(entry)] { return addresses_of(name); };
      source->every = kAskNameEvery;
      source->problem = "not asked yet";
    } else if (entry.starts_with(kFile)) {
      const std::string path = entry.substr(kFile.size());
      if (path.empty()) throw Error(ErrorKind::kUsage, "\"file:\" names no file of workers");
      source->look = [path] { return addresses_in(path); };
      source->every = kReadFileEvery;
      const Finding finding = addresses_in(path);
      if (finding.mistake) throw *finding.mistake;
      source->addresses = finding.addresses.value_or(Addresses());
      source->problem = finding.problem;
    } else {
      check_address(entry);
      source->addresses = {entry};
    }
    sources_.push_back(std::move(source));
  }
}

WorkerList::~WorkerList() = default;

bool WorkerList::can_change() const {
  return std::ranges::any_of(sources_,
                             [](const auto& source) { return source->every > seconds(0); });
}

void WorkerList::watch(Changed changed) {
  const std::lock_guard lock(mutex_);
  changed_ = std::move(changed);
  changed_(all());
  for (const auto& source : sources_) {
    if (source->every == seconds(0)) continue;
    threads_.emplace_back(
        [this, &source = *source](const std::stop_token& stop) { follow(source, stop); });
  }
}

void WorkerList::refresh() {
  const std::lock_guard lock(mutex_);
  ++times_wanted_;
  wanted_.notify_all();
}

namespace {

// Name servers may take their time, and nobody can interrupt them: their answer is waited for in a
// thread that is left behind at a stop.
std::optional<Finding> look(const std::function<Finding()>& where, const std::stop_token& stop) {
  std::packaged_task<Finding()> task(where);
  std::future<Finding> finding = task.get_future();
  std::thread(std::move(task)).detach();
  while (finding.wait_for(std::chrono::milliseconds(50)) != std::future_status::ready) {
    if (stop.stop_requested()) return std::nullopt;
  }
  return finding.get();
}

}  // namespace

void WorkerList::follow(Source& source, const std::stop_token& stop) {
  while (std::optional<Finding> finding = look(source.look, stop)) {
    std::unique_lock lock(mutex_);
    if (finding->problem != source.problem && !finding->problem.empty()) {
      spdlog::warn("{}: {}", printable(source.entry), finding->problem);
    }
    source.problem = finding->problem;
    const bool change = finding->addresses && *finding->addresses != source.addresses;
    if (change) source.addresses = std::move(*finding->addresses);
    if (change || !refusal_.empty()) notify(source);
    const uint64_t seen = times_wanted_;
    wanted_.wait_for(lock, stop, kAtMostEvery, [] { return false; });
    wanted_.wait_for(lock, stop, source.every - kAtMostEvery,
                     [&] { return times_wanted_ != seen; });
    if (stop.stop_requested()) return;
  }
}

WorkerList::Addresses WorkerList::resolve(const std::stop_token& stop) {
  for (const auto& source : sources_) {
    if (!source->look) continue;
    std::optional<Finding> finding = look(source->look, stop);
    if (!finding) break;
    const std::lock_guard lock(mutex_);
    source->problem = finding->problem;
    if (finding->addresses) source->addresses = std::move(*finding->addresses);
  }
  const std::lock_guard lock(mutex_);
  return all();
}

void WorkerList::notify(const Source& source) {
  try {
    changed_(all());
    refusal_.clear();
  } catch (const Error& error) {
    if (refusal_ != error.what()) spdlog::warn("{}: {}", printable(source.entry), error.what());
    refusal_ = error.what();
  }
}

WorkerList::Addresses WorkerList::all() const {
  Addresses all;
  for (const auto& source : sources_) {
    for (const Address& worker : source->addresses) {
      const bool known = std::ranges::find(all, worker.address, &Address::address) != all.end();
      if (!known) all.push_back(worker);
    }
  }
  return all;
}

std::string WorkerList::unresolved() const {
  const std::lock_guard lock(mutex_);
  std::string text;
  for (const auto& source : sources_) {
    if (source->every == seconds(0)) continue;
    text += fmt::format("{}{}{}", text.empty() ? "" : ", ", printable(source->entry),
                        source->problem.empty() ? "" : fmt::format(" ({})", source->problem));
  }
  return text;
}

}  // namespace itn
