// Logging for every program of itn: to stderr, through spdlog.
#pragma once

#include <spdlog/common.h>

#include <span>
#include <string>
#include <string_view>
#include <variant>

namespace itn {

enum class LogFormat {
  kText,  // "date time level message"; coloured on a terminal only
  kJson,  // {"time":"2030-01-31T12:00:00.000Z","level":"info","message":"..."}
};

// `level` is one of trace, debug, info, warning, error, critical, off. Throws Error (kUsage) for
// another.
void set_up_logging(const std::string& level = "info", LogFormat format = LogFormat::kText);

// What a program that reads the log wants to know by itself, beside the message.
struct LogField {
  std::string_view name;                    // of letters and _
  std::variant<std::string, double> value;  // in JSON, a number reads back the same
};

// Logs the message; in LogFormat::kJson with the fields as further ones of its
// object. People find in the message what there is to know.
void log_with_fields(spdlog::level::level_enum level, const std::string& message,
                     std::span<const LogField> fields);

// Writes a text as the inside of a JSON string (RFC 8259), in ASCII: bytes that are not are written
// as \u00NN.
std::string json_escaped(std::string_view text);

}  // namespace itn
