// Flags that change fields of a configuration which is known once all of them are read.
#pragma once

#include <CLI/CLI.hpp>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/flags.h"

namespace itn {

// Holds the changes that a command line asks for. It must stay where it is until that is parsed; a
// copy that is made then makes the same changes.
template <typename Config>
class ConfigFlags {
 public:
  explicit ConfigFlags(CLI::App& command) : command_(command) {}

  // A flag of one value or, if that is a vector, of several: change(config, value) is called where
  // it was given. A setter of the configuration is such a change.
  template <typename Value, typename Change>
  CLI::Option* add(const std::string& names, Change change, const std::string& help) {
    const size_t place = new_place();
    return command_.add_option_function<Value>(
        names,
        [this, place, change](const Value& value) {
          changes_[place] = [change, value](Config& config) { std::invoke(change, config, value); };
        },
        help);
  }

  // A flag without a value, and maybe its opposite: "--mirror,!--no-mirror". change(config, bool)
  // is called where one of them was given.
  template <typename Change>
  CLI::Option* add_switch(const std::string& names, Change change, const std::string& help) {
    const auto value = std::make_shared<bool>(false);
    CLI::Option* const option = command_.add_flag(names, *value, help);
    changes_[new_place()] = [option, value, change](Config& config) {
      if (option->count() > 0) std::invoke(change, config, *value);
    };
    return option;
  }

  // A flag of one of some words, which stand for what `change` is called with.
  template <typename Value, typename Change>
  CLI::Option* add_choice(const std::string& names,
                          const std::vector<std::pair<std::string, Value>>& words, Change change,
                          const std::string& help) {
    std::vector<std::string> known;
    for (const auto& [word, value] : words) known.push_back(word);
    const auto change_by_word = [words, change](Config& config, const std::string& given) {
      for (const auto& [word, value] : words) {
        if (word == given) std::invoke(change, config, value);
      }
    };
    return add<std::string>(names, change_by_word, help)->check(one_of(known));
  }

  // Makes the changes, in the order in which their flags were added.
  void apply_to(Config& config) const {
    for (const auto& change : changes_) {
      if (change) change(config);
    }
  }

 private:
  size_t new_place() {
    changes_.emplace_back();
    return changes_.size() - 1;
  }

  CLI::App& command_;
  std::vector<std::function<void(Config&)>> changes_;
};

}  // namespace itn
