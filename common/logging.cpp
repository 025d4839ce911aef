#include "common/logging.h"

#include <fmt/format.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <iterator>
#include <memory>

#include "common/error.h"
#include "common/printable.h"

namespace itn {

namespace {

// Fields of the message that this thread is logging.
thread_local std::span<const LogField> fields_of_message;

// %& in a pattern: the fields, each after a comma.
class Fields final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& /*message*/, const std::tm& /*time*/,
              spdlog::memory_buf_t& line) override {
    for (const LogField& field : fields_of_message) {
      const std::string* const text = std::get_if<std::string>(&field.value);
      const std::string value = text ? fmt::format("\"{}\"", json_escaped(*text))
                                     : fmt::format("{}", std::get<double>(field.value));
      fmt::format_to(std::back_inserter(line), ",\"{}\":{}", field.name, value);
    }
  }
  std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<Fields>();
  }
};

// %* in a pattern: the message, escaped.
template <auto escape>
class EscapedMessage final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm& /*time*/,
              spdlog::memory_buf_t& line) override {
    const std::string text = escape({message.payload.data(), message.payload.size()});
    line.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<EscapedMessage>();
  }
};

std::unique_ptr<spdlog::formatter> text_formatter() {
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<EscapedMessage<for_terminal>>('*').set_pattern(
      "%Y-%m-%d %H:%M:%S.%e %^%l%$ %*");
  return formatter;
}

std::unique_ptr<spdlog::formatter> json_formatter() {
  auto formatter = std::make_unique<spdlog::pattern_formatter>(spdlog::pattern_time_type::utc);
  formatter->add_flag<EscapedMessage<json_escaped>>('*').add_flag<Fields>('&').set_pattern(
      R"({"time":"%Y-%m-%dT%H:%M:%S.%eZ","level":"%l","message":"%*"%&})");
  return formatter;
}

}  // namespace

std::string json_escaped(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      escaped += {'\\', c};
    } else if (byte < 0x20 || byte > 0x7e) {
      escaped += fmt::format("\\u{:04x}", byte);
    } else {
      escaped += c;
    }
  }
  return escaped;
}

void log_with_fields(spdlog::level::level_enum level, const std::string& message,
                     std::span<const LogField> fields) {
  // spdlog formats on the thread that logs.
  fields_of_message = fields;
  spdlog::log(level, "{}", message);
  fields_of_message = {};
}

void set_up_logging(const std::string& level, LogFormat format) {
  const auto parsed = spdlog::level::from_str(level);
  // spdlog takes a name that it does not know for "off".
  if (parsed == spdlog::level::off && level != "off") {
    throw Error(ErrorKind::kUsage,
                fmt::format("there is no log level \"{}\"; use trace, debug, info, warning, error, "
                            "critical or off",
                            level));
  }
  auto sink = std::make_shared<spdlog::sinks::stderr_color_sink_mt>(spdlog::color_mode::automatic);
  auto logger = std::make_shared<spdlog::logger>("itn", std::move(sink));
  logger->set_level(parsed);
  logger->set_formatter(format == LogFormat::kJson ? json_formatter() : text_formatter());
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
}

}  // namespace itn
