// What commands print: results on stdout, messages on stderr. Names of strangers (files, models,
// shapes, what a server answers) may be part of it: they must not steer a terminal.
#pragma once

#include <fmt/format.h>

#include <cstdio>
#include <string>
#include <string_view>

#include "common/printable.h"

namespace itn {

// To stdout, or another stream; made fit for_terminal().
void print_result(std::string_view text, std::FILE* out = stdout);

template <typename... Arguments>
void print_result(fmt::format_string<Arguments...> format, Arguments&&... arguments) {
  print_result(fmt::format(format, std::forward<Arguments>(arguments)...));
}

// Throws Error (kIo) if anything that went to stdout could not be written. Once, at the end.
void finish_output();

}  // namespace itn
