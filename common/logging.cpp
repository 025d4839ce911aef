#include "common/logging.h"

#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <memory>

#include "common/error.h"

namespace itn {

void set_up_logging(const std::string& level) {
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
  logger->set_pattern("%Y-%m-%d %H:%M:%S.%e %^%l%$ %v");
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
}

}  // namespace itn
