// A child process of a test: its output, its exit code, signals to it, and what it has come to.
#pragma once

#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/cpu_time.h"

extern char** environ;

namespace itn::testing {

// How long a test waits for what must happen before it fails: long enough for a machine that has
// much else to do.
inline constexpr std::chrono::seconds kPatience{120};

// Waits until `condition()` holds. False if it did not in kPatience.
template <typename F>
bool eventually(const F& condition) {
  const auto deadline = std::chrono::steady_clock::now() + kPatience;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

// stdout goes to a pipe, and stderr to another or to that of the test. Killed when it goes out of
// scope.
class Process {
 public:
  explicit Process(std::vector<std::string> arguments, bool capture_stderr = false) {
    std::array<int, 2> out{}, err{};
    if (pipe(out.data()) != 0 || pipe(err.data()) != 0) throw std::runtime_error("pipe");
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, out[1], STDOUT_FILENO);
    if (capture_stderr) posix_spawn_file_actions_adddup2(&actions, err[1], STDERR_FILENO);
    for (const int fd : {out[0], out[1], err[0], err[1]}) {
      posix_spawn_file_actions_addclose(&actions, fd);
    }
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    const int error = posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    close(out[1]);
    close(err[1]);
    stdout_ = out[0];
    stderr_ = err[0];
    if (error != 0) throw std::runtime_error("cannot start " + arguments[0]);
  }

  ~Process() {
    if (pid_ > 0 && !waited_) {
      send(SIGKILL);
      wait();
    }
    close(stdout_);
    close(stderr_);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  // Without its line end.
  std::string read_line() const {
    std::string line;
    char c = 0;
    while (read(stdout_, &c, 1) == 1 && c != '\n') line += c;
    return line;
  }

  // All that is left, until the process closes it.
  std::string read_stdout() const { return read_all(stdout_); }
  std::string read_stderr() const { return read_all(stderr_); }

  // stderr up to where it says `text`; all that there was if it ends, or kPatience does, before.
  std::string read_stderr_until(const std::string& text) const {
    const auto deadline = std::chrono::steady_clock::now() + kPatience;
    std::string said;
    while (said.find(text) == std::string::npos) {
      pollfd waiting{stderr_, POLLIN, 0};
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
          deadline - std::chrono::steady_clock::now());
      char c = 0;
      if (left.count() <= 0 || ::poll(&waiting, 1, static_cast<int>(left.count())) != 1 ||
          ::read(stderr_, &c, 1) != 1) {
        break;
      }
      said += c;
    }
    return said;
  }

  // Processor time that it has used, in seconds: what it has done, however busy the machine is.
  double cpu_seconds() const {
    clockid_t clock{};
    timespec used{};
    if (::clock_getcpuclockid(pid_, &clock) != 0 || ::clock_gettime(clock, &used) != 0) return 0;
    return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
  }

  pid_t id() const { return pid_; }

  void send(int signal) const { ::kill(pid_, signal); }

  // It has ended, and waits for wait().
  bool has_ended() const {
    siginfo_t info{};
    return waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT) == 0 &&
           info.si_pid == pid_;
  }

  // Its exit code, or minus the signal that ended it.
  int wait() {
    int status = 0;
    waitpid(pid_, &status, 0);
    waited_ = true;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }

 private:
  static std::string read_all(int fd) {
    std::string text;
    std::array<char, 4096> buffer{};
    for (ssize_t n = 0; (n = read(fd, buffer.data(), buffer.size())) > 0;) {
      text.append(buffer.data(), static_cast<size_t>(n));
    }
    return text;
  }

  pid_t pid_ = -1;
  bool waited_ = false;
  int stdout_ = -1;
  int stderr_ = -1;
};

struct Finished {
  int exit_code = 0;
  std::string output;
  std::string errors;
};

// Runs a program that says little to its end.
inline Finished run(std::vector<std::string> arguments) {
  Process process(std::move(arguments), true);
  Finished finished;
  finished.output = process.read_stdout();
  finished.errors = process.read_stderr();
  finished.exit_code = process.wait();
  return finished;
}

}  // namespace itn::testing
