// Logging for every program of itn: to stderr, through spdlog.
#pragma once

#include <string>

namespace itn {

// Lines are "date time level message"; coloured on a terminal only. `level` is one of trace, debug,
// info, warning, error, critical, off. Throws Error (kUsage) for another.
void set_up_logging(const std::string& level = "info");

}  // namespace itn
