// Errors that a user can act on, and the exit code or gRPC status that each becomes.
#pragma once

#include <stdexcept>
#include <string>

namespace itn {

enum class ErrorKind {
  kInternal,      // a fault of ours
  kUsage,         // command line
  kInvalidInput,  // a value, scene, mesh or image that cannot be used
  kIo,            // a file that is missing, unreadable or unwritable
  kUnavailable,   // no worker or predictor answers
  kDataLoss,      // a file that is damaged or was cut short
  kLimit,         // a limit of the worker is exceeded
  kCancelled,     // interrupted; what was begun can be resumed
};

// Exit codes of every itn program: 0 success, 1 internal, 2 usage, 3 invalid input, 4 file,
// 5 unavailable, 6 damaged file, 7 limit exceeded, 130 interrupted.
int exit_code(ErrorKind kind);

// Thrown with a message for the user: what is wrong, where, and what would be right.
class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

inline Error invalid_input(const std::string& message) {
  return Error(ErrorKind::kInvalidInput, message);
}

// Throws invalid_input(message) otherwise.
inline void require(bool condition, const std::string& message) {
  if (!condition) throw invalid_input(message);
}

}  // namespace itn
