// Logging for every program of itn: to stderr, through spdlog.
#pragma once

#include <string>
#include <string_view>

namespace itn {

enum class LogFormat {
  kText,  // "date time level message"; coloured on a terminal only
  kJson,  // {"time":"2030-01-31T12:00:00.000Z","level":"info","message":"..."}
};

// `level` is one of trace, debug, info, warning, error, critical, off. Throws Error (kUsage) for
// another.
void set_up_logging(const std::string& level = "info", LogFormat format = LogFormat::kText);

// As the inside of a JSON string (RFC 8259), in ASCII: bytes that are not are written as \u00NN.
std::string json_escaped(std::string_view text);

}  // namespace itn
