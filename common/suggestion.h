// Which name may have been meant by one that there is not.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <string>
#include <vector>

namespace itn {

// How many letters are to be changed, left out, put in, or exchanged with their neighbour.
inline size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::vector<size_t>> d(a.size() + 1, std::vector<size_t>(b.size() + 1));
  for (size_t i = 0; i <= a.size(); ++i) d[i][0] = i;
  for (size_t j = 0; j <= b.size(); ++j) d[0][j] = j;
  for (size_t i = 1; i <= a.size(); ++i) {
    for (size_t j = 1; j <= b.size(); ++j) {
      d[i][j] = std::min(
          {d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
      }
    }
  }
  return d[a.size()][b.size()];
}

// "; did you mean X?", or nothing if no name is near.
inline std::string suggestion(const std::string& name, const std::vector<std::string>& names) {
  const auto distance = [&](const std::string& other) {
    return other.starts_with(name) ? 0 : edit_distance(name, other);  // an abbreviation
  };
  const auto nearest = std::ranges::min_element(names, {}, distance);
  if (nearest == names.end() || distance(*nearest) > std::max<size_t>(1, name.size() / 3)) {
    return "";
  }
  return fmt::format("; did you mean {}?", *nearest);
}

inline std::vector<std::string> names_of_flags(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

// The flag of an argument "--flag=value", or one without a value.
inline std::string flag_of(const std::string& argument) {
  return argument.substr(0, argument.find('='));
}

// Whether the argument is a flag, by its looks, that `app` does not have.
inline bool is_unknown_flag(const CLI::App& app, const std::string& argument) {
  const std::string flag = flag_of(argument);
  return flag.starts_with("--") && flag != "--" && app.get_option_no_throw(flag) == nullptr;
}

// What is wrong with the first flag that a program without commands does not have; empty if it has
// all.
inline std::string unknown_flag(const CLI::App& app, const std::string& program,
                                const std::vector<std::string>& arguments) {
  for (const std::string& argument : arguments) {
    if (!is_unknown_flag(app, argument)) continue;
    const std::string flag = flag_of(argument);
    return fmt::format("{} has no flag {}{}", program, flag, suggestion(flag, names_of_flags(app)));
  }
  return "";
}

}  // namespace itn
