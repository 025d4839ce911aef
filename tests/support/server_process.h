// A server of ours as a child process, and what of the machine it holds.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/process.h"

namespace itn::testing {

class ServerProcess : public Process {
 public:
  // Started with these flags, on a port of its choice unless `listen` names one; listens when the
  // constructor returns.
  explicit ServerProcess(const std::string& program, std::vector<std::string> flags = {},
                         const std::string& listen = "127.0.0.1:0")
      : Process(command(program, std::move(flags), listen)), address_(read_line()) {}

  const std::string& address() const { return address_; }

  double resident_bytes() const {
    std::ifstream file(proc() / "statm");
    double total = 0, resident = 0;
    file >> total >> resident;
    return resident * static_cast<double>(::sysconf(_SC_PAGESIZE));
  }
  double descriptors() const { return entries("fd"); }
  double threads() const { return entries("task"); }

  // By thread: the time for which it had something to do, in seconds, whether it got a processor or
  // waited for one.
  std::map<std::string, double> seconds_with_work() const {
    std::map<std::string, double> seconds;
    for (const auto& thread : std::filesystem::directory_iterator(proc() / "task")) {
      std::ifstream file(thread.path() / "schedstat");
      double ran = 0, waited = 0;
      if (file >> ran >> waited) seconds[thread.path().filename()] = 1e-9 * (ran + waited);
    }
    return seconds;
  }

 private:
  static std::vector<std::string> command(const std::string& program,
                                          std::vector<std::string> flags,
                                          const std::string& listen) {
    flags.insert(flags.begin(), {program, "--listen", listen, "--log-level", "error"});
    return flags;
  }
  std::filesystem::path proc() const { return "/proc/" + std::to_string(id()); }
  double entries(const char* what) const {
    return static_cast<double>(
        std::distance(std::filesystem::directory_iterator(proc() / what), {}));
  }

  std::string address_;
};

}  // namespace itn::testing
