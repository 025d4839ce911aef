// Checks of flags, for CLI::Option::check(): each says in --help what may be given, and in one
// style what is wrong with what was given.
#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <string>
#include <type_traits>
#include <vector>

namespace itn {

enum class Ends { kIncluded, kExcluded };

// A number from `min` to `max`: no other text, no NaN, and no minus sign where none belongs (which
// the C library would take for 2^64 less that).
template <typename Number>
CLI::Validator number_in(Number min, Number max, Ends ends = Ends::kIncluded) {
  const bool open = ends == Ends::kExcluded;
  const std::string range =
      fmt::format("in {}{}, {}{}", open ? '(' : '[', min, max, open ? ')' : ']');
  const auto check = [=](std::string& text) -> std::string {
    Number value{};
    const bool negative = std::is_unsigned_v<Number> && text.starts_with('-');
    const bool read = !negative && CLI::detail::lexical_cast(text, value);
    if (read && (open ? min < value && value < max : min <= value && value <= max)) return {};
    const bool comma = std::is_floating_point_v<Number> && text.find(',') != std::string::npos;
    return fmt::format("{} is not a {} {}{}", text.empty() ? "nothing" : text,
                       std::is_integral_v<Number> ? "whole number" : "number", range,
                       comma ? " (decimals take a point)" : "");
  };
  return CLI::Validator(check, range, "");
}

inline CLI::Validator one_of(const std::vector<std::string>& values) {
  const std::string list = fmt::format("{}", fmt::join(values, ", "));
  const auto check = [=](std::string& text) -> std::string {
    for (const std::string& value : values) {
      if (text == value) return {};
    }
    return fmt::format("{} is not one of {}", text.empty() ? "nothing" : text, list);
  };
  return CLI::Validator(check, list, "");
}

// What CLI11 has to say of arguments that it could not take, in our words where its own are
// unclear.
inline std::string message_of(const CLI::ParseError& error) {
  std::string message = error.what();
  const std::string flag = message.substr(0, message.find(':'));
  if (message.find("At Most 1 required") != std::string::npos) {
    return flag + " is given more than once";
  }
  return message;
}

}  // namespace itn
